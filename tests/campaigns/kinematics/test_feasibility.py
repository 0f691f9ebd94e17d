"""Feasibility of poses: each violation is found, and described with value and limit."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import BY_NAME, closures_by_pose
from par4_cases import LIMITS, NOMINAL
from scipy.optimize import brentq

from campaigns.kinematics.feasibility import Violation, search_extent
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import find_robot

TURNED = np.array([[100.0, -150.0, -600.0, 0.5]])
"""Joints 13.8…60.9°, forearm 0 swings 31.8° out of its arm's plane."""
OUT_OF_REACH = np.array([[0.0, -50.0, -1300.0, 0.0]])


def told(limits, pose):
    return NOMINAL.feasibility(limits, pose).describe(0)


def violations(limits, pose):
    return Violation(int(NOMINAL.feasibility(limits, pose).violations[0]))


def turning(low_rad, high_rad):
    return (None, None, None, (low_rad, high_rad))


def test_a_pose_inside_every_limit_or_on_it_can_be_taken():
    assert violations(LIMITS, TURNED) is Violation.NONE
    assert told(LIMITS, TURNED) == []
    joints = NOMINAL.inverse(TURNED).values_or_raise()[0]
    limits = replace(
        LIMITS, joint=(joints.min(), joints.max()), task=turning(-1.0, float(TURNED[0, 3]))
    )
    assert violations(limits, TURNED) is Violation.NONE


def test_a_pose_out_of_reach_has_that_reason_and_no_measures():
    judged = NOMINAL.feasibility(LIMITS, OUT_OF_REACH)
    assert Violation(int(judged.violations[0])) is Violation.OUT_OF_REACH
    assert np.isnan([*judged.joints[0], *judged.margins.swing_rad[0]]).all()
    assert np.isnan([judged.margins.singular_value[0], judged.margins.elbow[0]]).all()
    (line,) = told(LIMITS, OUT_OF_REACH)
    assert line.startswith("out of reach")


def test_turns_coordinates_and_joints_beyond_limits_are_named_with_value_and_limit():
    joints_deg = np.degrees(NOMINAL.inverse(TURNED).values_or_raise()[0])
    largest = int(np.argmax(joints_deg))
    limits = replace(LIMITS, joint=(-np.pi / 4, np.radians(joints_deg[largest] - 1.0)))
    assert violations(limits, TURNED) is Violation.JOINT_LIMIT
    (line,) = told(limits, TURNED)
    assert line.startswith(f"joint {largest} at {joints_deg[largest]:.3f}° outside [-45°, ")
    limits = replace(LIMITS, task=turning(-0.1, np.radians(20.0)))
    assert violations(limits, TURNED) is Violation.TASK_LIMIT
    assert told(limits, TURNED) == ["theta 28.648° outside [-5.72958°, 20°]"]
    member = BY_NAME["delta"]
    limits = replace(member.limits, task=(None, None, (-700.0, -500.0)))
    judged = member.nominal.feasibility(limits, np.array([[-60.0, -300.0, -720.0]]))
    assert judged.describe(0) == ["z -720.000 mm outside [-700 mm, -500 mm]"]


def test_swing_is_named_where_it_is_too_far():
    swing_deg = np.degrees(NOMINAL.feasibility(LIMITS, TURNED).margins.swing_rad[0])
    worst = int(np.argmax(np.abs(swing_deg)))
    limits = replace(LIMITS, forearm_swing_rad=np.radians(np.sort(np.abs(swing_deg))[-2:].mean()))
    assert violations(limits, TURNED) is Violation.SWING_LIMIT
    (line,) = told(limits, TURNED)
    assert line.startswith(f"forearm {worst} swings {swing_deg[worst]:.2f}° out of its arm's plane")
    assert f"limit {np.degrees(limits.forearm_swing_rad):g}°" in line


@pytest.mark.parametrize("margin", ["singularity_margin", "elbow_margin"])
def test_too_small_a_margin_is_told_with_value_and_limit(margin):
    limits = replace(LIMITS, **{margin: 0.99})
    assert violations(limits, TURNED) is Violation.SINGULAR
    judged = NOMINAL.feasibility(LIMITS, TURNED)
    (line,) = told(limits, TURNED)
    assert (
        f"margin {judged.margins.singular_value[0]:.3f} (limit {limits.singularity_margin:g})"
        in line
    )
    assert f"elbow {judged.margins.elbow[0]:.3f} (limit {limits.elbow_margin:g})" in line


def test_the_margin_vanishes_where_the_assembly_could_turn_over():
    def by_pose(theta):
        pose = np.array([[0.0, -50.0, -575.0, theta]])
        joints = NOMINAL.inverse(pose).values_or_raise()
        return np.linalg.det(closures_by_pose(NOMINAL, joints, pose))[0]

    theta = brentq(by_pose, 1.5, 1.7, xtol=1e-14)
    singular = np.array([[0.0, -50.0, -575.0, theta]])
    wide = replace(LIMITS, task=turning(-2.0, 2.0), forearm_swing_rad=1.5)
    assert NOMINAL.feasibility(wide, singular).margins.singular_value[0] < 1e-9
    assert Violation.SINGULAR in violations(wide, singular)


