"""Bridge that speaks robotline (docs/reference/robotline.md) for the LinuxCNC on the same computer.

How to use it: docs/how-to/linuxcnc.md. It needs Python 3.11, this package `drivers` and LinuxCNC
2.9, nothing else. It imports LinuxCNC's modules `linuxcnc` and `hal` when it runs, and contains
nothing of them: Apache-2.0, like the rest of pkmcal.

LinuxCNC has two parts. The *task* interprets G-code and plans paths; the *realtime part* moves
joints in each cycle of its servo thread, and HAL shows its values as pins.

* Moves are G-code for the task, because only the task plans paths.
* Readings come from HAL. The task's copy of a position or state may be older than the motion that
  it has just accepted: a robot read there seems to stand before it has begun to move.
* Both parts may die while their last values stay readable. That the robot stands is therefore known
  only after further cycles of the servo thread, and an order counts only when the task has echoed
  it.
* STOP is never kept waiting: `Machine.stop` first ends the move that another client is sending.
* Parameters are pins of our kinematics pkmkins, and the HAL file that sets them at each start.
"""

import argparse
import math
import os
import re
import socketserver
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from drivers.values import Coordinate
from drivers.wire import robotline as wire
from drivers.wire.lines import Answer, BadQuestion, Hello, Nothing, Question, Refused

WATCHDOG_S = 2.0
"""A client that has said nothing for so long no longer watches the motion that it started."""
ARM_FIELDS = ["x_mm", "y_mm", "z_mm", "azimuth_deg", "elevation_deg"]
ARM_FIELDS += ["joint_offset_deg", "joint_offset_mm", "arm_mm", "forearm_mm"]
"""Parameters of a line `ARM i` in their order; a robot has seven of them."""
LENGTH = re.compile(r".*(\.arm|\.forearm|plate|pinion)_mm")
DRAWING = re.compile(r"pkmkins\.(arm\d\.(plate_[xyz]_mm|bar_azimuth_deg)|reflector_[xyz]_mm)")
"""Pins of the plate's drawing. The HAL file sets them: no client knows them."""
TILT = re.compile(
    r".*((axis_tilt|rail_tilt|skew|bar_turn)_deg|plate_joint_[xyz]_mm)|(sag|reflector)_.*"
)
"""Parameters that mean nothing without the drawing."""
SETTING = re.compile(r"(?m)^(?:# )?setp (\S+) ([0-9.e+-]+)$")
"""A line of the HAL file. It is read before the pins `ini.N.backlash` exist: these are comments for
the bridge, which sets them when it starts."""
PART = {"deg": 15.0, "mm": 100.0}
"""Travel of the longest joint in one straight part of a joint move. On a straight line of poses the
joints leave their own straight line by half a degree, or some millimetres, at most."""
POWER = "motion.motion-enabled"
FROZEN_AFTER_S = 1.5
DEAD = "dead task or realtime part; see that the robot stands, restart LinuxCNC"


class Refusal(Exception):
    """Answer NO: a code of docs/reference/robotline.md, and a text for people."""

    def __init__(self, code: str, text: str) -> None:
        super().__init__(text)
        self.code = code


