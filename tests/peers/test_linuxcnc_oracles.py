"""Our symmetrical Deltas against LinuxCNC's own kinematics of them."""

from contextlib import closing
from dataclasses import dataclass

import numpy as np
import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, ForeignBench, ready
from linuxcnc_campaign import tell
from linuxcnc_instance import LinuxcncInstance

from campaigns.robots.robot import RobotFile, find_robot, pose_of
from sim.geometry import KINDS
from sim.robot.linuxcnc_joints import joint_source

pytestmark = NEEDS_LINUXCNC

SAME_MM = 1e-6
POSES = 25
DECIMALS = 6
"""Of the poses as they are sent."""


@dataclass(frozen=True)
class Oracle:
    """A kinematics of LinuxCNC's, its settings, and our robot of the same sizes."""

    module: str
    pins: dict[str, float]
    robot: RobotFile
    full_speed_per_s: float


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
    return Oracle("rotarydeltakins", sizes, turned("delta", -90.0), np.radians(360.0))


def linear():
    """LinuxCNC's first tower stands at +y, as ours does."""
    return Oracle(
        "lineardeltakins", {"R": 250.0, "L": 520.0}, find_robot("linear-delta").robot, 1e3
    )


@pytest.mark.parametrize("oracle", [rotary(), linear()], ids=["rotarydeltakins", "lineardeltakins"])
def test_linuxcncs_own_delta_stands_where_our_nominal_one_does(tmp_path, oracle, capsys):
    robot = oracle.robot
    name, kinematics = robot.mechanism.name, robot.kinematics
    edits = [(f"KINEMATICS = pkmkins type={name}", f"KINEMATICS = {oracle.module}")]
    linuxcnc = LinuxcncInstance(tmp_path / "world", name, edits=edits)
    pins = [f"setp {oracle.module}.{pin} {value}\n" for pin, value in oracle.pins.items()]
    (linuxcnc.config / "calib.hal").write_text("".join(pins))
    draw = np.random.default_rng(9)
    found = kinematics.forward(draw.uniform(*robot.limits.joint, (20 * POSES, 3)))
    poses = found.values[found.found]
    inner = robot.limits.drawn_in(joint=0.05 * (robot.limits.joint[1] - robot.limits.joint[0]))
    poses = poses[kinematics.feasibility(inner, poses).feasible][:POSES].round(DECIMALS)
    assert len(poses) == POSES
    away_mm = []
    with (
        linuxcnc,
        ready(ForeignBench(linuxcnc, robot, oracle.full_speed_per_s)) as bench,
        closing(joint_source(f"hal:{linuxcnc.beside}", KINDS[name])) as joints,
    ):
        for pose in poses:
            bench.robot.move_pose(pose_of(pose), 1.0)
            assert bench.arrived().fault == ""
            stood = kinematics.forward(joints.read()[None], near=pose[None]).values_or_raise()
            away_mm.append(np.abs(stood[0] - pose).max())
    with capsys.disabled():
        tell(f"{oracle.module}: {POSES} poses, away by {max(away_mm):.1e} mm at most")
    assert max(away_mm) <= SAME_MM
