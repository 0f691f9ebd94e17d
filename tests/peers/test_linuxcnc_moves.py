"""The real LinuxCNC with four rotary joints: brought up, moved, stopped, and what goes wrong."""

import time
from math import degrees, radians

import linuxcnc_bench
import numpy as np
import pytest

from drivers.errors import EmergencyStop, LimitViolation, LinkDown, MotionFault, WrongDevice
from drivers.linuxcnc.settings import Coordinates

pytestmark = linuxcnc_bench.NEEDS_LINUXCNC

READ_BACK_DEG = 1e-6
HOME_RAD = (0.0, 0.0, 0.0, 0.0)
FAR_RAD = tuple(map(radians, (60.0, -30.0, 45.0, 20.0)))


@pytest.fixture(scope="module")
def linuxcnc(tmp_path_factory):
    with linuxcnc_bench.joints_controller(tmp_path_factory.mktemp("linuxcnc")) as running:
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
    assert bench.robot.identity().serial == "PAR4"
    draw = np.random.default_rng(7)
    for _ in range(8):
        joints = draw.uniform(radians(-45.0), radians(90.0), 4)
        state = bench.move(joints)
        assert state.fault == ""
        away_deg = np.degrees(np.abs(np.subtract(state.joints, joints))).max()
        assert away_deg <= READ_BACK_DEG


def test_speed_is_a_share_of_the_full_one(bench):
    began_s = time.monotonic()
    bench.move(FAR_RAD, 0.05)
    took_s = time.monotonic() - began_s
    at_least_s = radians(60.0) / (0.05 * linuxcnc_bench.FULL_SPEED_RAD_S)
    assert at_least_s - 0.05 < took_s < 2.0 * at_least_s


def test_target_beyond_linuxcncs_own_limit_is_refused_in_its_words(linuxcnc, bench):
    linuxcnc.hal("setp", "ini.x.max_limit", "50")
    try:
        with pytest.raises(LimitViolation, match="would exceed X's positive limit"):
            bench.robot.move_joints(FAR_RAD, 1.0)
    finally:
        linuxcnc.hal("setp", "ini.x.max_limit", "91")
    assert bench.move((radians(10.0), 0.0, 0.0, 0.0)).fault == ""


def test_stop_in_motion_brakes_at_once_and_the_robot_goes_on_afterwards(bench):
    bench.started(FAR_RAD, 0.1)
    began_s = time.monotonic()
    bench.robot.stop()
    assert time.monotonic() - began_s < 1.0
    stood = bench.robot.state()
    assert not stood.moving
    assert stood.joints != pytest.approx(FAR_RAD, abs=0.01)
    time.sleep(0.05)
    assert bench.robot.state().joints == stood.joints
    assert bench.move(HOME_RAD).fault == ""


def test_emergency_stop_in_motion_is_told_and_released_by_getting_ready_again(linuxcnc, bench):
    bench.started(FAR_RAD, 0.1)
    linuxcnc.hal("sets", "ext-estop-ok", "0")
    deadline_s = time.monotonic() + linuxcnc_bench.SEEN_WITHIN_S
    while not (state := bench.robot.state()).emergency_stop:
        assert time.monotonic() < deadline_s
    stand(bench)
    with pytest.raises(EmergencyStop):
        bench.robot.move_joints(FAR_RAD, 1.0)
    with pytest.raises(EmergencyStop, match="stays on"):
        bench.robot.prepare()
    linuxcnc.hal("sets", "ext-estop-ok", "1")
    bench.robot.prepare()
    assert bench.move(FAR_RAD).fault == ""
    assert state.emergency_stop


def test_drive_that_does_not_follow_is_a_following_error(linuxcnc, bench):
    bench.started(FAR_RAD, 0.1)
    linuxcnc.hal("setp", "stall.3.in", "1")
    state = faulty(bench)
    assert "joint 3 following error" in state.fault
    stand(bench)
    linuxcnc.hal("setp", "stall.3.in", "0")
    bench.robot.prepare()
    assert bench.move(FAR_RAD).fault == ""


