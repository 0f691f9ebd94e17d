#!/usr/bin/python3
"""Bridge that speaks robotline (docs/robotline.md) for the LinuxCNC on the same computer.

To be copied alone: it needs LinuxCNC 2.9 and its Python, no other file and no other package.
docs/linuxcnc.md says how to start it. It imports LinuxCNC's modules `linuxcnc` and `hal` when it
runs, and contains nothing of them: Apache-2.0, like the rest of pkmcal.

Moves are G-code for LinuxCNC's task, because only the task plans paths. What the task says of a
motion may be older than the motion, so that all readings come from HAL, from the realtime part
itself. Parameters are the pins of our kinematics pkmkins and the HAL file that sets them.
"""

import argparse
import math
import os
import re
import socketserver
import threading
import time
from binascii import crc_hqx
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from urllib.parse import quote

LINE_BYTES = 255
NUMBERED = rb">([1-9][0-9]{0,8})"
LINE = re.compile(rb"(" + NUMBERED + rb"((?: [!-~]+)+)) \*([0-9A-F]{4})")
NUMBER = re.compile(r"-?[0-9]+\.[0-9]+([eE][+-]?[0-9]{1,3})?")
UNQUOTED = "".join(chr(code) for code in range(0x21, 0x7F) if chr(code) != "%")
WATCHDOG_S = 2.0
"""A client that has said nothing for so long no longer watches the motion that it started."""
ARM_FIELDS = ["x_mm", "y_mm", "z_mm", "azimuth_deg", "elevation_deg"]
ARM_FIELDS += ["joint_offset_deg", "joint_offset_mm", "arm_mm", "forearm_mm"]
"""Parameters of a line `ARM i` in their order; a robot has seven of them."""
LENGTH = re.compile(r".*(\.arm|\.forearm|plate|pinion)_mm")
DRAWING = re.compile(r"pkmkins\.(arm\d\.(plate_[xyz]_mm|bar_azimuth_deg)|reflector_[xyz]_mm)")
"""Pins of the plate's drawing. The HAL file sets them: no client knows them."""
TILT = re.compile(r".*(axis_tilt|rail_tilt|skew|bar_turn)_deg|sag_.*")
"""Parameters that mean nothing without the drawing."""
SETTING = re.compile(r"(?:# )?setp (\S+) (-?[0-9.e+-]+)")
"""A line of the HAL file. It is read before the pins `ini.N.backlash` exist: these are comments for
the bridge, which sets them when it starts."""
SAME_PLACE = 2e-6
"""mm or deg: targets are sent with six decimals."""
PART = {"deg": 15.0, "mm": 100.0}
"""Travel of the longest joint in one straight part of a joint move. On a straight line of poses the
joints leave their own straight line by half a degree, or some millimetres, at most."""
FROZEN_AFTER_S = 1.5
DEAD = "dead task or realtime part; see that the robot stands, restart LinuxCNC"


class Refusal(Exception):
    """Answer NO: a code of docs/robotline.md, and a text for people."""

    def __init__(self, code: str, text: str = "") -> None:
        super().__init__(text)
        self.code = code


