"""What the LinuxCNC driver is told, and what it asks of others: limits, kinematics, parameters."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from math import radians
from typing import Protocol

from drivers.errors import DeviceRefused, EmergencyStop, MotionFault, WrongDevice
from drivers.linuxcnc.client import LinuxcncClient, Passwords, Patience
from drivers.linuxcnc.machine_state import JOINTS, Coordinates
from drivers.linuxcnc.motion import MDI, PER_MINUTE, JointLimits
from drivers.polling import comes_true
from drivers.ports import Clock
from drivers.transport import Transport
from drivers.values import Identity, Pose


class Kinematics(Protocol):
    """A parameter set at work."""

    def joints(self, pose: Pose) -> tuple[float, ...]:
        """Encoder angles of a pose; raises `LimitViolation` for one out of reach."""
        ...

    def pose(self, joints: Sequence[float]) -> Pose:
        """Pose of encoder angles; raises `LimitViolation` where nothing can be assembled."""
        ...


KinematicsOf = Callable[[Mapping[str, float]], Kinematics]
"""Puts a parameter set, by flat name in mm and deg, to work."""


class ParameterStore(Protocol):
    """Where the parameters are kept that poses are converted with."""

    @property
    def needs_machine_off(self) -> bool:
        """Whether writing changes what LinuxCNC itself works with."""
        ...

    def read(self) -> Mapping[str, float]:
        """All parameters by flat name, mm and deg."""
        ...

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace all of them, or raise and keep the old."""
        ...


@dataclass(frozen=True, slots=True)
class SetupDeadlines:
    """How long each step may take, in real seconds."""

    switch_s: float = 3.0
    homing_s: float = 120.0
    poll_s: float = 0.02
    stays_on_s: float = 0.15
    """A machine with a faulty drive is seen on for a moment."""


@dataclass(frozen=True, slots=True)
class LinuxcncDeadlines:
    """How long things may take, in real seconds."""

    patience: Patience = field(default_factory=Patience)
    setup: SetupDeadlines = field(default_factory=SetupDeadlines)
    start_s: float = 1.0
    """Until an accepted move has begun or been refused."""
    frozen_s: float = 1.5
    """How long positions may stay the same in a motion."""
    stop_s: float = 8.0
    poll_s: float = 0.005


@dataclass(frozen=True, slots=True)
class LinuxcncSettings:
    """What no question can tell about this LinuxCNC."""

    coordinates: Coordinates
    limits: JointLimits
    full_speed_rad_s: float
    """Of the fastest joint at a speed fraction of 1."""
    passwords: Passwords = field(default_factory=Passwords)
    passing_slack_rad: float = radians(0.5)
    """By how much joints may exceed their limits on the way. LinuxCNC must allow it."""
    still_deg: float = 0.001
    """The largest difference between readings of a joint that stands."""
    deadlines: LinuxcncDeadlines = field(default_factory=LinuxcncDeadlines)


UNITS = {"user_linear_units": "MM", "user_angular_units": "DEG"}


