"""Starts, follows and stops LinuxCNC's motions on a connection that has control."""

from collections.abc import Sequence
from math import radians

from drivers.errors import DeviceNotReady, DeviceRefused, LinkDown, MotionFault
from drivers.linuxcnc.access import LinuxcncAccess
from drivers.linuxcnc.conversation import LinuxcncConversation
from drivers.linuxcnc.motion import MDI, Pace, Target, refusal
from drivers.linuxcnc.settings import LinuxcncSettings
from drivers.linuxcnc.state import (
    READING_PAUSE_S,
    READINGS,
    Snapshot,
    take_snapshot,
)
from drivers.linuxcnc.watch import MotionWatch
from drivers.ports import Clock
from drivers.stopping import await_standstill
from drivers.values import RobotState
from drivers.waiting import comes_true


class LinuxcncMover:
    """Knows the motion under way. An ACK proves nothing: all it says comes from readings."""

    def __init__(self, access: LinuxcncAccess, clock: Clock, settings: LinuxcncSettings) -> None:
        self._access = access
        self._clock = clock
        self._settings = settings
        self._deadlines = settings.deadlines
        self._watch = MotionWatch(settings.deadlines.frozen_s)

    @property
    def has_started(self) -> bool:
        """Whether a motion was started that has not been seen to end."""
        return self._watch.target is not None

    def state(self, conversation: LinuxcncConversation) -> RobotState:
        """Read everything; takes some 10 ms to be sure that the joints stand."""
        first = self._snapshot(conversation)
        standing = self._standing(conversation, first)
        snapshot, moving = standing or first, standing is None
        self._watch.hear(conversation.messages())
        fault = self._watch.fault(snapshot, self._clock.now_s(), moving=moving)
        if not (moving or fault):
            self._watch.forget()
        return RobotState(
            joints_rad=tuple(map(radians, snapshot.joints_deg)),
            moving=moving,
            fault=fault,
            emergency_stop=snapshot.emergency_stop,
            raw=snapshot.raw,
        )

    def renew(self) -> None:
        """Forget the last motion and its faults: the machine has been made ready."""
        self._watch.renew()

    def is_moving(self, conversation: LinuxcncConversation) -> bool:
        """Whether anything moves, whoever started it."""
        return self._standing(conversation, self._snapshot(conversation)) is None

    def start(
        self,
        conversation: LinuxcncConversation,
        way: Sequence[Target],
        travel_rad: float,
        speed_fraction: float,
    ) -> None:
        """Give the orders and see the motion begin; raises what LinuxCNC's refusal means.

        `travel_rad` is how far the longest joint goes. Orders that follow each other are queued.
        """
        self._check_ready(conversation)
        self._access.setup(conversation).enter_mdi()
        conversation.messages()  # old ones would be taken for reasons
        self._watch.begin(way[-1], self._clock.now_s())
        pace = Pace(speed_fraction, self._settings.full_speed_rad_s)
        for target in way:
            command = pace.command(target, travel_rad / len(way))
            try:
                conversation.order(MDI, command)
            except DeviceRefused as error:
                raise self._not_taken(conversation, error) from error
        self._await_start(conversation, way[-1])

    def halt(self, conversation: LinuxcncConversation, give_up_s: float) -> None:
        """Have the robot stand, and see it stand; raises `DriverError` when that is not seen.

        By an abort, which brakes on the path; if that is not taken, by LinuxCNC's e-stop.
        """
        if not conversation.is_on("enable"):
            self._access.take_control(conversation)
        if conversation.is_on("machine"):
            try:
                conversation.order("abort")
            except DeviceRefused:
                self._cut_power(conversation)
        self._watch.forget()
        await_standstill(
            lambda: self.is_moving(conversation),
            self._clock,
            give_up_s=give_up_s,
            pause_s=self._deadlines.poll_s,
        )

    def _snapshot(self, conversation: LinuxcncConversation) -> Snapshot:
        return take_snapshot(conversation, self._settings.coordinates)

    def _standing(self, conversation: LinuxcncConversation, first: Snapshot) -> Snapshot | None:
        """The last of several readings at which everything stood; None while anything moves."""
        latest = first
        for _ in range(READINGS - 1):
            if self._watch.is_under_way(latest):
                return None
            self._clock.sleep_s(READING_PAUSE_S)
            latest = self._snapshot(conversation)
            if not latest.is_as(first, self._settings.still_deg):
                return None
        return None if self._watch.is_under_way(latest) else latest

    def _check_ready(self, conversation: LinuxcncConversation) -> None:
        snapshot = self._snapshot(conversation)
        if snapshot.emergency_stop or not snapshot.machine_on:
            raise self._refusal(conversation, snapshot)
        if not snapshot.in_control:
            raise DeviceNotReady(
                f"{conversation.name}: another client has taken control of LinuxCNC",
                remedy="end that program, then start again",
            )
        if not self._access.setup(conversation).is_homed():
            raise DeviceNotReady(
                f"{conversation.name}: LinuxCNC's joints are not homed",
                remedy="start again: homing is part of getting ready",
            )
        if not snapshot.idle:
            raise DeviceNotReady(
                f"{conversation.name}: LinuxCNC is still at work", remedy="wait until it stands"
            )

    def _await_start(self, conversation: LinuxcncConversation, target: Target) -> None:
        """Wait until the move has begun; raises what its refusal means.

        What comes later is told by `state`.
        """
        deadline_s = self._clock.now_s() + self._deadlines.start_s
        while self._clock.now_s() < deadline_s:
            snapshot = self._snapshot(conversation)
            messages = conversation.messages()
            if messages or snapshot.emergency_stop or not snapshot.machine_on:
                raise self._refusal(conversation, snapshot, messages)
            if not snapshot.idle or snapshot.is_commanded(target.values):
                return
            self._clock.sleep_s(self._deadlines.poll_s)
        raise MotionFault(
            f"{conversation.name}: LinuxCNC has taken a move, but it has not begun within "
            f"{self._deadlines.start_s:g} s",
            remedy="its realtime part seems to have died: see that the robot stands, "
            "restart LinuxCNC",
        )

    def _refusal(
        self,
        conversation: LinuxcncConversation,
        snapshot: Snapshot,
        messages: Sequence[str] = (),
    ) -> DeviceRefused:
        """What is said now; a machine that is off keeps no motion."""
        said = (*messages, *conversation.messages())
        self._watch.forget()
        return refusal(
            conversation.name,
            said,
            emergency_stop=snapshot.emergency_stop,
            machine_on=snapshot.machine_on,
        )

    def _not_taken(
        self, conversation: LinuxcncConversation, error: DeviceRefused
    ) -> DeviceRefused | LinkDown:
        """What it means that an order was not even received."""
        snapshot = self._snapshot(conversation)
        if snapshot.emergency_stop or not snapshot.machine_on or not snapshot.in_control:
            return self._refusal(conversation, snapshot)
        conversation.close()
        return LinkDown(
            f"{error.problem}: it shows a machine that is on, but takes no orders",
            remedy="its task or realtime part seems to have died: see that the robot stands, "
            "restart LinuxCNC",
        )

    def _cut_power(self, conversation: LinuxcncConversation) -> None:
        conversation.order("estop", "on")
        if not comes_true(
            lambda: not conversation.is_on("machine"),
            self._clock,
            give_up_s=self._clock.now_s() + self._deadlines.start_s,
            pause_s=self._deadlines.poll_s,
        ):
            raise MotionFault(
                f"{conversation.name}: LinuxCNC takes neither abort nor e-stop",
                remedy="use the hardware stop",
            )