class LinuxCnc:
    """The running LinuxCNC: orders to its task, values and messages from it."""

    def __init__(self) -> None:
        # Any: LinuxCNC's modules have no types, and exist beside LinuxCNC only
        self.constants, self._hal = import_module("linuxcnc"), import_module("hal")
        self._component = self._hal.component(f"robotline-{os.getpid()}")
        self._component.ready()
        self.status, self._command = self.constants.stat(), self.constants.command()
        self._errors = self.constants.error_channel()
        self.status.poll()
        self.wait(lambda: bool(self.status.ini_filename), "LinuxCNC does not begin", 30.0)
        ini = self.constants.ini(self.status.ini_filename)
        self.kinematics: str = ini.find("KINS", "KINEMATICS")
        self.letters = "".join(ini.find("TRAJ", "COORDINATES").split()).lower()
        self.joints = range(self.status.joints)
        is_rotary = self.status.joint[0]["jointType"] == self.constants.ANGULAR
        self.unit = "deg" if is_rotary else "mm"
        self.pins: set[str] = {pin["NAME"] for pin in self._hal.get_info_pins()}
        self.messages: list[str] = []
        self.lock = threading.RLock()
        """Held while an order is given, and for what must be done in one piece with it."""

    def get(self, pin: str) -> float:
        """Read a pin."""
        return float(self._hal.get_value(pin))

    def put(self, pin: str, value: float) -> None:
        """Set a pin that nothing else writes."""
        self._hal.set_p(pin, repr(value))

    def order(self, name: str, *values: object) -> None:
        """Give the task an order and see that it has taken it, some 20 ms; raises `Refusal`."""
        with self.lock:
            getattr(self._command, name)(*values)
            self.status.poll()
            if self.status.echo_serial_number < self._command.serial:
                raise Refusal("FAULT", f"LinuxCNC takes no orders: {DEAD}")

    def wait(self, is_so: Callable[[], bool], otherwise: str, within_s: float = 1.0) -> None:
        """Wait until something is so; raises `Refusal`."""
        give_up_s = time.monotonic() + within_s
        while not is_so():
            if time.monotonic() > give_up_s:
                raise Refusal("FAULT", otherwise)
            time.sleep(0.001)
            self.status.poll()

    def collect_messages(self) -> None:
        """Take the latest error messages. LinuxCNC gives each to one program only."""
        kinds = self.constants.NML_ERROR, self.constants.OPERATOR_ERROR
        while (message := self._errors.poll()) is not None:
            if message[0] in kinds:
                self.messages = [*self.messages, " ".join(message[1].split())][-5:]

    def has_power(self) -> bool:
        """Whether the drives are on."""
        return bool(self.get("motion.motion-enabled"))

    def realtime_runs(self) -> bool:
        """Whether the servo thread's measure of its own time still changes."""
        first = self.get("servo-thread.time")
        for _ in range(20):
            time.sleep(0.002)
            if self.get("servo-thread.time") != first:
                return True
        return False


class Parameters:
    """Pins of the parameters, and the HAL file, such as calib.hal, that keeps their values."""

    def __init__(self, cnc: LinuxCnc, path: Path) -> None:
        self._cnc, self._path = cnc, path
        self._drawing = set(filter(DRAWING.fullmatch, cnc.pins))
        pins = {pin for pin in cnc.pins if pin.startswith("pkmkins.") and ".ask." not in pin}
        backlashes = {f"ini.{joint}.backlash" for joint in cnc.joints if pins}
        self._pins = (pins - self._drawing) | backlashes
        fields = (*ARM_FIELDS, "plate_mm", "pinion_mm")
        self._required = {pin for pin in self._pins if pin.rpartition(".")[2] in fields}
        if not cnc.has_power():
            kept = self._kept()
            self._set({pin: kept.get(pin, 0.0) for pin in backlashes})

    def robot(self) -> str:
        """Return whose parameters the file holds."""
        names = [line.removeprefix("# robot:") for line in self._lines() if "# robot:" in line]
        return "".join(names).strip() or "unknown"

    def line(self, words: str) -> dict[str, float]:
        """Return the values of `ARM i`, `PLATE` or `NAME` by pin; raises `Refusal`."""
        arm = words.removeprefix("ARM ")
        pins = [f"pkmkins.{words if words != words.upper() else words.lower() + '_mm'}"]
        if arm != words:
            pins = [f"pkmkins.arm{arm}.{field}" for field in ARM_FIELDS]
        elif ".backlash_" in words:
            pins = [f"ini.{words[3]}.backlash"]
        values = {pin: self._cnc.get(pin) for pin in pins if pin in self._pins}
        is_drawn = any(map(self._cnc.get, self._drawing))
        if not values or (TILT.fullmatch(words) and not is_drawn):
            raise Refusal("ARGUMENT", f"LinuxCNC has no parameter {words}")
        return values

    def replace(self, staged: Mapping[str, float]) -> None:
        """Put a whole set to work and keep it, or nothing; the drives must be off."""
        lengths = {pin: value for pin, value in staged.items() if LENGTH.fullmatch(pin)}
        wrong = [*(self._required - staged.keys()), *(p for p, v in lengths.items() if v <= 0.0)]
        if wrong or not staged:
            raise Refusal("GEOMETRY", f"missing or not positive: {' '.join(sorted(wrong))}")
        before = {pin: self._cnc.get(pin) for pin in self._pins}
        try:
            self._set(dict.fromkeys(self._pins, 0.0) | dict(staged))
            self._keep(staged)
        except (OSError, Refusal) as error:
            self._set(before)
            raise Refusal("GEOMETRY", f"the old parameters are back: {error}") from error

    def check(self) -> None:
        """Raise `Refusal` where a restart of LinuxCNC would change parameters."""
        kept = self._kept()
        for pin in sorted(self._pins):
            now, filed = self._cnc.get(pin), kept.get(pin, 0.0)
            if now != filed:
                text = f"LinuxCNC works with {pin} = {now!r}, {self._path.name} says {filed!r}"
                raise Refusal("FAULT", f"{text}: restart it, or load again")

    def _set(self, values: Mapping[str, float]) -> None:
        for pin, value in values.items():
            self._cnc.put(pin, value)
            if self._cnc.get(pin) != value:
                raise Refusal("GEOMETRY", f"{pin} cannot be set")

    def _kept(self) -> dict[str, float]:
        settings = filter(None, map(SETTING.fullmatch, self._lines()))
        return {setting[1]: float(setting[2]) for setting in settings}

    def _keep(self, values: Mapping[str, float]) -> None:
        """Replace the values in the file, whole; the drawing and whose robot it is stay."""
        drawing = {pin: value for pin, value in self._kept().items() if pin in self._drawing}
        lines = [line for line in self._lines() if line.startswith("# robot:")]
        for pin, value in {**drawing, **values}.items():
            lines.append(f"{'# ' if pin.startswith('ini.') else ''}setp {pin} {value!r}")
        new = self._path.with_name(f"{self._path.name}.new")
        new.write_text("\n".join([*lines, ""]), encoding="utf-8")
        new.replace(self._path)

    def _lines(self) -> list[str]:
        return self._path.read_text(encoding="utf-8").splitlines()