def test_drive_that_reports_a_fault_stops_everything_until_it_is_cleared(linuxcnc, bench):
    bench.started(FAR_RAD, 0.1)
    linuxcnc.hal("sets", "j2-ampfault", "1")
    assert "joint 2 amplifier fault" in faulty(bench).fault
    with pytest.raises(MotionFault):
        bench.robot.prepare()
    linuxcnc.hal("sets", "j2-ampfault", "0")
    bench.robot.prepare()
    assert bench.move(FAR_RAD).fault == ""


def stand(bench):
    """Wait until nothing moves any more."""
    deadline_s = time.monotonic() + linuxcnc_bench.SEEN_WITHIN_S
    while bench.robot.state().moving:
        assert time.monotonic() < deadline_s


def faulty(bench):
    """Wait for a fault with its reason."""
    deadline_s = time.monotonic() + linuxcnc_bench.SEEN_WITHIN_S
    state = bench.robot.state()
    while not state.fault or state.fault == "the machine is off":
        assert time.monotonic() < deadline_s, state
        state = bench.robot.state()
    return state


def test_connection_that_is_cut_in_motion_leads_to_an_abort_first_of_all(bench):
    bench.started(FAR_RAD, 0.05)
    bench.transports[-1].close()
    with pytest.raises(LinkDown):
        bench.robot.state()
    bench.robot.reconnect()
    stood = bench.arrived()
    assert not stood.moving
    assert degrees(max(np.abs(np.subtract(stood.joints, FAR_RAD)))) > 5.0
    assert bench.move(HOME_RAD).fault == ""


def test_stop_over_a_cut_connection_opens_another(bench):
    bench.started(FAR_RAD, 0.05)
    bench.transports[-1].close()
    bench.robot.stop()
    bench.robot.reconnect()
    assert degrees(max(np.abs(np.subtract(bench.robot.state().joints, FAR_RAD)))) > 5.0


def test_abort_in_one_breath_with_the_greeting_stops_it_before_anything_is_read(bench):
    bench.started(FAR_RAD, 0.05)
    bench.transports[-1].close()
    bench.open().send(b"hello EMC pkmcal 1.1\nset enable EMCTOO\nset abort\n", 1.0)
    time.sleep(1.0)  # another client's question would get mixed up with these
    bench.transports[-1].close()
    watcher = linuxcnc_bench.Bench(bench.linuxcnc, Coordinates.JOINTS)
    places = []
    for _ in range(2):
        transport = watcher.open()
        transport.send(b"hello EMC watcher 1.1\nget joint_pos\n", 1.0)
        places.append(hear(transport, b"JOINT_POS").split(b"JOINT_POS")[-1].split()[:4])
        transport.close()
        time.sleep(0.2)
    assert places[0] == places[1]
    assert abs(float(places[0][0]) - degrees(FAR_RAD[0])) > 5.0
    bench.robot.connect()
    assert bench.move(HOME_RAD).fault == ""


def hear(transport, word):
    """Wait for an answer with the word: two clients' requests at once get mixed up."""
    said = b""
    deadline_s = time.monotonic() + linuxcnc_bench.SEEN_WITHIN_S
    while word not in said:
        assert time.monotonic() < deadline_s, said
        said += transport.receive(0.1)
    return said


def test_control_that_another_client_takes_is_told_and_taken_back_by_the_stop(linuxcnc, bench):
    bench.started(FAR_RAD, 0.05)
    other = linuxcnc_bench.Bench(linuxcnc, Coordinates.JOINTS)
    thief = other.open()
    for line in (b"hello EMC thief 1.0", b"set verbose on", b"set enable EMCTOO"):
        thief.send(line + b"\n", 1.0)
        hear(thief, b" ACK")
    thief.close()
    assert "another client" in faulty(bench).fault
    bench.robot.stop()
    assert bench.move(HOME_RAD).fault == ""


def test_wrong_password_is_the_wrong_device(linuxcnc):
    bench = linuxcnc_bench.Bench(linuxcnc, Coordinates.JOINTS, connect_password="wrong")
    with pytest.raises(WrongDevice, match="password"):
        bench.robot.connect()
