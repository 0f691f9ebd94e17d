"""The real LinuxCNC with four rotary joints: moved, stopped, and what goes wrong."""

import threading
import time
from contextlib import suppress
from math import degrees, radians

import linuxcnc_bench
import numpy as np
import pytest
from par4_space import par4

from drivers.errors import DeviceNotReady, EmergencyStop, LimitViolation, LinkDown, MotionFault
from drivers.values import Pose

pytestmark = linuxcnc_bench.NEEDS_LINUXCNC

READ_BACK_DEG = 1e-6
STOPS_WITHIN_S = 0.1
HOME_RAD = (0.0, 0.0, 0.0, 0.0)
FAR_RAD = tuple(map(radians, (60.0, 55.0, 50.0, 45.0)))


@pytest.fixture(scope="module")
def linuxcnc(tmp_path_factory):
    with linuxcnc_bench.world_controller(tmp_path_factory.mktemp("linuxcnc")) as running:
        yield running


@pytest.fixture
def bench(linuxcnc):
    """Ready, and with all faults taken away again."""
    with linuxcnc_bench.at(linuxcnc) as ready:
        ready.move(HOME_RAD)
        yield ready
        linuxcnc.hal("sets", "j2-ampfault", "0")
        linuxcnc.hal("sets", "ext-estop-ok", "1")
        linuxcnc.hal("setp", "stall.3.in", "0")


def test_joints_are_read_back_as_they_were_commanded(bench):
    state = bench.robot.state()
    assert (state.moving, state.fault, state.emergency_stop) == (False, "", False)
    assert bench.robot.identity().serial == "par4-prototype"
    draw, nominal = np.random.default_rng(7), linuxcnc_bench.NOMINAL
    poses = draw.uniform((-300.0, -300.0, -800.0, -0.5), (300.0, 200.0, -500.0, 0.5), (40, 4))
    model = par4(dict(nominal.parameters))
    poses = poses[model.feasibility(nominal.limits, poses).feasible][:8]
    for joints in model.inverse(poses).values_or_raise():
        state = bench.move(joints)
        assert state.fault == ""
        away_deg = np.degrees(np.abs(np.subtract(state.joints, joints))).max()
        assert away_deg <= READ_BACK_DEG


def test_speed_is_a_share_of_the_full_one(bench):
    began_s = time.monotonic()
    bench.move(FAR_RAD, 0.05)
    took_s = time.monotonic() - began_s
    at_least_s = 60.0 / (0.05 * linuxcnc_bench.FULL_SPEED_DEG_S)
    assert at_least_s - 0.05 < took_s < 2.0 * at_least_s


def test_target_beyond_linuxcncs_own_limits_is_refused_and_nothing_moves(linuxcnc, bench):
    linuxcnc.hal("setp", "ini.0.max_limit", "50")
    linuxcnc.hal("setp", "ini.x.max_limit", "200")
    try:
        with pytest.raises(LimitViolation, match=r"joint 0 to 60\.0000 deg, limits -46 to 50"):
            bench.robot.move_joints(FAR_RAD, 1.0)
        with pytest.raises(LimitViolation, match="would exceed X's positive limit"):
            bench.robot.move_pose(Pose(250.0, 0.0, -600.0, 0.0), 1.0)
    finally:
        linuxcnc.hal("setp", "ini.0.max_limit", "91")
        linuxcnc.hal("setp", "ini.x.max_limit", "600")
    assert np.degrees(bench.robot.state().joints) == pytest.approx(HOME_RAD, abs=READ_BACK_DEG)
    assert bench.move(tuple(map(radians, (10.0, 10.0, 10.0, 10.0)))).fault == ""


def test_targets_without_a_solution_are_refused(bench):
    with pytest.raises(LimitViolation, match="kinematicsInverse"):
        bench.robot.move_pose(Pose(0.0, 0.0, -1040.0, 0.0), 1.0)
    with pytest.raises(LimitViolation, match="cannot be assembled"):
        bench.robot.move_joints(tuple(map(radians, (60.0, -30.0, 45.0, 20.0))), 1.0)
    assert bench.move(FAR_RAD).fault == ""


def test_second_move_during_a_motion_is_refused(bench):
    bench.started(FAR_RAD, 0.1)
    with pytest.raises(DeviceNotReady, match="BUSY"):
        bench.robot.move_joints(HOME_RAD, 0.1)
    assert bench.arrived().joints == pytest.approx(FAR_RAD, abs=1e-6)


@pytest.mark.parametrize("from_another_connection", [False, True])
def test_stop_reaches_linuxcnc_within_a_tenth_of_a_second(linuxcnc, bench, from_another_connection):
    """Seen by the joints themselves: at 36°/s, a stop that is late shows as 3.6° more."""
    stopper = linuxcnc_bench.Bench(linuxcnc) if from_another_connection else bench
    stopper.robot.connect()
    bench.started(FAR_RAD, 0.1)
    before = bench.robot.state().joints
    stopper.robot.stop()
    stood = bench.robot.state()
    stopper.robot.close()
    moved_deg = degrees(max(np.abs(np.subtract(stood.joints, before))))
    assert moved_deg < 0.1 * linuxcnc_bench.FULL_SPEED_DEG_S * STOPS_WITHIN_S
    assert not stood.moving
    bench.robot.reconnect()
    assert bench.robot.state().joints == stood.joints
    assert bench.move(HOME_RAD).fault == ""