class Motion:
    """Moves and stops; joints in deg or mm, coordinates in mm and deg.

    Several clients may call at once. `stop` waits for one order at most.
    """

    def __init__(self, cnc: LinuxCnc, parameters: Parameters) -> None:
        self._cnc, self._parameters = cnc, parameters
        self._stops = 0
        self._target: tuple[float, ...] = ()
        self._seen: tuple[float, ...] = ()
        self._changed_s = 0.0

    def state(self) -> tuple[object, ...]:
        """Return moving, emergency stop, fault and encoders."""
        self._cnc.status.poll()
        self._cnc.collect_messages()
        moving = self.is_moving()
        fault = self._fault(moving=moving)
        return moving, bool(self._cnc.status.estop), fault, *self._encoders()

    def is_moving(self) -> bool:
        """Whether anything moves, or still has to come to its target, or nothing can tell."""
        if not self._cnc.has_power():
            self._target = ()
        if not (self._is_at(self._target) and self._cnc.get("motion.in-position")):
            return True
        self._target = ()
        return not self._cnc.realtime_runs()

    def to_joints(self, joints: Sequence[float], percent: float) -> float:
        """Start a move along the straight line of the joints; return its seconds.

        LinuxCNC plans in coordinates, so that pkmkins is asked for the poses of points on the line.
        """
        self._require_ready()
        get, here, unit = self._cnc.get, self._encoders(), self._cnc.unit
        for n, joint in enumerate(joints):
            low, high = get(f"ini.{n}.min_limit"), get(f"ini.{n}.max_limit")
            if not low <= joint <= high:
                raise Refusal(
                    "LIMIT", f"joint {n} to {joint:.4f} {unit}, limits {low:g} to {high:g}"
                )
        ways = [there - q for q, there in zip(here, joints, strict=True)]
        travel = max(map(abs, ways))
        count = max(1, math.ceil(travel / PART[unit]))
        poses = []
        for part in range(1, count + 1):
            point = [q + way * part / count for q, way in zip(here, ways, strict=True)]
            poses.append(self._pose_of(point, ways))
        slowest = min(get(f"ini.{n}.max_velocity") for n in self._cnc.joints)
        return self._start(poses, travel / slowest, percent)

    def to_pose(self, coordinates: Sequence[float], percent: float) -> float:
        """Start a move to a pose by LinuxCNC's own kinematics; return its seconds."""
        self._require_ready()
        ways = zip(self._cnc.letters, self._place(), coordinates, strict=True)
        speeds = {a: self._cnc.get(f"ini.{a}.max_velocity") for a in self._cnc.letters}
        fastest_s = max(abs(there - now) / speeds[letter] for letter, now, there in ways)
        return self._start([coordinates], fastest_s, percent)

    def stop(self) -> None:
        """Brake at once. A move that is just being started ends too."""
        self._stops += 1  # before the lock: no further part of a move is sent
        with self._cnc.lock:
            self._cnc.order("abort")
            self._target = ()

    def switch_off(self) -> None:
        """Take the power off a robot that stands: changed parameters would make its joints jump."""
        if self.is_moving():
            raise Refusal("BUSY", "the robot moves")
        self._cnc.order("state", self._cnc.constants.STATE_OFF)
        self._cnc.wait(lambda: not self._cnc.has_power(), "the machine stays on")

    def _encoders(self) -> list[float]:
        """Read the encoders, without LinuxCNC's own compensation of backlash."""
        motors = [f"joint.{n}.motor-" for n in self._cnc.joints]
        return [self._cnc.get(f"{m}pos-fb") - self._cnc.get(f"{m}offset") for m in motors]

    def _place(self) -> list[float]:
        """Read where the trajectory is, by letter."""
        return [self._cnc.get(f"axis.{letter}.pos-cmd") for letter in self._cnc.letters]

    def _is_at(self, target: Sequence[float]) -> bool:
        """Whether the trajectory has come to its target, where there is one."""
        pairs = zip(target, self._place(), strict=False)
        return all(abs(there - now) <= SAME_PLACE for there, now in pairs)

    def _fault(self, *, moving: bool) -> str:
        """Say what is wrong, in LinuxCNC's words where it has any."""
        # the task's copy of the positions: it stays the same where the task or realtime died
        seen, now_s = tuple(self._cnc.status.joint_actual_position), time.monotonic()
        if seen != self._seen or not moving:
            self._seen, self._changed_s = seen, now_s
        reason = "; ".join(self._cnc.messages)
        if not self._cnc.has_power():
            return reason or "the machine is off: switch it on at LinuxCNC"
        if not self._cnc.get("motion.is-all-homed"):
            return reason or "not homed: home all joints at LinuxCNC"
        if now_s - self._changed_s > FROZEN_AFTER_S:
            return reason or "stands short of its target: feed hold, or dead task or realtime part"
        if not moving:
            self._cnc.messages.clear()
        return reason

    def _require_ready(self) -> None:
        """Refuse a move for whatever is in its way, before anything is sent."""
        self._cnc.status.poll()
        is_moving = self.is_moving()
        if self._cnc.status.estop:
            raise Refusal("ESTOP", "the emergency stop is on")
        self._cnc.collect_messages()
        self._cnc.messages.clear()
        if fault := self._fault(moving=False):
            raise Refusal("FAULT", fault)
        if is_moving or self._cnc.status.interp_state != self._cnc.constants.INTERP_IDLE:
            raise Refusal("BUSY", "LinuxCNC is still at work")
        self._parameters.check()

    def _pose_of(self, joints: Sequence[float], ways: Sequence[float]) -> list[float]:
        """Ask pkmkins for the pose of joints that are reached by these ways.

        With a backlash an encoder reads half of it beside its joint.
        """
        get, put = self._cnc.get, self._cnc.put
        if "pkmkins.ask.number" not in self._cnc.pins:
            raise Refusal("FAULT", "no pkmkins here, or an older one: install it, restart LinuxCNC")
        for n, (joint, way) in enumerate(zip(joints, ways, strict=True)):
            put(f"pkmkins.ask.joint{n}", joint - math.copysign(0.5 * get(f"ini.{n}.backlash"), way))
        answered = "pkmkins.ask.answered"
        number = get(answered) + 1.0
        put("pkmkins.ask.number", number)
        self._cnc.wait(lambda: get(answered) == number, f"pkmkins does not answer: {DEAD}")
        if not get("pkmkins.ask.found"):
            raise Refusal("REACH", "the robot cannot be assembled at these joints")
        return [get(f"pkmkins.ask.{letter}") for letter in self._cnc.letters]

    def _start(self, poses: Sequence[Sequence[float]], fastest_s: float, percent: float) -> float:
        """Send the parts of a move and see it begin; raises what LinuxCNC's refusal means."""
        cnc, stops = self._cnc, self._stops
        seconds = max(100.0 / percent * fastest_s, 0.05)
        if cnc.status.task_mode != cnc.constants.MODE_MDI:
            cnc.order("mode", cnc.constants.MODE_MDI)
        for pose in poses:
            words = " ".join(f"{a}{v:.6f}" for a, v in zip(cnc.letters, pose, strict=True))
            # inverse time (G93): a feed would not count the rotary letter
            block = f"G21 G90 G93 G53 G1 {words} F{60.0 * len(poses) / seconds:.6f}"
            with cnc.lock:
                if self._stops != stops:
                    raise Refusal("FAULT", "stopped meanwhile")
                self._target = tuple(round(value, 6) for value in poses[-1])
                cnc.order("mdi", block)
        try:
            cnc.wait(lambda: self._has_begun(stops), f"it has not begun: {DEAD}")
        except Refusal:
            self.stop()
            raise
        return seconds

    def _has_begun(self, stops: int) -> bool:
        """Whether a move is under way, or over; raises its refusal, which comes a moment later."""
        cnc, constants = self._cnc, self._cnc.constants
        cnc.collect_messages()
        if cnc.status.state == constants.RCS_ERROR and cnc.messages:
            text = "; ".join(cnc.messages)
            code = "LIMIT" if re.search("exceed|limit", text) else "FAULT"
            raise Refusal("REACH" if "kinematicsInverse" in text else code, text)
        is_at_work = cnc.status.interp_state != constants.INTERP_IDLE
        return is_at_work or self._stops != stops or self._is_at(self._target)


