"""Projection: few parameters that come nearest, and what they leave."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from family_cases import BY_NAME, some_members
from scipy.optimize import brentq, least_squares
from scipy.spatial.transform import Rotation

from campaigns.controllers.model_reduction import Workspace, left_by, project_plain
from campaigns.controllers.reduced_parameters import FORMATS, configuration_text, few_parameters
from campaigns.errors import ConfigInvalid, IdentificationRefused
from campaigns.estimation.point_sets import fitted_frame
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.robots.robot import RobotFile

"""What is projected does not depend on the mechanism: one that turns, one on rails."""
MEMBER_OF = {word: BY_NAME[made.mechanism] for word, made in FORMATS.items()}
WORDS = pytest.mark.parametrize("word", FORMATS)
KINS = Path("/usr/lib/python3/dist-packages")


def workspace_of(member, robot, count=300):
    return Workspace.of(robot, member.poses(count))


def slightly_tilted(member):
    """Skews and tilts as workshops leave them."""
    p, space = member.perturbed.p.copy(), member.space
    names = [name for name in space.extensions if name not in space.datum]
    p[space.places(names)] += np.random.default_rng(2).normal(0.0, 5e-4, len(names))
    return Kinematics(member.mechanism, p)


@some_members
def test_plain_parameters_leave_nothing_of_a_robot_without_tilts(member):
    workspace = workspace_of(member, member.perturbed)
    found = project_plain(member.perturbed, workspace)
    assert found.error.max_mm < 1e-9
    assert left_by(member.nominal, workspace).mean_mm > 0.3


@some_members
def test_plain_parameters_leave_less_than_the_full_ones_without_their_extensions(member):
    robot = slightly_tilted(member)
    workspace = workspace_of(member, robot)
    own = robot.p.copy()
    own[member.space.places(member.space.extensions)] = 0.0
    cut = left_by(Kinematics(member.mechanism, own), workspace)
    found = project_plain(robot, workspace)
    assert 1e-3 < found.error.rms_mm < 0.8 * cut.rms_mm
    assert not found.kinematics.p[member.space.places(member.space.extensions)].any()


@some_members
def test_no_other_values_leave_less(member):
    """Every small change of a value, the frame fitted anew, makes the error larger."""
    robot = slightly_tilted(member)
    workspace = workspace_of(member, robot, 150)
    found = project_plain(robot, workspace)
    for place in member.space.places(member.space.free_by_default):
        for step in (-1e-4, 1e-4):
            p = found.kinematics.p.copy()
            p[place] += step
            other = left_by(Kinematics(member.mechanism, p), workspace)
            assert other.rms_mm > found.error.rms_mm


def test_a_controller_that_cannot_take_the_joints_is_refused():
    member = BY_NAME["delta"]
    workspace = workspace_of(member, member.nominal, 50)
    p = member.nominal.p.copy()
    p[member.space.places([f"arm{arm}.forearm_mm" for arm in range(3)])] *= 0.3
    with pytest.raises(IdentificationRefused, match="cannot be assembled all over the workspace"):
        left_by(Kinematics(member.mechanism, p), workspace)


def made_for(word, robot=None, count=300):
    member, made = MEMBER_OF[word], FORMATS[word]
    identified = RobotFile.of(
        member.mechanism,
        (robot or member.perturbed).parameters,
        name="identified",
        limits=member.limits,
    )
    poses = member.poses(count)
    few, left = few_parameters(identified, member.shipped, poses, made)
    return few, left, configuration_text(few, left, made)


@WORDS
def test_the_nearest_values_are_better_than_the_nominal_ones(word):
    few, left, text = made_for(word)
    nominal, nearest = left["nominal parameters"], left["these values"]
    assert nearest.mean_mm < nominal.mean_mm
    rms = [few.found.error.rms_mm, left_by(MEMBER_OF[word].nominal, few.workspace).rms_mm]
    assert rms[0] < rms[1]
    assert f"these values: mean {nearest.mean_mm:.4f}, max {nearest.max_mm:.4f}" in text
    assert f"nominal parameters: mean {nominal.mean_mm:.4f}" in text


@WORDS
def test_the_shipped_robot_is_found_again(word):
    member = MEMBER_OF[word]
    few, left, _ = made_for(word, member.nominal)
    assert max(each.max_mm for each in left.values()) < 1e-8
    assert few.radius_mm == pytest.approx(np.hypot(*member.nominal.p[:2]), abs=1e-7)


@WORDS
def test_other_mechanisms_are_refused_with_what_to_do(word):
    made, member = FORMATS[word], BY_NAME["i4l"]
    with pytest.raises(ConfigInvalid, match=f"is for a {made.mechanism}") as caught:
        few_parameters(member.shipped, member.shipped, member.poses(20), made)
    assert "pkmcal correct" in str(caught.value)


def settings(text):
    """Values of a configuration by section and key, or by pin."""
    found, section = {}, ""
    for line in text.splitlines():
        if line.startswith("["):
            section = line.strip("[]") + "."
        elif line.startswith("setp "):
            _, pin, value = line.split()
            found[pin] = float(value)
        elif pair := re.fullmatch(r"# \[JOINT_(\d)\]HOME_OFFSET: add (\S+) \S+ \(arm (\d)\)", line):
            found[f"joint{pair[1]}"] = (float(pair[2]), int(pair[3]))
        elif not line.startswith("#") and ":" in line:
            key, value = line.split(": ")
            found[section + key] = value if "kinematics" in key else float(value)
    return found


def spheres(centres, lengths, near):
    """Lower common point of three spheres, by an equation solver that is not ours."""

    def residual(point):
        return np.linalg.norm(centres - point, axis=1) - lengths

    return least_squares(residual, near, xtol=1e-15, ftol=1e-15, gtol=1e-15).x


def klipper_points(text, few):
    """Positions that Klipper believes in at the workspace's joints, from its documented keys."""
    found, points = settings(text), []
    steppers = [f"stepper_{each}." for each in "abc"]
    angles = np.radians([found[each + "angle"] for each in steppers])
    endstops = np.array([found[each + "position_endstop"] for each in steppers])
    outward = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(3)])
    up = np.array([0.0, 0.0, 1.0])
    rotary = "printer.shoulder_radius" in found
    if rotary:
        radius, height = found["printer.shoulder_radius"], found["printer.shoulder_height"]
        arms = np.array([found[each + "upper_arm_length"] for each in steppers])
        lengths = np.array([found[each + "lower_arm_length"] for each in steppers])
        at_endstop = [
            upward(radius, height, arm, length, endstop)
            for arm, length, endstop in zip(arms, lengths, endstops, strict=True)
        ]
    else:
        radius = found["printer.delta_radius"]
        lengths = np.array([found[each + "arm_length"] for each in steppers])
        at_endstop = endstops + np.sqrt(lengths**2 - radius**2)
    for joints, pose in zip(few.workspace.joints, few.workspace.poses, strict=True):
        moved = joints - few.endstop
        if rotary:
            spos = at_endstop - moved  # motors count arms upward, readings downward
            centres = outward * (radius + arms * np.cos(spos))[:, None]
            centres = centres + np.outer(height + arms * np.sin(spos), up)
        else:
            centres = radius * outward + np.outer(at_endstop + moved, up)
        points.append(spheres(centres, lengths, pose[:3] - [0.0, 0.0, few.bed_mm]))
    return np.array(points)


