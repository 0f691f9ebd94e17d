"""The real LinuxCNC with our kinematics: its own Cartesian moves, and parameters put into it."""

import numpy as np
import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, NOMINAL, at, world_controller
from par4_space import par4

from campaigns.controllers.load import write_verified
from drivers.errors import DeviceNotReady, MotionFault
from drivers.values import Pose

pytestmark = NEEDS_LINUXCNC

SAME_DEG = 1e-6
PLAY_LEFT_DEG = 0.002
"""So far LinuxCNC itself stays short where it compensates a backlash."""
OLD = dict(NOMINAL.parameters)
NEW = {name: value + 0.1 + 0.01 * place for place, (name, value) in enumerate(OLD.items())}
LOW = np.array([-520.0, -550.0, -990.0, -np.pi / 4])
HIGH = np.array([520.0, 450.0, -270.0, np.pi / 4])


@pytest.fixture(scope="module")
def linuxcnc(tmp_path_factory):
    with world_controller(tmp_path_factory.mktemp("linuxcnc")) as running:
        yield running


@pytest.fixture
def bench(linuxcnc):
    with at(linuxcnc) as ready:
        yield ready
        ready.robot.write_geometry(OLD)


def reachable(count, geometry):
    poses = np.random.default_rng(8).uniform(LOW, HIGH, (20 * count, 4))
    judged = par4(geometry).feasibility(NOMINAL.limits, poses)
    return poses[judged.feasible][:count]


def away_deg(joints, other_rad):
    return np.degrees(np.abs(np.subtract(joints, other_rad))).max()


def test_poses_with_loaded_parameters_give_our_models_joints(linuxcnc, bench):
    bench.robot.write_geometry(NEW)
    linuxcnc.make_ready()
    for pose in reachable(6, NEW):
        bench.robot.move_pose(Pose(*pose.tolist()), 1.0)
        state = bench.arrived()
        assert state.fault == ""
        ours = par4(NEW).inverse(pose[None]).values_or_raise()[0]
        assert away_deg(state.joints, ours) <= SAME_DEG


def test_way_of_a_joint_move_is_the_straight_line_of_its_joints(bench):
    """The straight line of poses between these two would take joint 1 to -72°."""
    there = np.radians((41.3, -44.4, -24.4, 34.1))
    back = np.radians((-34.5, -42.3, 89.9, 88.9))
    bench.robot.move_pose(Pose(0.0, -50.0, -371.0, 0.0), 1.0)
    assert bench.arrived().fault == ""
    assert bench.move(there).fault == ""
    for start, end in ((there, back), (back, there)):
        bench.robot.move_joints(end, 0.2)
        length, off_rad = np.linalg.norm(end - start), []
        while (state := bench.robot.state()).moving:
            along = (state.joints - start) @ (end - start) / length**2
            off_rad.append(np.abs(start + along * (end - start) - state.joints).max())
        assert state.fault == ""
        assert away_deg(state.joints, end) <= SAME_DEG
        assert len(off_rad) > 20
        assert np.degrees(max(off_rad)) < 0.7


def test_parameters_are_read_back_to_the_last_bit(bench):
    write_verified(bench.robot, NEW, OLD)
    assert bench.robot.read_geometry() == NEW
    assert bench.kept() == NEW
    assert "machine is off" in bench.robot.state().fault


def test_pins_are_never_set_in_motion(bench):
    bench.robot.move_pose(Pose(0.0, 0.0, -600.0, 0.0), 0.05)
    with pytest.raises(DeviceNotReady, match="the robot moves"):
        bench.robot.write_geometry(NEW)
    bench.robot.stop()
    assert bench.robot.read_geometry() == OLD


def test_new_parameters_survive_a_restart(tmp_path):
    tilted = NEW | {"arm1.axis_tilt_deg": 0.02, "arm2.backlash_deg": 0.005}
    with world_controller(tmp_path) as linuxcnc, at(linuxcnc) as bench:
        bench.robot.write_geometry(tilted)
        linuxcnc.restart()
        bench.robot.reconnect()
        assert bench.robot.read_geometry() == tilted
        linuxcnc.make_ready()
        assert bench.robot.state().fault == ""


def test_file_that_was_exchanged_under_a_running_linuxcnc_is_told(linuxcnc, bench):
    file = linuxcnc.config / "calib.hal"
    before = file.read_text()
    file.write_text(before.replace("arm0.arm_mm 350.0", "arm0.arm_mm 351.0"))
    with pytest.raises(MotionFault, match=r"arm0\.arm_mm = 350\.0, calib\.hal says 351\.0"):
        bench.robot.move_joints((0.0, 0.0, 0.0, 0.0), 1.0)
    file.write_text(before)


def test_parameters_that_somebody_set_by_hand_are_not_taken_for_the_robots(linuxcnc, bench):
    bench.robot.write_geometry(OLD)  # which leaves the machine off
    linuxcnc.hal("setp", "pkmkins.arm0.arm_mm", "360")
    linuxcnc.make_ready()
    with pytest.raises(MotionFault, match=r"arm0\.arm_mm = 360\.0, calib\.hal says 350\.0"):
        bench.robot.move_pose(Pose(0.0, 0.0, -600.0, 0.0), 1.0)


def test_backlash_is_linuxcncs_own_and_readings_are_the_encoders(linuxcnc, bench):
    play_deg = 0.2
    bench.robot.write_geometry(OLD | {"arm2.backlash_deg": play_deg})
    assert float(linuxcnc.hal("getp", "ini.2.backlash")) == play_deg
    linuxcnc.make_ready()
    for joints in (np.radians((30.0, 30.0, 30.0, 30.0)), np.radians((20.0, 20.0, 20.0, 20.0))):
        assert away_deg(bench.move(joints).joints, joints) <= PLAY_LEFT_DEG
    assert float(linuxcnc.hal("getp", "joint.2.pos-fb")) == pytest.approx(20.1, abs=PLAY_LEFT_DEG)
