"""Types of our kinematics that have no example, in the real LinuxCNC, with plate tilt."""

from contextlib import closing

import numpy as np
import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, ForeignBench, ready, world_controller
from par4_space import with_values

from campaigns.controllers.linuxcnc_export import write_hal
from campaigns.robots.robot import find_robot, pose_of
from sim.geometry import KINDS
from sim.robot.linuxcnc_joints import joint_source

pytestmark = [*NEEDS_LINUXCNC, pytest.mark.long]

POSES = 5
DECIMALS = 6
SAME_MM = 1e-6
CARRIAGES = [
    ("TYPE = ANGULAR", "TYPE = LINEAR"),
    ("MIN_LIMIT = -46", "MIN_LIMIT = -455"),
    ("MAX_LIMIT = 91", "MAX_LIMIT = 455"),
]


@pytest.mark.parametrize("name", ["h4", "i4r", "i4l"])
def test_robot_stands_where_the_model_with_tilting_plate_has_it(tmp_path, name):
    nominal = find_robot(name).robot
    draw, space = np.random.default_rng(2), nominal.mechanism.parameters
    robot = with_values(nominal, {key: draw.normal(0.0, 0.05) for key in space.extensions})
    kinematics, on_rails = robot.kinematics, not robot.mechanism.joints[0].is_revolute
    edits = [
        ("KINEMATICS = pkmkins type=par4", f"KINEMATICS = pkmkins type={name}"),
        ("MIN_LIMIT = -50", "MIN_LIMIT = -95"),
        ("MAX_LIMIT = 50", "MAX_LIMIT = 95"),
        *(CARRIAGES if on_rails else ()),
    ]
    inner = robot.limits.drawn_in(joint=0.1 * (robot.limits.joint[1] - robot.limits.joint[0]))
    found = kinematics.forward(draw.uniform(*inner.joint, (400 * POSES, space.arms)))
    poses = found.values[found.found]
    poses = poses[kinematics.feasibility(inner, poses).feasible]
    poses = poses[np.abs(poses[:, 3]) < 1.0][:POSES].round(DECIMALS)
    assert len(poses) == POSES
    linuxcnc = world_controller(tmp_path, edits=edits)
    write_hal(linuxcnc.config / "calib.hal", robot, name, overwrite=True)
    speed_per_s = 500.0 if on_rails else np.radians(360.0)
    with (
        linuxcnc,
        ready(ForeignBench(linuxcnc, robot, speed_per_s)) as bench,
        closing(joint_source(f"hal:{linuxcnc.beside}", KINDS[name])) as joints,
    ):
        for pose in poses:
            bench.robot.move_pose(pose_of(pose), 1.0)
            assert bench.arrived().fault == ""
            stood = kinematics.forward(joints.read()[None], near=pose[None]).values_or_raise()[0]
            assert np.abs(stood - pose)[:3].max() <= SAME_MM
            assert abs(np.degrees(stood[3] - pose[3])) <= SAME_MM