class Machine:
    """The LinuxCNC that runs here: joints in deg or mm, coordinates in mm and deg.

    Several clients may call at once. `stop` waits for one order at most.
    """

    def __init__(self) -> None:
        # `Any`: LinuxCNC's modules have no types, and exist beside LinuxCNC only.
        self._linuxcnc, self._hal = import_module("linuxcnc"), import_module("hal")
        self._component = self._hal.component(f"robotline-{os.getpid()}")
        self._component.ready()
        self._status, self._command = self._linuxcnc.stat(), self._linuxcnc.command()
        self._errors = self._linuxcnc.error_channel()
        self._messages: list[str] = []
        # `_lock` keeps orders of several clients apart; `_stops` counts the stops ordered so far.
        self._lock, self._stops = threading.RLock(), 0
        # Where the move under way ends, by letter, as sent (6 decimals); empty without one.
        self._target: tuple[float, ...] = ()
        # The task's joint positions, and since when they have not changed.
        self._seen: tuple[float, ...] = ()
        self._changed_s = 0.0
        self._wait(lambda: bool(self._status.ini_filename), "LinuxCNC does not begin", 30.0)
        ini = self._linuxcnc.ini(self._status.ini_filename)
        self.model, self.firmware = ini.find("KINS", "KINEMATICS"), self._linuxcnc.version
        self.letters = "".join(ini.find("TRAJ", "COORDINATES").split()).lower()
        self.joints = range(self._status.joints)
        is_rotary = self._status.joint[0]["jointType"] == self._linuxcnc.ANGULAR
        self.unit = "deg" if is_rotary else "mm"
        self.pins: set[str] = {pin["NAME"] for pin in self._hal.get_info_pins()}

    def get(self, pin: str) -> float:
        """Read a pin."""
        return float(self._hal.get_value(pin))

    def put(self, pin: str, value: float) -> None:
        """Set a pin that nothing else writes."""
        self._hal.set_p(pin, repr(value))

    def state(self) -> wire.ControllerStatus:
        """Read the encoders, without LinuxCNC's own compensation of backlash, and what is wrong."""
        self._status.poll()
        self._collect_messages()
        moving = self.is_moving()
        fault, estop = self._find_fault(moving=moving), bool(self._status.estop)
        return wire.ControllerStatus(moving, estop, fault[:70], tuple(self._read_encoders()))

    def is_moving(self, patience_s: float = 0.3) -> bool:
        """Return whether anything moves or is short of its target, or nothing is known.

        Cycles of the servo thread may be late by `patience_s`: a loaded machine delays them. With
        the default, a client that waits for the end of a motion gets its answer in time.
        """
        # 1. The trajectory is at its target, and the realtime part in position; else it moves.
        # 2. Joints follow the trajectory some cycles late, and pins of a dead realtime part keep
        #    their last values. So two more cycles have to pass: without them it counts as moving.
        # 3. It stands if no joint was sent elsewhere in them.
        if not self.get(POWER):
            self._target = ()
        if not (self._is_at(self._target) and self.get("motion.in-position")):
            return True
        self._target = ()
        commands, give_up_s = self._read_motor_commands(), time.monotonic() + patience_s
        for _ in range(2):  # the first may end the cycle that gave these commands
            cycle_time = self.get("servo-thread.time")  # it measures each of its cycles
            while self.get("servo-thread.time") == cycle_time:
                if time.monotonic() > give_up_s:
                    return True
                time.sleep(0.0005)
        return bool(self.get(POWER)) and self._read_motor_commands() != commands

    def require_standing(self) -> None:
        """Refuse what a robot that moves must not do."""
        if self.is_moving(patience_s=1.0):
            raise Refusal("BUSY", "the robot moves, or its realtime part is dead")

    def require_ready(self) -> None:
        """Refuse a move for whatever is in its way, before anything is sent."""
        self._status.poll()
        if self._status.estop:
            raise Refusal("ESTOP", "the emergency stop is on")
        self._collect_messages()
        self._messages.clear()
        if fault := self._find_fault(moving=False):
            raise Refusal("FAULT", fault)
        self.require_standing()
        idle = self._linuxcnc.INTERP_IDLE  # which the task sees later than the realtime part
        self._wait(lambda: bool(self._status.interp_state == idle), "LinuxCNC is still at work")

    def move_joints(self, joints: Sequence[float], percent: float) -> float:
        """Start a move along the straight line of the joints; return its seconds.

        LinuxCNC plans in coordinates, so that pkmkins is asked for the poses of points on the line.
        """
        # The path that is planned is straight in coordinates, and curved for the joints. In short
        # parts, each to the pose of a point on the joints' line, the joints keep near that line.
        here, unit = self._read_encoders(), self.unit
        for n, joint in enumerate(joints):
            low, high = self.get(f"ini.{n}.min_limit"), self.get(f"ini.{n}.max_limit")
            if not low <= joint <= high:
                text = f"joint {n} to {joint:.4f} {unit}, limits {low:g} to {high:g}"
                raise Refusal("LIMIT", text)
        ways = [end - start for start, end in zip(here, joints, strict=True)]
        travel = max(map(abs, ways))
        count = max(1, math.ceil(travel / PART[unit]))
        poses = []
        for part in range(1, count + 1):
            point = [q + way * part / count for q, way in zip(here, ways, strict=True)]
            poses.append(self._pose_of(point, ways))
        slowest = min(self.get(f"ini.{n}.max_velocity") for n in self.joints)
        return self._start(poses, travel / slowest, percent)

    def move_pose(self, coordinates: Sequence[float], percent: float) -> float:
        """Start a move to a pose by LinuxCNC's own kinematics; return its seconds."""
        ways = zip(self.letters, self._read_place(), coordinates, strict=True)
        speeds = {letter: self.get(f"ini.{letter}.max_velocity") for letter in self.letters}
        fastest_s = max(abs(end - now) / speeds[letter] for letter, now, end in ways)
        return self._start([coordinates], fastest_s, percent)

    def stop(self) -> None:
        """Brake at once. A move that is just being started ends too."""
        # A move of several parts takes the lock for each part. Counted before the lock is taken,
        # this stop keeps the next part from being sent, and waits for one order of some 20 ms at
        # most.
        self._stops += 1
        with self._lock:
            self._order("abort")
            self._target = ()

    def switch_off(self) -> None:
        """Take the power off a robot that stands: changed parameters would make its joints jump."""
        # The realtime part computes joints from the pose in each cycle: with the power on, new
        # parameters would send them elsewhere within one cycle, without a ramp.
        self.require_standing()
        self._order("state", self._linuxcnc.STATE_OFF)
        self._wait(lambda: not self.get(POWER), "the machine stays on")

    def _order(self, name: str, *values: object) -> None:
        """Give the task an order and see that it has taken it, some 20 ms; raises `Refusal`."""
        # The task repeats the number of each order that it takes. A dead one leaves it as it was.
        with self._lock:
            getattr(self._command, name)(*values)
            self._status.poll()
            if self._status.echo_serial_number < self._command.serial:
                raise Refusal("FAULT", f"LinuxCNC takes no orders: {DEAD}")

    def _wait(self, is_so: Callable[[], bool], otherwise: str, within_s: float = 1.0) -> None:
        give_up_s = time.monotonic() + within_s
        while not is_so():
            if time.monotonic() > give_up_s:
                raise Refusal("FAULT", otherwise)
            time.sleep(0.001)
            self._status.poll()

    def _collect_messages(self) -> None:
        """Take the latest error messages. LinuxCNC gives each to one program only."""
        kinds = self._linuxcnc.NML_ERROR, self._linuxcnc.OPERATOR_ERROR
        while (message := self._errors.poll()) is not None:
            if message[0] in kinds:
                self._messages = [*self._messages, " ".join(message[1].split())][-5:]

    def _read_encoders(self) -> list[float]:
        motors = [f"joint.{n}.motor-" for n in self.joints]
        return [self.get(f"{motor}pos-fb") - self.get(f"{motor}offset") for motor in motors]

    def _read_motor_commands(self) -> list[float]:
        return [self.get(f"joint.{n}.motor-pos-cmd") for n in self.joints]

    def _read_place(self) -> list[float]:
        """Read where the trajectory is, by letter."""
        return [self.get(f"axis.{letter}.pos-cmd") for letter in self.letters]

    def _is_at(self, target: Sequence[float]) -> bool:
        """Return whether the trajectory has come to its target; True without one."""
        pairs = zip(target, self._read_place(), strict=False)
        return all(abs(end - now) <= 2e-6 for end, now in pairs)

    def _find_fault(self, *, moving: bool) -> str:
        """Return what is wrong, in LinuxCNC's words where it has any; empty for nothing."""
        # the task's copy of the positions: it stays the same where the task or realtime died
        seen, now_s = tuple(self._status.joint_actual_position), time.monotonic()
        if seen != self._seen or not moving:
            self._seen, self._changed_s = seen, now_s
        reason = "; ".join(self._messages)
        if not self.get(POWER):
            return reason or "the machine is off: switch it on at LinuxCNC"
        if not self.get("motion.is-all-homed"):
            return reason or "not homed: home all joints at LinuxCNC"
        if now_s - self._changed_s > FROZEN_AFTER_S:
            return reason or "stands short of its target: feed hold, or dead task or realtime part"
        if not moving:
            self._messages.clear()
        return reason

    def _pose_of(self, joints: Sequence[float], ways: Sequence[float]) -> list[float]:
        """Ask pkmkins for the pose of joints that are reached by these ways.

        With a backlash an encoder reads half of it beside its joint.
        """
        if "pkmkins.ask.number" not in self.pins:
            raise Refusal("FAULT", "no pkmkins here, or an older one: install it, restart LinuxCNC")
        # A question through pins: joints, then a number. The kinematics computes in its next cycle,
        # and repeats the number when the pose is there.
        for n, (joint, way) in enumerate(zip(joints, ways, strict=True)):
            play = math.copysign(0.5 * self.get(f"ini.{n}.backlash"), way)
            self.put(f"pkmkins.ask.joint{n}", joint - play)
        number = self.get("pkmkins.ask.answered") + 1.0
        self.put("pkmkins.ask.number", number)
        self._wait(lambda: self.get("pkmkins.ask.answered") == number, f"pkmkins is silent: {DEAD}")
        if not self.get("pkmkins.ask.found"):
            raise Refusal("REACH", "the robot cannot be assembled at these joints")
        return [self.get(f"pkmkins.ask.{letter}") for letter in self.letters]

    def _start(self, poses: Sequence[Sequence[float]], fastest_s: float, percent: float) -> float:
        """Send the parts of a move and see it begin; raises what LinuxCNC's refusal means."""
        seconds, stops = max(100.0 / percent * fastest_s, 0.05), self._stops
        if self._status.task_mode != self._linuxcnc.MODE_MDI:
            self._order("mode", self._linuxcnc.MODE_MDI)
        for pose in poses:
            words = " ".join(f"{a}{v:.6f}" for a, v in zip(self.letters, pose, strict=True))
            # inverse time (G93): a feed would not count the rotary letter
            block = f"G21 G90 G93 G53 G1 {words} F{60.0 * len(poses) / seconds:.6f}"
            with self._lock:
                # `stop` has counted itself before this lock: nothing is sent after it.
                if self._stops != stops:
                    raise Refusal("FAULT", "stopped meanwhile")
                self._target = tuple(round(value, 6) for value in poses[-1])
                self._order("mdi", block)
        try:
            self._wait(lambda: self._has_begun() or self._stops != stops, f"not begun: {DEAD}")
        except Refusal:
            self.stop()
            raise
        return seconds

    def _has_begun(self) -> bool:
        """Return whether a move is under way or over; raise `Refusal` if it was refused."""
        # The task accepts a line of G-code first and finds its target out of reach a moment later.
        self._collect_messages()
        if self._status.state == self._linuxcnc.RCS_ERROR and self._messages:
            text = "; ".join(self._messages)
            code = "LIMIT" if re.search("exceed|limit", text) else "FAULT"
            raise Refusal("REACH" if "kinematicsInverse" in text else code, text)
        return self._is_at(self._target) or self._status.interp_state != self._linuxcnc.INTERP_IDLE


