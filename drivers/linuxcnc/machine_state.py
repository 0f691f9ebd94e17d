"""State of a LinuxCNC machine at one moment, and the steps that bring it to the state moves need.

Its ACK says "received", its IDLE may be older than the motion, and after `wait done` one move in
sixty still runs. What has been found to hold: a motion is over when the *commanded* position is the
target, the program is idle, and the joints read the same several times in a row.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from drivers import errors
from drivers.linuxcnc.client import LinuxcncClient
from drivers.linuxcnc.settings import LinuxcncSettings
from drivers.plausible import require
from drivers.polling import comes_true
from drivers.ports import Clock
from drivers.session import DeviceSession
from drivers.values import JOINT_ANGLE, JOINT_LENGTH, inner_units
from drivers.wire.framing import ascii_bytes
from drivers.wire.linuxcncrsh import Value, read_message, read_numbers
from drivers.wire.robotline import RobotLayout

LETTERS = "XYZABC"
"""The order in which positions are told; newer versions tell U V W after them."""
SAME_PLACE = 2e-6
"""mm or deg: positions are told with six decimals."""
QUESTIONS = ("joint_pos", "abs_cmd_pos", "program_status", "machine", "estop", "enable")
BETWEEN_ANSWERS = "; "
"""Between the raw answers of a snapshot, of which that of the joints comes first."""
UNITS = {"user_linear_units": "MM", "user_angular_units": "DEG"}
LIMIT_WORDS = ("exceed", "limit", "kinematicsinverse")
FAULT_WORDS = ("following error", "amplifier fault", "amp fault")


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One reading, in deg and mm as LinuxCNC tells them."""

    joints: tuple[float, ...]
    """By the machine's own joints."""
    commanded: tuple[float, ...]
    """Place of the trajectory now, by the machine's own letters."""
    idle: bool
    machine_on: bool
    emergency_stop: bool
    in_control: bool
    raw: str

    @property
    def has_power(self) -> bool:
        """On, and not held by the emergency stop."""
        return self.machine_on and not self.emergency_stop

    def is_commanded(self, target: Sequence[float]) -> bool:
        """True when the trajectory has come to its end there."""
        return self.idle and agree(self.commanded, target, SAME_PLACE)