def test_stop_while_a_move_of_many_parts_is_being_sent_ends_it(linuxcnc, bench):
    stopper = linuxcnc_bench.Bench(linuxcnc)
    stopper.robot.connect()
    far = tuple(map(radians, (-34.5, -42.3, 89.9, 88.9)))

    def move():
        with suppress(MotionFault):
            bench.robot.move_joints(far, 0.05)

    sending = threading.Thread(target=move)
    sending.start()
    time.sleep(0.08)
    stopper.robot.stop()
    sending.join()
    stood = stopper.robot.state()
    stopper.robot.close()
    assert not stood.moving
    time.sleep(0.1)
    assert bench.robot.state().joints == stood.joints


def test_emergency_stop_in_motion_is_told_and_released_at_linuxcnc_alone(linuxcnc, bench):
    bench.started(FAR_RAD, 0.1)
    linuxcnc.hal("sets", "ext-estop-ok", "0")
    deadline_s = time.monotonic() + linuxcnc_bench.SEEN_WITHIN_S
    while not (state := bench.robot.state()).emergency_stop:
        assert time.monotonic() < deadline_s
    stand(bench)
    with pytest.raises(EmergencyStop):
        bench.robot.move_joints(FAR_RAD, 1.0)
    with pytest.raises(AssertionError, match="no released e-stop"):
        linuxcnc.make_ready()
    linuxcnc.hal("sets", "ext-estop-ok", "1")
    with pytest.raises((EmergencyStop, MotionFault)):
        bench.robot.move_joints(FAR_RAD, 1.0)
    linuxcnc.make_ready()
    assert bench.move(FAR_RAD).fault == ""
    assert state.emergency_stop


def test_drive_that_does_not_follow_is_a_following_error(linuxcnc, bench):
    bench.started(FAR_RAD, 0.1)
    linuxcnc.hal("setp", "stall.3.in", "1")
    assert "joint 3 following error" in bench.faulty().fault
    stand(bench)
    with pytest.raises(MotionFault, match="machine is off"):
        bench.robot.move_joints(FAR_RAD, 1.0)
    linuxcnc.hal("setp", "stall.3.in", "0")
    # switched off, the command follows the drive: on before it has caught up is an error again. No
    # pin shows when it has, and two readings of one may be of the same servo period.
    time.sleep(CATCHING_UP_S)
    linuxcnc.make_ready()
    assert bench.move(FAR_RAD).fault == ""


def test_drive_that_reports_a_fault_stops_everything_until_it_is_cleared(linuxcnc, bench):
    bench.started(FAR_RAD, 0.1)
    linuxcnc.hal("sets", "j2-ampfault", "1")
    assert "joint 2 amplifier fault" in bench.faulty().fault
    stand(bench)
    with pytest.raises(AssertionError, match="no machine"):
        linuxcnc.make_ready()
    linuxcnc.hal("sets", "j2-ampfault", "0")
    linuxcnc.make_ready()
    assert bench.move(FAR_RAD).fault == ""


CATCHING_UP_S = 0.2
"""Time in which LinuxCNC follows a drive that moves again: some cycles of its task, 10 ms each."""


def stand(bench):
    """Wait until nothing moves any more."""
    deadline_s = time.monotonic() + linuxcnc_bench.SEEN_WITHIN_S
    while bench.robot.state().moving:
        assert time.monotonic() < deadline_s


def test_motion_whose_client_is_lost_is_stopped_and_the_bridge_serves_the_next(linuxcnc, bench):
    bench.started(FAR_RAD, 0.05)
    bench.transports[-1].close()
    watcher = linuxcnc_bench.Bench(linuxcnc)
    watcher.robot.connect()
    stand(watcher)
    stood = watcher.robot.state()
    watcher.robot.close()
    assert degrees(max(np.abs(np.subtract(stood.joints, FAR_RAD)))) > 5.0
    with pytest.raises(LinkDown):
        bench.robot.state()
    bench.robot.reconnect()
    assert bench.robot.state().joints == stood.joints
    assert bench.move(HOME_RAD).fault == ""


def test_motion_whose_client_says_nothing_any_more_is_stopped(bench):
    """As after a cut cable, of which TCP tells nobody."""
    bench.started(FAR_RAD, 0.02)
    time.sleep(2.5)
    stood = bench.robot.state()
    assert not stood.moving
    assert degrees(max(np.abs(np.subtract(stood.joints, FAR_RAD)))) > 5.0
    assert bench.move(HOME_RAD).fault == ""


def test_stop_over_a_cut_connection_opens_another(bench):
    bench.started(FAR_RAD, 0.05)
    bench.transports[-1].close()
    bench.robot.stop()
    bench.robot.reconnect()
    assert degrees(max(np.abs(np.subtract(bench.robot.state().joints, FAR_RAD)))) > 5.0


def test_motion_that_is_stopped_at_linuxcnc_itself_is_a_fault(linuxcnc, bench):
    bench.started(FAR_RAD, 0.05)
    program = "import linuxcnc; linuxcnc.command().abort()"
    linuxcnc.run("/usr/bin/python3", "-c", program)
    assert "stands short of its target" in bench.faulty().fault
    bench.robot.stop()
    assert bench.move(HOME_RAD).fault == ""