class ParameterPins:
    """Parameters of pkmkins by name, and the HAL file, such as calib.hal, that keeps them."""

    def __init__(self, machine: Machine, path: Path) -> None:
        self._machine, self._path = machine, path
        arms, is_rotary = machine.joints, machine.unit == "deg"
        pins = {p for p in machine.pins if p.startswith("pkmkins.") and ".ask." not in p}
        self._drawing = set(filter(DRAWING.fullmatch, pins))
        # the drawing has pins of the names that the fitted place of the reflector has
        names = {pin: re.sub(r"^pkmkins\.(fitted\.)?", "", pin) for pin in pins - self._drawing}
        self._pins = {name: pin for pin, name in names.items()}
        if pins:
            backlashes = {f"arm{n}.backlash_{machine.unit}": f"ini.{n}.backlash" for n in arms}
            self._pins |= backlashes
            if not machine.get(POWER):
                self._set({name: self._kept().get(pin, 0.0) for name, pin in backlashes.items()})
        lines: list[tuple[str, int | None, str]] = [
            (f"arm{n}.{field}", n, field) for n in arms for field in ARM_FIELDS
        ]
        lines += [("plate_mm", None, "plate"), ("pinion_mm", None, "pinion")]
        lines = [line for line in lines if line[0] in self._pins]
        is_drawn = any(map(machine.get, self._drawing))
        extensions = sorted(self._pins.keys() - {name for name, _, _ in lines})
        self.layout = wire.RobotLayout.of(
            [Coordinate(f"q{n}", is_angle=is_rotary) for n in arms],
            [Coordinate(letter, is_angle=letter == "c") for letter in machine.letters],
            lines,
            [name for name in extensions if is_drawn or not TILT.fullmatch(name)],
        )

    def robot(self) -> str:
        """Return whose parameters the file holds."""
        return "".join(re.findall(r"(?m)^# robot:(.*)", self._text())).strip() or "unknown"

    def values(self, words: str) -> tuple[float, ...]:
        """Return the values of `ARM i`, `PLATE` or `NAME`."""
        return tuple(self._machine.get(self._pins[name]) for name in self.layout.names_of(words))

    def replace(self, staged: Mapping[str, float]) -> None:
        """Set all parameters and save them, or change nothing; the drives must be off."""
        wrong = sorted(self.layout.parameters - staged.keys())
        wrong += [n for n, value in staged.items() if LENGTH.fullmatch(n) and value <= 0.0]
        if wrong or not staged:
            raise Refusal("GEOMETRY", f"missing or not positive: {' '.join(wrong)}")
        # Pins first, then the file: if a pin refuses or the file cannot be written, the pins go
        # back before this raises, so that both still agree. Names that are not staged become 0.
        before = {name: self._machine.get(pin) for name, pin in self._pins.items()}
        try:
            self._set(dict.fromkeys(self._pins, 0.0) | dict(staged))
            self._keep(staged)
        except (OSError, Refusal) as error:
            self._set(before)
            raise Refusal("GEOMETRY", f"the old parameters are back: {error}") from error

    def check(self) -> None:
        """Raise `Refusal` where a restart of LinuxCNC would change parameters."""
        kept = self._kept()
        for name, pin in sorted(self._pins.items()):
            now, filed = self._machine.get(pin), kept.get(pin, 0.0)
            if now != filed:
                text = f"LinuxCNC works with {name} = {now!r}, {self._path.name} says {filed!r}"
                raise Refusal("FAULT", f"{text}: restart it, or load again")

    def _set(self, values: Mapping[str, float]) -> None:
        for name, value in values.items():
            self._machine.put(self._pins[name], value)
            if self._machine.get(self._pins[name]) != value:
                raise Refusal("GEOMETRY", f"{name} cannot be set")

    def _kept(self) -> dict[str, float]:
        """Read the values of the file by pin."""
        return {pin: float(value) for pin, value in SETTING.findall(self._text())}

    def _keep(self, values: Mapping[str, float]) -> None:
        """Replace the values in the file, whole; the drawing and whose robot it is stay."""
        pins = {pin: value for pin, value in self._kept().items() if pin in self._drawing}
        pins |= {self._pins[name]: value for name, value in values.items()}
        settings = [f"{'# ' * pin.startswith('ini.')}setp {pin} {v!r}" for pin, v in pins.items()]
        # Written beside and put in its place at once: a power loss leaves the old file or the new.
        new = self._path.with_name(f"{self._path.name}.new")
        new.write_text("\n".join([f"# robot: {self.robot()}", *settings, ""]), encoding="utf-8")
        new.replace(self._path)

    def _text(self) -> str:
        text = self._path.read_text(encoding="utf-8")
        # Earlier versions wrote backlashes in this form.
        return re.sub(r"\[JOINT_(\d)\]BACKLASH =", r"setp ini.\1.backlash", text)