@pytest.mark.parametrize("name", ["par4", "h4", "delta"])
def test_without_limits_of_the_turn_feasible_poses_are_those_that_assemble_there(name):
    member = BY_NAME[name]
    task = member.mechanism.task
    limits = replace(member.limits, task=(None,) * len(task))
    centre = member.shipped.workspace_centre
    half = search_extent(member.mechanism, member.nominal.p, member.limits, centre)
    half[3:] = np.pi
    poses = centre + half * np.random.default_rng(5).uniform(-1.0, 1.0, (4000, len(task)))
    judged = member.nominal.feasibility(limits, poses)
    taken = judged.feasible
    reached = member.nominal.forward(judged.joints[taken]).values_or_raise()
    assert np.abs(reached - poses[taken]).max() < 1e-6
    elsewhere = np.flatnonzero(judged.violations == Violation.OTHER_ASSEMBLY)
    assert bool(len(elsewhere)) == (len(task) > 3)
    for row in elsewhere[:3]:
        (line,) = judged.describe(row)
        assert line.startswith("another assembly: ")


def test_margins_of_a_delta_are_those_of_its_geometry():
    """Swing, singular value and elbow by hand, from elbows, forearms and crank directions."""
    member = BY_NAME["delta"]
    robot = member.perturbed
    poses = member.reachable_poses(robot, 300, seed=31)
    judged = robot.feasibility(member.limits, poses)
    arms = robot.p[:21].reshape(3, 7)
    angle, azimuth, up = judged.joints + arms[:, 4], arms[:, 3], np.array([0.0, 0.0, 1.0])
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(3)], axis=-1)
    axes = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(3)], axis=-1)
    cranks = np.cos(angle)[..., None] * outward - np.sin(angle)[..., None] * up
    forearms = poses[:, None] - arms[:, :3] - arms[:, 5, None] * cranks
    directions = forearms / np.linalg.norm(forearms, axis=-1, keepdims=True)
    lever = np.abs(np.sum(directions * np.cross(axes, cranks), axis=-1)).min(axis=1)
    singular = np.linalg.svd(directions, compute_uv=False)[:, -1]
    assert (
        np.abs(judged.margins.swing_rad - np.arcsin(np.sum(directions * axes, axis=-1))).max()
        < 1e-12
    )
    assert np.abs(judged.margins.elbow - lever).max() < 1e-12
    assert np.abs(judged.margins.singular_value - singular).max() < 1e-12


@pytest.mark.parametrize("name", ["linear-delta", "i4l"])
def test_a_carriage_beyond_its_rail_and_a_forearm_that_leans_too_far_are_told(name):
    member = BY_NAME[name]
    beyond = np.zeros((1, len(member.mechanism.task)))
    beyond[0, :3] = [0.0, 0.0, -1200.0]
    (first, *_) = member.nominal.feasibility(member.limits, beyond).describe(0)
    assert first.startswith("joint 0 at -")
    assert "mm outside [-450 mm, 450 mm]" in first
    beyond[0, 0] = 900.0
    (line,) = member.nominal.feasibility(member.limits, beyond).describe(0)
    assert line == "out of reach: a forearm cannot span from its carriage's rail to the plate"
    pose = member.shipped.workspace_centre[None]
    swing_rad = member.nominal.feasibility(member.limits, pose).margins.swing_rad[0, 0]
    radius_mm = float(np.hypot(*member.nominal.p[:2]))
    assert swing_rad == pytest.approx(np.arcsin(radius_mm / member.nominal.p[6]))
    narrow = replace(member.limits, forearm_swing_rad=0.9 * swing_rad)
    judged = member.nominal.feasibility(narrow, pose)
    assert Violation(int(judged.violations[0])) is Violation.SWING_LIMIT
    assert "away from its rail, limit" in judged.describe(0)[0]
    near = replace(member.limits, elbow_margin=0.999)
    assert "carriage 0." in member.nominal.feasibility(near, pose).describe(0)[0]


def test_a_platform_above_its_elbows_is_another_assembly():
    """Cranks can stand so that forearms reach up to it, but forward never gives that pose."""
    member, above = BY_NAME["i4r"], np.array([[-13.0, 23.3, 248.0, -0.5269]])
    judged = member.nominal.feasibility(member.limits, above)
    assert judged.describe(0) == ["another assembly: the platform would be above its elbows"]
    hung = member.nominal.forward(judged.joints, above)
    assert not hung.is_solved[0] or hung.values[0, 2] < -100.0


@pytest.mark.parametrize("name", ["par4-prototype", "delta", "linear-delta", "h4", "i4r", "i4l"])
def test_robot_of_another_size_and_the_same_shape_takes_the_same_poses(name):
    robot, times = find_robot(name).robot, 3.0
    space, rng = robot.mechanism.parameters, np.random.default_rng(1)
    sizes = {
        each: value * (times if space[each].unit == "mm" else 1.0)
        for each, value in robot.parameters.items()
    }
    joint = robot.mechanism.joints[0]
    scale = 1.0 if joint.is_revolute else times
    limits = replace(robot.limits, joint=tuple(scale * end for end in robot.limits.joint))
    centre = robot.workspace_centre
    extent = search_extent(robot.mechanism, robot.kinematics.p, robot.limits, centre)
    poses = centre + rng.uniform(-1.0, 1.0, (400, len(centre))) * extent
    wanted = robot.kinematics.feasibility(robot.limits, poses)
    poses[:, :3] *= times
    found = Kinematics.of(robot.mechanism, sizes).feasibility(limits, poses)
    assert 20 < wanted.feasible.sum() < 380
    assert found.violations.tolist() == wanted.violations.tolist()
    np.testing.assert_allclose(
        found.margins.singular_value, wanted.margins.singular_value, atol=1e-9
    )