class Machine:
    """The machine at the far end of a session. What it does needs control of it."""

    def __init__(
        self, session: DeviceSession[LinuxcncClient], clock: Clock, settings: LinuxcncSettings
    ) -> None:
        self._session = session
        self._clock = clock
        self._settings, self._deadlines = settings, settings.deadlines

    @property
    def client(self) -> LinuxcncClient:
        """The open connection; raises `LinkDown` when there is none."""
        return self._session.connection

    def snapshot(self) -> Snapshot:
        """Everything that a state is made of; some 25 µs a question."""
        client = self.client
        answers = {word: client.get(word) for word in QUESTIONS}
        return Snapshot(
            joints=_numbers(answers["joint_pos"], self._settings.joints),
            commanded=_position(answers["abs_cmd_pos"], self._settings.letters),
            idle=answers["program_status"].text == "IDLE",
            machine_on=answers["machine"].text == "ON",
            emergency_stop=answers["estop"].text != "OFF",
            in_control=answers["enable"].text == "ON",
            raw=BETWEEN_ANSWERS.join(answer.line for answer in answers.values()),
        )

    def joints(self) -> tuple[float, ...]:
        """The joints now, deg or mm; raises `ImplausibleAnswer`."""
        joints = _numbers(self.client.get("joint_pos"), self._settings.joints)
        self.require_plausible(joints)
        return joints

    def require_plausible(self, joints: Sequence[float]) -> None:
        """Raise `ImplausibleAnswer` for joints that cannot be. A stop does not ask for it."""
        bounds = JOINT_ANGLE if self._settings.are_rotary else JOINT_LENGTH
        for number, joint in enumerate(joints):
            require(self.client.name, bounds, joint, which=f"joint {number} at")

    def position(self) -> tuple[float, ...]:
        """LinuxCNC's own coordinates of where it is now, mm and deg."""
        return _position(self.client.get("abs_act_pos"), self._settings.letters)

    def check_model(self) -> None:
        """Raise `WrongDevice` unless it has the robot's joints and no others, in mm and deg.

        LinuxCNC tells of linear joints beyond those that it has, so that these are not counted.
        """
        robot = self._settings
        types = self.client.get("joint_type").text.split()
        rotary = types.count("ANGULAR")
        alike = types[: robot.joints] == [robot.joint_type] * robot.joints
        if not alike or rotary != robot.joints * robot.are_rotary:
            counted = types if robot.are_rotary else types[: robot.joints]
            count = counted.count(robot.joint_type)
            kind = "rotary" if robot.are_rotary else "linear"
            raise errors.WrongDevice(
                f"{self.client.name}: LinuxCNC has {count} {kind} joints "
                f"({' '.join(types)}), a {robot.robot} has {robot.joints}",
                remedy=f"check the address; set [KINS]JOINTS = {robot.joints} "
                f"and TYPE = {robot.joint_type} for joints 0 to {robot.joints - 1}",
            )
        for word, unit in UNITS.items():
            found = self.client.get(word).text
            if found != unit:
                raise errors.WrongDevice(
                    f"{self.client.name}: LinuxCNC works in {found}, not in {unit}",
                    remedy="set [TRAJ]LINEAR_UNITS = mm and ANGULAR_UNITS = degree",
                )

    def check_ready(self, snapshot: Snapshot) -> None:
        """Raise `DeviceNotReady` unless a machine with power can be given a move."""
        if not snapshot.in_control:
            problem = "another client has taken control of LinuxCNC"
            remedy = "end that program, then start again"
        elif not self.is_homed():
            problem = "LinuxCNC's joints are not homed"
            remedy = "start again: homing is part of getting ready"
        elif not snapshot.idle:
            problem, remedy = "LinuxCNC is still at work", "wait until it stands"
        else:
            return
        raise errors.DeviceNotReady(f"{self.client.name}: {problem}", remedy=remedy)

    def is_homed(self) -> bool:
        """Whether all joints are; LinuxCNC tells of more joints than it has, after those it has."""
        homed = self.client.get("joint_homed").text.split()
        return homed[: self._settings.joints] == ["YES"] * self._settings.joints

    def switch_on(self) -> None:
        """Release LinuxCNC's e-stop and switch the machine on, as far as that is still to be done.

        Raises `EmergencyStop`, `MotionFault` or `DeviceRefused`, with LinuxCNC's own words.
        """
        self.client.messages()  # old ones would be taken for reasons
        self._release_emergency_stop()
        self._switch_on()

    def home(self) -> None:
        """Home all joints, which moves them; raises `MotionFault`."""
        self.client.order("mode", "manual")
        self._await("mode manual", lambda: self._is_in_mode("MANUAL"))
        self.client.order("teleop_enable", "off")
        self.client.order("home", "-1")
        self._await("homing", self._is_homed_with_power, self._deadlines.homing_s)

    def enter_mdi(self) -> None:
        """Have it take single commands."""
        if not self._is_in_mode("MDI"):
            self.client.order("mode", "mdi")
            self._await("mode MDI", lambda: self._is_in_mode("MDI"))

    def switch_off(self) -> None:
        """Take the power off the drives; raises `MotionFault` when that cannot be seen."""
        if self.client.is_on("machine"):
            self.client.order("machine", "off")
            self._await("machine off", lambda: not self.client.is_on("machine"))

    def refusal(self, snapshot: Snapshot, messages: Sequence[str]) -> errors.DeviceRefused:
        """The meaning of LinuxCNC's messages, those still queued among them, in its own words."""
        name, said = self.client.name, "; ".join((*messages, *self.client.messages()))
        if snapshot.emergency_stop:
            return errors.EmergencyStop(
                f"{name}: the emergency stop is on" + (f" ({said})" if said else ""),
                remedy="make the cell safe, release it, then start again",
                code=said,
            )
        text = said.lower()
        if not snapshot.machine_on or any(word in text for word in FAULT_WORDS):
            remedy = "clear the fault at the machine, then start again"
            return errors.MotionFault(
                f"{name}: {said or 'the machine is off'}", remedy=remedy, code=said
            )
        if any(word in text for word in LIMIT_WORDS):
            remedy = "compare the plan's limits with [AXIS_…] and [JOINT_…] of LinuxCNC's INI file"
            return errors.LimitViolation(f"{name}: {said}", remedy=remedy, code=said)
        remedy = "look at LinuxCNC's messages, then try again"
        return errors.DeviceRefused(f"{name}: {said}", remedy=remedy, code=said)

    def _release_emergency_stop(self) -> None:
        def is_released() -> bool:
            return self.client.get("estop").text == "OFF"

        if is_released():
            return
        self.client.order("estop", "off")
        if not self._comes(is_released, self._deadlines.switch_s):
            remedy = "make the cell safe, release it at the machine, then start again"
            raise self._fault("the emergency stop stays on", remedy, errors.EmergencyStop)

    def _switch_on(self) -> None:
        if not self.client.is_on("machine"):
            self.client.order("machine", "on")
            self._await("machine on", lambda: self.client.is_on("machine"))
        self._clock.sleep_s(self._deadlines.stays_on_s)
        if not self.client.is_on("machine"):
            remedy = "clear the drives' fault at the machine, then start again"
            raise self._fault("the machine goes off again", remedy)

    def _is_homed_with_power(self) -> bool:
        if not self.client.is_on("machine"):
            remedy = "clear the fault at the machine, then start again"
            raise self._fault("the machine went off while homing", remedy)
        return self.is_homed()

    def _is_in_mode(self, mode: str) -> bool:
        return self.client.get("mode").text == mode

    def _await(self, what: str, is_so: Callable[[], bool], within_s: float | None = None) -> None:
        within_s = within_s or self._deadlines.switch_s
        if not self._comes(is_so, within_s):
            remedy = "look at the machine and at LinuxCNC's messages, then start again"
            raise self._fault(f"no {what} within {within_s:g} s", remedy)

    def _comes(self, is_so: Callable[[], bool], within_s: float) -> bool:
        give_up_s = self._clock.now_s() + within_s
        return comes_true(
            is_so, self._clock, give_up_s=give_up_s, pause_s=self._deadlines.setup_poll_s
        )

    def _fault(
        self, problem: str, remedy: str, kind: type[errors.MotionFault] = errors.MotionFault
    ) -> errors.MotionFault:
        """A step that failed, with what LinuxCNC says of it."""
        said = "; ".join(self.client.messages())
        problem = f"{self.client.name}: {problem}" + (f" ({said})" if said else "")
        return kind(problem, remedy=remedy)


