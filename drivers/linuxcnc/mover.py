"""Motion of a LinuxCNC machine: moves started, watched and stopped."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import radians

from drivers.errors import DeviceNotReady, DeviceRefused, LimitViolation, LinkDown, MotionFault
from drivers.linuxcnc.client import LinuxcncClient
from drivers.linuxcnc.machine_state import READING_PAUSE_S, READINGS, Snapshot, take_snapshot
from drivers.linuxcnc.motion import MDI, JointLimits, Pace, Target, refusal
from drivers.linuxcnc.setup import Kinematics, LinuxcncAccess, LinuxcncSettings
from drivers.polling import comes_true
from drivers.ports import Clock
from drivers.stopping import await_standstill
from drivers.values import Pose, RobotState

MESSAGES_KEPT = 5


class MotionWatch:
    """What was commanded last, what has been said since, and when anything last changed."""

    def __init__(self, frozen_s: float) -> None:
        self._frozen_s = frozen_s
        self._target: Target | None = None
        self._messages: tuple[str, ...] = ()
        self._seen: tuple[float, ...] = ()
        self._changed_s = 0.0

    @property
    def target(self) -> Target | None:
        """Where the motion goes; None when none is watched."""
        return self._target

    def begin(self, target: Target, now_s: float) -> None:
        """Watch a motion that is being started."""
        self._target, self._messages = target, ()
        self._seen, self._changed_s = (), now_s

    def forget(self) -> None:
        """Watch nothing: the motion is over, was refused or was stopped."""
        self._target = None

    def renew(self) -> None:
        """Forget what was said, too: the machine has been made ready."""
        self._target, self._messages = None, ()

    def hear(self, messages: Sequence[str]) -> None:
        """Keep what LinuxCNC has said since the motion began."""
        new = (message for message in messages if message not in self._messages)
        self._messages = (*self._messages, *new)[-MESSAGES_KEPT:]

    def is_under_way(self, snapshot: Snapshot) -> bool:
        """Whether the trajectory still has way to go, as far as a machine without power can."""
        if not snapshot.machine_on:
            return False
        if self._target is None:
            return not snapshot.idle
        return not snapshot.is_commanded(self._target.values)

    def fault(self, snapshot: Snapshot, now_s: float, *, moving: bool) -> str:
        """What is wrong, in LinuxCNC's words where it has any; empty when nothing is."""
        said = "; ".join(self._messages)
        if not snapshot.machine_on:
            return said or "the machine is off"
        if not snapshot.in_control:
            return "another client has taken control of LinuxCNC"
        if self._is_frozen(snapshot, now_s, moving=moving):
            return said or (
                f"a motion has not moved for {self._frozen_s:g} s: "
                "feed hold, or a dead task or realtime part"
            )
        return said

    def _is_frozen(self, snapshot: Snapshot, now_s: float, *, moving: bool) -> bool:
        """Whether positions that should change have stopped changing: stale values look like it."""
        seen = (*snapshot.commanded, *snapshot.joints_deg)
        if seen != self._seen or not moving:
            self._seen, self._changed_s = seen, now_s
        return now_s - self._changed_s > self._frozen_s


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

    def state(self, conversation: LinuxcncClient) -> RobotState:
        """Read everything; takes some 10 ms to be sure that the joints stand."""
        first = self._snapshot(conversation)
        standing = self._standing(conversation, first)
        snapshot, moving = standing or first, standing is None
        self._watch.hear(conversation.messages())
        fault = self._watch.fault(snapshot, self._clock.now_s(), moving=moving)
        if not (moving or fault):
            self._watch.forget()
        return RobotState(
            joints=tuple(map(radians, snapshot.joints_deg)),
            moving=moving,
            fault=fault,
            emergency_stop=snapshot.emergency_stop,
            raw=snapshot.raw,
        )

    def renew(self) -> None:
        """Forget the last motion and its faults: the machine has been made ready."""
        self._watch.renew()

    def is_moving(self, conversation: LinuxcncClient) -> bool:
        """Whether anything moves, whoever started it."""
        return self._standing(conversation, self._snapshot(conversation)) is None

    def start(
        self,
        conversation: LinuxcncClient,
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

    def halt(self, conversation: LinuxcncClient, give_up_s: float) -> None:
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

    def _snapshot(self, conversation: LinuxcncClient) -> Snapshot:
        return take_snapshot(conversation, self._settings.coordinates)

    def _standing(self, conversation: LinuxcncClient, first: Snapshot) -> Snapshot | None:
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

    def _check_ready(self, conversation: LinuxcncClient) -> None:
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

    def _await_start(self, conversation: LinuxcncClient, target: Target) -> None:
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
        conversation: LinuxcncClient,
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
        self, conversation: LinuxcncClient, error: DeviceRefused
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

    def _cut_power(self, conversation: LinuxcncClient) -> None:
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


PARTS = (1, 2, 4, 8, 16)
LOOKS_A_PART = 8
REMEDY = "jog the robot towards the workspace's centre, or allow the joints more on their way"


def way_to(
    kinematics: Kinematics, passing: JointLimits, from_rad: Sequence[float], to_rad: Sequence[float]
) -> tuple[Pose, ...]:
    """Poses to pass, the last being that of `to_rad`; raises `LimitViolation`."""
    start, end = kinematics.pose(from_rad), kinematics.pose(to_rad)
    for parts in PARTS:
        between = (_between(from_rad, to_rad, part / parts) for part in range(1, parts))
        poses = (*map(kinematics.pose, between), end)
        if all(_is_within(kinematics, passing, *leg) for leg in pairwise((start, *poses))):
            return poses
    raise LimitViolation(
        f"no way to its target keeps the joints within "
        f"{passing.text()} on {PARTS[-1]} straight parts",
        remedy=REMEDY,
        code="WAY",
    )


def _is_within(kinematics: Kinematics, passing: JointLimits, start: Pose, end: Pose) -> bool:
    try:
        for pose in _along(start, end):
            passing.check(kinematics.joints(pose))
    except LimitViolation:
        return False
    return True


def _along(start: Pose, end: Pose) -> Iterator[Pose]:
    """Poses on the straight line, without its ends."""
    for look in range(1, LOOKS_A_PART):
        yield Pose(*_between(start.coordinates, end.coordinates, look / LOOKS_A_PART))


def _between(first: Sequence[float], last: Sequence[float], part: float) -> tuple[float, ...]:
    return tuple(one + part * (other - one) for one, other in zip(first, last, strict=True))