class Session(socketserver.BaseRequestHandler):
    """One client: what it has staged, and the motion that it has started, end with it."""

    server: "Bridge"

    def handle(self) -> None:
        """Answer lines until the client leaves."""
        self._staged: dict[str, float] = {}
        self._moves = False
        self.request.settimeout(WATCHDOG_S)
        try:
            with suppress(OSError):  # the client has gone
                for line in self._lines():
                    self.request.sendall(self._answer(line.removesuffix(b"\r")))
        finally:
            self._stop_unwatched()

    def _lines(self) -> Iterator[bytes]:
        waiting = b""
        while True:
            try:
                data = self.request.recv(4096)
            except TimeoutError:
                self._stop_unwatched()
                continue
            if not data:
                return
            *lines, waiting = (waiting + data).split(b"\n")
            waiting = waiting[:LINE_BYTES]  # too long already: its checksum cannot fit any more
            yield from lines

    def _stop_unwatched(self) -> None:
        with suppress(Refusal):
            if self._moves and self.server.motion.is_moving():
                self.server.motion.stop()

    def _answer(self, line: bytes) -> bytes:
        sound = LINE.fullmatch(line) if len(line) < LINE_BYTES else None
        if sound is None or b"%04X" % crc_hqx(sound[1], 0xFFFF) != sound[4]:
            head = re.match(NUMBERED + b" ", line)
            return _line(head[1], "?", "NO", "CHECKSUM") if head else b""
        verb, *words = sound[3].decode("ascii").split()
        try:
            return _line(sound[2], verb, "OK", *map(_word, self._obey(verb, words)))
        except Refusal as no:
            verb = "?" if no.code == "VERB" else verb
            return _line(sound[2], verb, "NO", no.code, *str(no)[:150].split())

    def _obey(self, verb: str, words: Sequence[str]) -> Sequence[object]:
        """Do what a line says and return the words of the answer; raises `Refusal`."""
        match verb, words:
            case "HELLO", ["1"]:
                self._staged = {}
                return self.server.identity()
            case "HELLO", [version] if version.isdecimal():
                raise Refusal("VERSION", "version 1 is spoken here")
            case "STATE", []:
                return self.server.motion.state()
            case "STOP", []:
                self.server.motion.stop()
            case "MOVEJ" | "MOVEP", _:
                return [self._move(verb, words)]
            case "GEOM" | "STAGE", [_, *_]:
                return self._parameters(verb, words)
            case "COMMIT", []:
                self.server.motion.switch_off()
                self.server.parameters.replace(self._staged)
                self._staged = {}
            case "ABANDON", []:
                self._staged = {}
            case _:
                known = {"HELLO", "STATE", "STOP", "GEOM", "STAGE", "COMMIT", "ABANDON"}
                raise Refusal("ARGUMENT" if verb in known else "VERB")
        return ()

    def _move(self, verb: str, words: Sequence[str]) -> float:
        motion, cnc = self.server.motion, self.server.cnc
        is_pose = verb == "MOVEP"
        *target, percent = _numbers(words, len(cnc.letters if is_pose else cnc.joints) + 1)
        if not 0.0 < percent <= 100.0:
            raise Refusal("ARGUMENT", f"speed {percent:g} is not above 0 and up to 100")
        self._moves = True
        return (motion.to_pose if is_pose else motion.to_joints)(target, percent)

    def _parameters(self, verb: str, words: Sequence[str]) -> Sequence[object]:
        size = 2 if words[0] == "ARM" else 1
        values = self.server.parameters.line(" ".join(words[:size]))
        numbers = _numbers(words[size:], len(values) if verb == "STAGE" else 0)
        if verb == "GEOM":
            return [*words, *values.values()]
        self._staged |= dict(zip(values, numbers, strict=True))
        return ()