def upward(radius, height, arm, length, endstop):
    """Angle of an arm, positive upward, with the nozzle in the middle at some height."""

    def away(angle):
        out, up = radius + arm * np.cos(angle), height + arm * np.sin(angle)
        return np.hypot(out, up - endstop) - length

    angles = np.linspace(-1.6, 1.6, 2000)
    signs = np.sign([float(away(angle)) for angle in angles])
    last = int(np.flatnonzero(np.diff(signs))[-1])
    return brentq(away, angles[last], angles[last + 1], xtol=1e-14)


def mean_left_mm(points, few):
    wanted = few.workspace.poses[:, :3]
    return np.linalg.norm(fitted_frame(points, wanted).apply(points) - wanted, axis=1).mean()


@pytest.mark.parametrize("word", ["klipper-delta", "klipper-rotary-delta"])
def test_klipper_does_with_its_keys_what_was_promised(word):
    few, left, text = made_for(word, count=60)
    assert mean_left_mm(klipper_points(text, few), few) == pytest.approx(
        left["these values"].mean_mm, abs=2e-5
    )


@pytest.mark.parametrize(
    ("word", "name", "pins"),
    [
        (
            "linuxcnc-rotarydelta",
            "rotarydeltakins",
            ("platformradius", "thighlength", "shinlength", "footradius"),
        ),
        ("linuxcnc-lineardelta", "lineardeltakins", ("R", "L")),
    ],
)
@pytest.mark.parametrize("mirrored", [False, True])
def test_linuxcnc_does_with_its_pins_what_was_promised(word, name, pins, mirrored):
    kins = linuxcnc_module(name)
    member = MEMBER_OF[word]
    robot = clockwise(member.perturbed) if mirrored else member.perturbed
    shipped = member.shipped
    if mirrored:
        flat = clockwise(member.nominal).parameters
        shipped = RobotFile.of(member.mechanism, flat, name="m", limits=member.limits)
    identified = RobotFile.of(
        member.mechanism, robot.parameters, name="identified", limits=member.limits
    )
    poses = member.poses(100) * ([1.0, -1.0, 1.0] if mirrored else [1.0, 1.0, 1.0])
    few, left = few_parameters(identified, shipped, poses, FORMATS[word])
    text = configuration_text(few, left, FORMATS[word])
    found = settings(text)
    kins.set_geometry(*(found[f"{name}.{pin}"] for pin in pins))
    adds = [found[f"joint{joint}"] for joint in range(3)]
    to_file = member.mechanism.joints[0].to_file
    points = np.array(
        [
            kins.forward(*(to_file(float(joints[arm])) + add for add, arm in adds))
            for joints in few.workspace.joints
        ]
    )[:, :3]
    assert mean_left_mm(points, few) == pytest.approx(left["these values"].mean_mm, abs=2e-5)
    origin, turns = frame_in(text)
    rotation = Rotation.from_euler("ZYX", turns, degrees=True)
    seen = rotation.apply(points) + origin
    away = np.linalg.norm(seen - few.workspace.poses[:, :3], axis=1)
    assert away.mean() == pytest.approx(left["these values"].mean_mm, abs=1e-3)


def frame_in(text):
    """Frame that the heading tells."""
    number = r"(-?\d+\.\d+)"
    origin = re.search(rf"origin {number}, {number}, {number} mm", text)
    turns = re.search(
        rf"turned {number} deg about z, then {number} about y, then {number} about x", text
    )
    return tuple(np.array([float(each) for each in found.groups()]) for found in (origin, turns))


def clockwise(robot):
    """The same robot in a mirror: its arms follow each other the other way round."""
    p, space = robot.p.copy(), robot.mechanism.parameters
    for arm in range(3):
        p[space.places((f"arm{arm}.y_mm", f"arm{arm}.azimuth_deg"))] *= -1.0
    return Kinematics(robot.mechanism, p)


def linuxcnc_module(name):
    """LinuxCNC's own kinematics as Python module, where it is installed."""
    files = sorted(KINS.glob(f"{name}.cpython-*.so"))
    if not files:
        pytest.skip(f"LinuxCNC's {name} is not installed")
    spec = importlib.util.spec_from_file_location(name, files[0])
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module
