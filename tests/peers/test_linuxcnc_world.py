"""The real LinuxCNC with our kinematics: its own Cartesian moves, and parameters put into it."""

from contextlib import closing
from math import radians

import numpy as np
import pytest
from linuxcnc_bench import IDENTITY, NEEDS_LINUXCNC, NOMINAL, PIN_OF, Bench, at, world_controller
from par4_space import par4

from campaigns.controllers.active_kinematics import ActiveKinematics
from campaigns.controllers.linuxcnc_export import write_hal
from campaigns.controllers.load import write_verified
from drivers.errors import DeviceRefused, WrongDevice
from drivers.linuxcnc.settings import Coordinates
from drivers.values import Pose
from sim.robot.linuxcnc_joints import joint_source

pytestmark = NEEDS_LINUXCNC

SAME_DEG = 1e-6
WORLD = Coordinates.WORLD
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
    with at(linuxcnc, WORLD) as ready:
        yield ready
        ready.robot.write_geometry(OLD)


def reachable(count, geometry):
    poses = np.random.default_rng(8).uniform(LOW, HIGH, (20 * count, 4))
    judged = par4(geometry).feasibility(NOMINAL.limits, poses)
    return [Pose(*row) for row in poses[judged.feasible][:count].tolist()]


def away_deg(joints, other_rad):
    return np.degrees(np.abs(np.subtract(joints, other_rad))).max()


def test_poses_with_loaded_parameters_give_our_models_joints(bench):
    bench.robot.write_geometry(NEW)
    bench.robot.prepare()
    ours = ActiveKinematics(NOMINAL.mechanism, NEW)
    for pose in reachable(6, NEW):
        bench.robot.move_pose(pose, 1.0)
        state = bench.arrived()
        assert state.fault == ""
        assert away_deg(state.joints, ours.joints(pose)) <= SAME_DEG


def test_joints_are_reached_by_way_of_their_poses(bench):
    for pose in reachable(3, OLD):
        joints = ActiveKinematics(NOMINAL.mechanism, OLD).joints(pose)
        state = bench.move(joints)
        assert state.fault == ""
        assert away_deg(state.joints, joints) <= SAME_DEG


def test_way_along_the_joints_limits_does_not_leave_them(bench):
    """The straight line of poses between these two would take joint 1 to -72°."""
    there = tuple(map(radians, (41.3, -44.4, -24.4, 34.1)))
    back = tuple(map(radians, (-34.5, -42.3, 89.9, 88.9)))
    for joints in (there, back, there):
        state = bench.move(joints)
        assert state.fault == ""
        assert away_deg(state.joints, joints) <= SAME_DEG


def test_parameters_are_read_back_to_the_last_bit(bench):
    write_verified(bench.robot, NEW, OLD)
    assert bench.robot.read_geometry() == NEW
    assert bench.file.read() == NEW
    assert bench.robot.state().fault == "the machine is off"


def test_pins_are_never_set_with_the_machine_on(bench):
    with pytest.raises(DeviceRefused, match="machine is on"):
        bench.store.write(NEW)
    assert bench.robot.read_geometry() == OLD


def test_new_parameters_survive_a_restart(tmp_path):
    with world_controller(tmp_path) as linuxcnc, at(linuxcnc, WORLD) as bench:
        bench.robot.write_geometry(NEW)
        linuxcnc.restart()
        bench.robot.reconnect()
        assert bench.robot.read_geometry() == NEW
        bench.robot.prepare()
        assert bench.robot.state().fault == ""


def test_file_that_was_exchanged_under_a_running_linuxcnc_is_told(linuxcnc, bench):
    other = bench.file._whose.having(NEW, "new")
    write_hal(linuxcnc.config / "calib.hal", other, IDENTITY, overwrite=True)
    with pytest.raises(DeviceRefused, match="29 of 29 differ"):
        bench.robot.read_geometry()


def test_parameters_that_somebody_set_by_hand_are_not_taken_for_the_robots(linuxcnc, bench):
    bench.robot.write_geometry(OLD)  # which leaves the machine off
    linuxcnc.hal("setp", PIN_OF["arm0.arm_mm"], "360")
    with pytest.raises(DeviceRefused, match=r"arm0\.arm_mm = 360\.0.*1 of 29 differ"):
        bench.robot.prepare()
    bench.robot.close()
    bench.robot.connect()


def test_joints_of_the_simulated_cell_are_the_real_ones(linuxcnc, bench):
    joints = bench.move(tuple(map(radians, (20.0, 25.0, 30.0, 15.0)))).joints
    with closing(joint_source(f"hal:{linuxcnc.beside}")) as source:
        assert away_deg(source.read(), joints) <= SAME_DEG
    with closing(joint_source(linuxcnc.url)) as source:
        assert away_deg(source.read(), joints) <= SAME_DEG


def test_joints_only_controller_is_not_taken_for_one_in_world_coordinates(linuxcnc):
    bench = Bench(linuxcnc, Coordinates.JOINTS)
    bench.robot.connect()
    try:
        with pytest.raises(WrongDevice, match="XYZA"):
            bench.robot.prepare()
    finally:
        bench.robot.close()