class ClientSession(socketserver.BaseRequestHandler):
    """One client. Its staged parameters and the motion that it has started end with it."""

    server: "Bridge"

    def handle(self) -> None:
        """Answer lines until the client leaves; stop a motion that it has left under way."""
        self._staged: dict[str, float] = {}
        self._moves = False
        self.request.settimeout(WATCHDOG_S)
        lines = self.server.grammar.line_framer()
        try:
            while data := self._receive():
                for line in filter(None, lines.feed(data)):
                    if (answer := self._answer(line)) is not None:
                        self.request.sendall(self.server.grammar.encode_answer(answer))
        except OSError:
            pass  # the client has gone
        finally:
            self._stop_unwatched()

    def _receive(self) -> bytes:
        while True:
            try:
                return bytes(self.request.recv(4096))
            except TimeoutError:
                self._stop_unwatched()

    def _stop_unwatched(self) -> None:
        # The page: a robot whose client is lost, or silent for the watchdog's time, must stop.
        with suppress(Refusal):
            if self._moves and self.server.machine.is_moving():
                self.server.machine.stop()

    def _answer(self, line: bytes) -> Answer | None:
        try:
            question = self.server.grammar.decode_question(line)
            return Answer(question.number, question.verb, self._obey(question))
        except BadQuestion as bad:
            return bad.answer
        except Refusal as refusal:
            return Answer(question.number, question.verb, Refused(refusal.code, str(refusal)[:150]))

    def _obey(self, question: Question) -> object:
        """Do what a question asks for and return the body of the answer; raises `Refusal`."""
        machine, parameters = self.server.machine, self.server.parameters
        match question.body:
            case Hello(version):
                if version != wire.VERSION:
                    raise Refusal("VERSION", f"version {wire.VERSION} is spoken here")
                self._staged = {}
                who = machine.model, parameters.robot(), machine.firmware
                return wire.ControllerGreeting(1, "LinuxCNC", *who, len(machine.joints))
            case wire.MoveJoints(target, percent) | wire.MovePose(target, percent):
                machine.require_ready()
                parameters.check()
                self._moves = True
                is_joints = isinstance(question.body, wire.MoveJoints)
                move = machine.move_joints if is_joints else machine.move_pose
                return wire.MotionBegun(move(target, percent))
            case wire.ReadPart(name):
                return wire.Part(name, parameters.values(name))
            case wire.Part() as part:
                self._staged |= parameters.layout.flat(part)
                return Nothing()
        if question.verb == "STATE":
            return machine.state()
        if question.verb == "STOP":
            machine.stop()
            return Nothing()
        if question.verb == "COMMIT":
            machine.switch_off()
            parameters.replace(self._staged)
        self._staged = {}
        return Nothing()


class Bridge(socketserver.ThreadingTCPServer):
    """Serves robotline for as long as LinuxCNC runs."""

    allow_reuse_address = daemon_threads = True

    def __init__(self, address: tuple[str, int], file: Path) -> None:
        self.machine = Machine()
        self.parameters = ParameterPins(self.machine, file)
        self.grammar = wire.grammar(self.parameters.layout)
        super().__init__(address, ClientSession)


def main() -> None:
    """Serve until LinuxCNC ends, or this program is ended."""
    parser = argparse.ArgumentParser(
        description="Speaks robotline for the LinuxCNC that runs here."
    )
    parser.add_argument("-ini", help="given by LinuxCNC where this is its DISPLAY; not used")
    parser.add_argument("--port", type=int, default=5020)
    parser.add_argument("--host", default="127.0.0.1", help="0.0.0.0: for other computers too")
    parser.add_argument("--file", type=Path, default="calib.hal", help="keeps the parameters")
    options = parser.parse_args()
    Bridge((options.host, options.port), options.file).serve_forever()


if __name__ == "__main__":
    main()
