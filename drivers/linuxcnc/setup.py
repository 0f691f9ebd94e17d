"""Brings LinuxCNC into the state that moving needs: e-stop released, machine on, homed, MDI mode.

Every order is only received when it is acknowledged: each step is asked for until it is seen.
"""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import EmergencyStop, MotionFault, WrongDevice
from drivers.linuxcnc.conversation import LinuxcncConversation
from drivers.linuxcnc.state import JOINTS
from drivers.ports import Clock
from drivers.waiting import comes_true

UNITS = {"user_linear_units": "MM", "user_angular_units": "DEG"}


@dataclass(frozen=True, slots=True)
class SetupDeadlines:
    """How long each step may take, in real seconds."""

    switch_s: float = 3.0
    homing_s: float = 120.0
    poll_s: float = 0.02
    stays_on_s: float = 0.15
    """A machine with a faulty drive is seen on for a moment."""


class LinuxcncSetup:
    """The steps, on one connection that has control."""

    def __init__(
        self, conversation: LinuxcncConversation, clock: Clock, deadlines: SetupDeadlines
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