class LinuxcncSetup:
    """The steps, on one connection that has control."""

    def __init__(
        self, conversation: LinuxcncClient, clock: Clock, deadlines: SetupDeadlines
    ) -> None:
        self._conversation = conversation
        self._clock = clock
        self._deadlines = deadlines

    def check_machine(self) -> None:
        """Raise `WrongDevice` unless it has exactly four rotary joints, in mm and deg."""
        types = self._conversation.get("joint_type").text.split()
        rotary = [kind == "ANGULAR" for kind in types]
        if sum(rotary) != JOINTS or not all(rotary[:JOINTS]):
            raise WrongDevice(
                f"{self._conversation.name}: LinuxCNC has {sum(rotary)} rotary joints "
                f"({' '.join(types)}), a Par4 has {JOINTS}",
                remedy=f"check the address; set [KINS]JOINTS = {JOINTS} "
                "and TYPE = ANGULAR for joints 0 to 3",
            )
        for word, unit in UNITS.items():
            found = self._conversation.get(word).text
            if found != unit:
                raise WrongDevice(
                    f"{self._conversation.name}: LinuxCNC works in {found}, not in {unit}",
                    remedy="set [TRAJ]LINEAR_UNITS = mm and ANGULAR_UNITS = degree",
                )

    def bring_up(self) -> None:
        """Take all steps that are still to be taken. Homing may move the joints.

        Raises `EmergencyStop`, `MotionFault` or `DeviceRefused`, with LinuxCNC's own words.
        """
        self._conversation.messages()  # old ones would be taken for reasons
        self._release_emergency_stop()
        self._switch_on()
        self._home()
        self.enter_mdi()

    def is_homed(self) -> bool:
        """Whether all joints know where they are. LinuxCNC tells of joints that it doesn't have."""
        homed = self._conversation.get("joint_homed").text.split()
        return homed[:JOINTS] == ["YES"] * JOINTS

    def enter_mdi(self) -> None:
        """Have it take single commands."""
        if self._conversation.get("mode").text != "MDI":
            self._conversation.order("mode", "mdi")
            self._await("mode MDI", lambda: self._conversation.get("mode").text == "MDI")

    def switch_off(self) -> None:
        """Take the power off the drives; raises `MotionFault` when that cannot be seen."""
        if self._conversation.is_on("machine"):
            self._conversation.order("machine", "off")
            self._await("machine off", lambda: not self._conversation.is_on("machine"))

    def _release_emergency_stop(self) -> None:
        if not self._is_stopped():
            return
        self._conversation.order("estop", "off")
        if not self._comes(lambda: not self._is_stopped(), self._deadlines.switch_s):
            raise EmergencyStop(
                f"{self._conversation.name}: the emergency stop stays on{self._said()}",
                remedy="make the cell safe, release it at the machine, then start again",
            )

    def _switch_on(self) -> None:
        if not self._conversation.is_on("machine"):
            self._conversation.order("machine", "on")
            self._await("machine on", lambda: self._conversation.is_on("machine"))
        self._clock.sleep_s(self._deadlines.stays_on_s)
        if not self._conversation.is_on("machine"):
            raise MotionFault(
                f"{self._conversation.name}: the machine goes off again{self._said()}",
                remedy="clear the drives' fault at the machine, then start again",
            )

    def _home(self) -> None:
        if self.is_homed():
            return
        self._conversation.order("mode", "manual")
        self._await("mode manual", lambda: self._conversation.get("mode").text == "MANUAL")
        self._conversation.order("teleop_enable", "off")
        self._conversation.order("home", "-1")
        self._await("homing", self._is_homed_with_power, self._deadlines.homing_s)

    def _is_homed_with_power(self) -> bool:
        if not self._conversation.is_on("machine"):
            raise MotionFault(
                f"{self._conversation.name}: the machine went off while homing{self._said()}",
                remedy="clear the fault at the machine, then start again",
            )
        return self.is_homed()

    def _await(
        self, what: str, condition: Callable[[], bool], within_s: float | None = None
    ) -> None:
        patience_s = self._deadlines.switch_s if within_s is None else within_s
        if not self._comes(condition, patience_s):
            raise MotionFault(
                f"{self._conversation.name}: no {what} within {patience_s:g} s{self._said()}",
                remedy="look at the machine and at LinuxCNC's messages, then start again",
            )

    def _comes(self, condition: Callable[[], bool], within_s: float) -> bool:
        return comes_true(
            condition,
            self._clock,
            give_up_s=self._clock.now_s() + within_s,
            pause_s=self._deadlines.poll_s,
        )

    def _is_stopped(self) -> bool:
        return self._conversation.get("estop").text != "OFF"

    def _said(self) -> str:
        messages = self._conversation.messages()
        return f" ({'; '.join(messages)})" if messages else ""


class LinuxcncAccess:
    """Opens one connection after another to the same controller."""

    def __init__(
        self,
        open_transport: Callable[[], Transport],
        clock: Clock,
        settings: LinuxcncSettings,
        cancelled: Callable[[], bool],
    ) -> None:
        self._open_transport = open_transport
        self._clock = clock
        self._settings = settings
        self._cancelled = cancelled

    def opened(self) -> LinuxcncClient:
        """Connect; nothing is said yet. Raises `LinkDown`."""
        return LinuxcncClient(
            self._open_transport(),
            clock_s=self._clock.now_s,
            patience=self._settings.deadlines.patience,
            cancelled=self._cancelled,
        )

    def greet(self, conversation: LinuxcncClient) -> Identity:
        """Say hello, and hear who answers; raises `WrongDevice`."""
        greeting = conversation.greet(self._settings.passwords)
        return Identity(
            vendor="LinuxCNC",
            model=f"Par4 in {self._settings.coordinates.value}",
            serial=greeting.name,
            firmware="not told",
            protocol=f"linuxcncrsh {greeting.version}",
        )

    def take_over(self, conversation: LinuxcncClient) -> None:
        """See that the machine is ours, take control, and first of all stop what moves.

        LinuxCNC finishes a motion whose client was lost. Raises `LinkDown`, `WrongDevice`, or
        `DeviceRefused` when the motion cannot be stopped, and then closes.
        """
        try:
            self.setup(conversation).check_machine()
            self.take_control(conversation)
            if conversation.is_on("machine"):
                conversation.order("abort")
        except BaseException:  # also an interrupt: what it leaves behind is closed
            conversation.close()
            raise

    def take_control(self, conversation: LinuxcncClient) -> None:
        """Take control, also from another client; raises `WrongDevice`."""
        conversation.take_control(self._settings.passwords)

    def setup(self, conversation: LinuxcncClient) -> LinuxcncSetup:
        """The steps of bringing it up, on this connection."""
        return LinuxcncSetup(conversation, self._clock, self._settings.deadlines.setup)

    def leave(self, conversation: LinuxcncClient) -> None:
        """Stop and give control back; the caller closes. Another client's motion is left alone."""
        if not conversation.is_on("enable"):
            return
        if conversation.is_on("machine"):
            conversation.order("abort")
            with suppress(DeviceRefused):  # not in MDI mode, or off by now: then it needs nothing
                conversation.order(MDI, PER_MINUTE)
        conversation.order("enable", "off")
