"""Robots in the real LinuxCNC: its own Deltas, and our kinematics of types without an example."""

from dataclasses import dataclass

import numpy as np
import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, at, world_controller
from linuxcnc_campaign import tell
from linuxcnc_instance import LinuxcncInstance
from par4_space import with_values

from campaigns.controllers.linuxcnc_export import write_hal
from campaigns.kinematics.parameters import Role
from campaigns.robots.robot import RobotFile, find_robot, pose_of

pytestmark = NEEDS_LINUXCNC

SAME = 1e-6
"""mm or deg."""
STRAINED = 5e-3
"""The same of four arms with imperfect parts, whose rods cannot all close."""
DECIMALS = 6
"""Of the poses as they are sent."""
CARRIAGES = [
    ("TYPE = ANGULAR", "TYPE = LINEAR"),
    ("MIN_LIMIT = -46", "MIN_LIMIT = -455"),
    ("MAX_LIMIT = 91", "MAX_LIMIT = 455"),
]


def reachable(robot, count, seed):
    """Poses well within the limits."""
    draw, (lowest, highest) = np.random.default_rng(seed), robot.limits.joint
    inner = robot.limits.narrowed_by(joint=0.1 * (highest - lowest))
    joints = draw.uniform(*inner.joint, (400 * count, len(robot.mechanism.joints)))
    found = robot.kinematics.forward(joints)
    poses = found.values[found.is_solved]
    poses = poses[robot.kinematics.feasibility(inner, poses).feasible]
    poses = poses[(np.abs(poses[:, 3:]) < 1.0).all(axis=1)][:count].round(DECIMALS)
    assert len(poses) == count
    return poses


def away(linuxcnc, robot, poses):
    """Where the joints have the robot stand, less where it was sent, in mm and deg."""
    found = []
    with linuxcnc, at(linuxcnc, robot_file=robot) as bench:
        for pose in poses:
            bench.robot.move_pose(pose_of(pose), 1.0)
            state = bench.arrived()
            assert state.fault == ""
            joints = np.array([state.joints])
            stood = robot.kinematics.forward(joints, near=pose[None]).values_or_raise()
            found.append(stood[0] - pose)
    return np.array(found) * [axis.to_file(1.0) for axis in robot.mechanism.task]


@dataclass(frozen=True)
class Oracle:
    """A kinematics of LinuxCNC's, its settings, and our robot of the same sizes."""

    module: str
    pins: dict[str, float]
    robot: RobotFile


def turned(name, first_deg):
    """A shipped robot with its first arm in another direction."""
    nominal = find_robot(name).robot
    flat = dict(nominal.parameters)
    turn = np.radians(first_deg - flat["arm0.azimuth_deg"])
    cos, sin = np.cos(turn), np.sin(turn)
    for arm in range(3):
        x, y = flat[f"arm{arm}.x_mm"], flat[f"arm{arm}.y_mm"]
        flat[f"arm{arm}.x_mm"], flat[f"arm{arm}.y_mm"] = cos * x - sin * y, sin * x + cos * y
        flat[f"arm{arm}.azimuth_deg"] += float(np.degrees(turn))
    return RobotFile.of(nominal.mechanism, flat, name=name, limits=nominal.limits)


def rotary():
    """LinuxCNC's first arm points to -y."""
    sizes = {"platformradius": 200.0, "thighlength": 300.0, "shinlength": 800.0, "footradius": 45.0}
    return Oracle("rotarydeltakins", sizes, turned("delta", -90.0))


def linear():
    """LinuxCNC's first tower stands at +y, as ours does."""
    return Oracle("lineardeltakins", {"R": 250.0, "L": 520.0}, find_robot("linear-delta").robot)


@pytest.mark.parametrize("oracle", [rotary(), linear()], ids=lambda oracle: oracle.module)
def test_linuxcncs_own_delta_stands_where_our_nominal_one_does(tmp_path, oracle, capsys):
    name = oracle.robot.mechanism.name
    edits = [(f"KINEMATICS = pkmkins type={name}", f"KINEMATICS = {oracle.module}")]
    linuxcnc = LinuxcncInstance(tmp_path / "world", name, edits=edits)
    pins = [f"setp {oracle.module}.{pin} {value}\n" for pin, value in oracle.pins.items()]
    (linuxcnc.config / "calib.hal").write_text("".join(pins))
    poses = reachable(oracle.robot, 25, seed=9)
    worst = np.abs(away(linuxcnc, oracle.robot, poses)).max()
    with capsys.disabled():
        tell(f"{oracle.module}: {len(poses)} poses, away by {worst:.1e} mm at most")
    assert worst <= SAME


@pytest.mark.long
@pytest.mark.parametrize("name", ["h4", "i4r", "i4l"])
def test_robot_stands_where_the_model_with_tilting_plate_has_it(tmp_path, name):
    nominal, draw = find_robot(name).robot, np.random.default_rng(2)
    extensions = nominal.mechanism.parameters.select(Role.EXTENSION)
    robot = with_values(nominal, {key: draw.normal(0.0, 0.05) for key in extensions})
    on_rails = not robot.mechanism.joints[0].is_revolute
    edits = [
        ("KINEMATICS = pkmkins type=par4", f"KINEMATICS = pkmkins type={name}"),
        ("MIN_LIMIT = -50", "MIN_LIMIT = -95"),
        ("MAX_LIMIT = 50", "MAX_LIMIT = 95"),
        *(CARRIAGES if on_rails else ()),
    ]
    linuxcnc = world_controller(tmp_path, edits=edits)
    write_hal(linuxcnc.config / "calib.hal", robot, name, overwrite=True)
    assert np.abs(away(linuxcnc, robot, reachable(robot, 5, seed=2))).max() <= STRAINED