def joints_said(raw: str, layout: RobotLayout) -> tuple[float, ...]:
    """Joint values, rad or mm, of a snapshot's raw answers; raises `WireError`."""
    answer = read_message(ascii_bytes(raw.split(BETWEEN_ANSWERS)[0]))
    if not isinstance(answer, Value):
        raise errors.WireError(f"no joints of LinuxCNC: {raw!r:.80}")
    return inner_units(layout.joints, read_numbers(answer)[: len(layout.joints)])


def agree(first: Sequence[float], second: Sequence[float], within: float) -> bool:
    """True where no two numbers differ by more."""
    return all(abs(one - other) <= within for one, other in zip(first, second, strict=True))


def _numbers(answer: Value, count: int) -> tuple[float, ...]:
    """The first numbers of an answer: versions differ in how many follow. Raises `WireError`."""
    numbers = read_numbers(answer)
    if len(numbers) < count:
        raise errors.WireError(f"LinuxCNC answers fewer than {count} numbers: {answer.line!r:.80}")
    return numbers[:count]


def _position(answer: Value, letters: str) -> tuple[float, ...]:
    """The coordinates that this machine moves in; raises `WireError`."""
    told = dict(zip(LETTERS, _numbers(answer, len(LETTERS)), strict=True))
    return tuple(told[letter] for letter in letters)
