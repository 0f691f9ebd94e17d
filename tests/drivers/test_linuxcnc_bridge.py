"""LinuxCNC's bridge where there is no LinuxCNC: its lines, and its file of parameters."""

import re
import socket
from pathlib import Path
from threading import Thread
from types import SimpleNamespace

import pytest
from scripted_controller import checked
from timed_pipe import HandClock

from drivers import linuxcnc_bridge
from drivers.linuxcnc_bridge import ClientSession, ParameterPins, Refusal
from drivers.wire.robotline import grammar

FILE = Path(__file__).parents[2] / "examples/linuxcnc/cartesian/calib.hal"


class Machine:
    """Pins of a Par4 that a HAL file has set; the drives are off."""

    joints, letters, unit = range(4), "xyzc", "deg"

    def __init__(self, file, stuck=()):
        lines = [line.split() for line in file.read_text().splitlines()]
        self.held = {words[1]: float(words[2]) for words in lines if words[0] == "setp"}
        self.held |= {"pkmkins.arm0.axis_tilt_deg": 0.0, "motion.motion-enabled": 0.0}
        self.held |= {f"ini.{n}.backlash": 0.0 for n in range(4)}
        self.pins, self.stuck = set(self.held), stuck

    def get(self, pin):
        return self.held[pin]

    def put(self, pin, value):
        if pin not in self.stuck:
            self.held[pin] = value

    def is_moving(self):
        return False


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "calib.hal"
    path.write_text(FILE.read_text())
    return path


def whole(parameters, **changes):
    names = parameters.layout.parameters
    return {n: parameters._machine.get(f"pkmkins.{n}") for n in names} | changes


def test_new_set_is_at_work_and_in_the_file_and_set_again_at_the_next_start(file):
    parameters = ParameterPins(Machine(file), file)
    parameters.replace(whole(parameters, plate_mm=101.0) | {"arm1.backlash_deg": 0.005})
    parameters.check()
    assert parameters.robot() == "par4-prototype"
    started = Machine(file)
    again = ParameterPins(started, file)
    assert again.values("PLATE") == (101.0,)
    assert started.get("ini.1.backlash") == 0.005
    again.check()
    file.write_text(file.read_text().replace("setp ini.1.backlash", "[JOINT_1]BACKLASH ="))
    ParameterPins(Machine(file), file).check()
    assert "BACKLASH = 0.005" in file.read_text()


@pytest.mark.parametrize("stuck", [["pkmkins.plate_mm"], []], ids=["pin", "file"])
def test_set_that_cannot_be_put_to_work_or_kept_is_taken_back(file, stuck):
    machine, before = Machine(file, stuck), file.read_text()
    parameters, held = ParameterPins(machine, file), dict(machine.held)
    if not stuck:
        file.with_name("calib.hal.new").mkdir()
    with pytest.raises(Refusal, match="the old parameters are back"):
        parameters.replace(whole(parameters, plate_mm=101.0))
    with pytest.raises(Refusal, match="not positive: plate_mm"):
        parameters.replace(whole(parameters, plate_mm=0.0))
    assert (machine.held, file.read_text()) == (held, before)


def test_tilts_are_not_taken_where_nobody_knows_the_plates_drawing(file):
    assert "arm0.axis_tilt_deg" in ParameterPins(Machine(file), file).layout.extensions
    file.write_text(re.sub(r"setp pkmkins\.(arm\d\.plate|reflector).*\n", "", file.read_text()))
    assert "arm0.axis_tilt_deg" not in ParameterPins(Machine(file), file).layout.extensions


def test_lines_are_answered_as_the_page_says(file):
    """What is wrong with a line the grammar decides, with golden lines of its own."""
    machine = Machine(file)
    parameters = ParameterPins(machine, file)
    lines = grammar(parameters.layout)
    bridge = SimpleNamespace(machine=machine, parameters=parameters, grammar=lines)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        serving = Thread(target=ClientSession, args=(theirs, None, bridge))
        serving.start()
        for line in ("noise", ">1 HELLO 2", ">2 GEOM PLATE", ">3 ABANDON", ">4 WHO"):
            ours.sendall(checked(line))
        ours.sendall(b">5 STATE *0000\n")
        ours.shutdown(socket.SHUT_WR)
        serving.join()
        theirs.close()
        said = ours.recv(1000).decode().splitlines()
    expected = ("1 HELLO NO VERSION", "2 GEOM OK PLATE", "3 ABANDON OK", "4 ? NO VERB")
    for line, words in zip(said, (*expected, "5 ? NO CHECKSUM"), strict=True):
        assert line.startswith(f"<{words} ")


@pytest.fixture
def clock(monkeypatch):
    clock = HandClock()
    time = SimpleNamespace(monotonic=clock.now_s, sleep=clock.sleep_s)
    monkeypatch.setattr(linuxcnc_bridge, "time", time)
    return clock


class StandingMachine(linuxcnc_bridge.Machine):
    """A robot in position, with a servo thread of a slow or of no period."""

    letters, joints = "", range(2)

    def __init__(self, clock, cycle_s, moves=False):
        self._target = ()
        self.clock, self.cycle_s, self.moves = clock, cycle_s, moves

    def get(self, pin):
        cycle = self.clock.now_s() // self.cycle_s
        return cycle if pin == "servo-thread.time" or ("cmd" in pin and self.moves) else 1.0


def test_robot_stands_when_a_loaded_machine_delays_the_servo_thread(clock):
    assert not StandingMachine(clock, cycle_s=0.1).is_moving()
    StandingMachine(clock, cycle_s=0.4).require_standing()


def test_joints_that_still_follow_the_end_of_a_trajectory_are_moving(clock):
    assert StandingMachine(clock, cycle_s=0.01, moves=True).is_moving()


def test_robot_whose_servo_thread_is_dead_counts_as_moving(clock):
    machine = StandingMachine(clock, cycle_s=1e9)
    assert machine.is_moving()
    with pytest.raises(Refusal, match="realtime part is dead"):
        machine.require_standing()