def _numbers(words: Sequence[str], count: int) -> list[float]:
    values = [float(word) if NUMBER.fullmatch(word) else math.nan for word in words]
    if len(values) != count or not all(map(math.isfinite, values)):
        raise Refusal("ARGUMENT", f"{count} numbers like -12.5 are needed")
    return values


def _word(value: object) -> str:
    """Write a flag, a number with all its digits, or a text, as one word."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return repr(value) if "." in repr(value) else repr(value).replace("e", ".0e")
    text = str(value)
    while len(word := quote(text, safe=UNQUOTED)) > 100:
        text = text[:-1]
    return word or "-"


def _line(number: bytes, *words: str) -> bytes:
    text = b"<" + number + b" " + " ".join(words).encode("ascii", "replace")
    return b"%s *%04X\n" % (text, crc_hqx(text, 0xFFFF))


class Bridge(socketserver.ThreadingTCPServer):
    """Serves robotline for as long as LinuxCNC runs."""

    allow_reuse_address = daemon_threads = True

    def __init__(self, address: tuple[str, int], file: Path) -> None:
        self.cnc = LinuxCnc()
        self.parameters = Parameters(self.cnc, file)
        self.motion = Motion(self.cnc, self.parameters)
        super().__init__(address, Session)

    def identity(self) -> tuple[object, ...]:
        """Return the words of the answer to HELLO."""
        cnc, robot = self.cnc, self.parameters.robot()
        return 1, "LinuxCNC", cnc.kinematics, robot, cnc.constants.version, len(cnc.joints)


def main() -> None:
    """Serve until LinuxCNC ends, or this program is ended."""
    words = argparse.ArgumentParser(description="Speaks robotline for the LinuxCNC that runs here.")
    words.add_argument("-ini", help="given by LinuxCNC where this is its DISPLAY; not used")
    words.add_argument("--port", type=int, default=5020)
    words.add_argument("--host", default="127.0.0.1", help="0.0.0.0: for other computers too")
    words.add_argument("--file", type=Path, default="calib.hal", help="keeps the parameters")
    given = words.parse_args()
    with Bridge((given.host, given.port), given.file) as bridge:
        bridge.serve_forever()


if __name__ == "__main__":
    main()
