"""Motion of a LinuxCNC machine: moves as G-code, started, watched and stopped."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import inf, isfinite

from drivers.errors import DeviceRefused, LimitViolation, LinkDown, MotionFault
from drivers.linuxcnc.machine_state import Machine, Snapshot, agree
from drivers.linuxcnc.settings import JointLimits, Kinematics, LinuxcncSettings
from drivers.polling import comes_true
from drivers.ports import Clock
from drivers.stopping import await_standstill
from drivers.values import Pose, RobotState

DECIMALS = 6
"""Of mm and deg, as LinuxCNC tells positions: what was sent is read back to the digit."""
MINUTE_S = 60.0
SHORTEST_S = 0.05
OVERLONG_MM = 1e6
MDI = "mdi"
READINGS = 3
READING_PAUSE_S = 0.005
MESSAGES_KEPT = 5
RESTART = "see that the robot stands, restart LinuxCNC"

Place = tuple[float, ...]
"""Numbers by the machine's own letters, mm and deg."""


class Motion:
    """The motion under way. An ACK proves nothing: all it says comes from readings."""

    def __init__(self, machine: Machine, clock: Clock, settings: LinuxcncSettings) -> None:
        self._machine = machine
        self._clock = clock
        self._settings = settings
        self._deadlines = settings.deadlines
        self._target: Place | None = None
        self._messages: tuple[str, ...] = ()
        self._seen: tuple[float, ...] = ()
        self._changed_s = 0.0

    @property
    def has_started(self) -> bool:
        """True after a motion was started, until it has been seen to end."""
        return self._target is not None

    def renew(self) -> None:
        """Forget the last motion and its faults: the machine has been made ready."""
        self._target, self._messages = None, ()

    def state(self) -> RobotState:
        """Everything as read now; takes some 10 ms to be sure that the joints stand."""
        first = self._machine.snapshot()
        standing = self._standing(first)
        snapshot, moving = standing or first, standing is None
        for message in self._machine.client.messages():
            if message not in self._messages:
                self._messages = (*self._messages, message)[-MESSAGES_KEPT:]
        fault = self._fault(snapshot, moving=moving)
        if not (moving or fault):
            self._target = None
        self._machine.require_plausible(snapshot.joints)
        return RobotState(
            joints=tuple(map(self._settings.axes.from_machine, snapshot.joints)),
            moving=moving,
            fault=fault,
            emergency_stop=snapshot.emergency_stop,
            raw=snapshot.raw,
        )

    def is_moving(self) -> bool:
        """True while anything moves, whoever started it."""
        return self._standing(self._machine.snapshot()) is None

    def start(self, way: Sequence[Place], travel: float, speed_fraction: float) -> None:
        """Give the orders and see the motion begin; raises what LinuxCNC's refusal means.

        `travel` is how far the longest joint goes, rad or mm. Orders that follow are queued.
        """
        way = [rounded(place) for place in way]
        snapshot = self._machine.snapshot()
        if not snapshot.has_power:
            raise self._refusal(snapshot)
        self._machine.check_ready(snapshot)
        self._machine.enter_mdi()
        client = self._machine.client
        client.messages()  # old ones would be taken for reasons
        self._target, self._messages = way[-1], ()
        self._seen, self._changed_s = (), self._clock.now_s()
        duration_s = None
        if speed_fraction < 1.0:
            speed_per_s = speed_fraction * self._settings.full_speed_per_s
            duration_s = travel / len(way) / speed_per_s
        for place in way:
            try:
                client.order(MDI, block(self._settings.letters, place, duration_s))
            except DeviceRefused as error:
                raise self._not_taken(error) from error
        if not self._comes(lambda: self._has_begun(way[-1])):
            raise MotionFault(
                f"{client.name}: LinuxCNC has taken a move, but it has not begun within "
                f"{self._deadlines.start_s:g} s",
                remedy=f"its realtime part seems to have died: {RESTART}",
            )

    def halt(self, give_up_s: float) -> None:
        """Have the robot stand, and see it stand; raises `DriverError` when that is not seen.

        By an abort, which brakes on the path; if that is not taken, by LinuxCNC's e-stop.
        """
        client = self._machine.client
        if not client.is_on("enable"):
            client.take_control(self._settings.passwords)
        if client.is_on("machine"):
            try:
                client.order("abort")
            except DeviceRefused:
                self._cut_power(give_up_s)
        self._target = None
        await_standstill(
            self.is_moving, self._clock, give_up_s=give_up_s, pause_s=self._deadlines.poll_s
        )

    def _standing(self, first: Snapshot) -> Snapshot | None:
        """The last of several readings at which everything stood; None while anything moves."""
        latest = first
        for _ in range(READINGS - 1):
            if self._is_under_way(latest):
                return None
            self._clock.sleep_s(READING_PAUSE_S)
            latest = self._machine.snapshot()
            if not agree(latest.joints, first.joints, self._settings.still):
                return None
        return None if self._is_under_way(latest) else latest

    def _is_under_way(self, snapshot: Snapshot) -> bool:
        """True while the trajectory has way to go, as far as a machine without power can."""
        if not snapshot.machine_on:
            return False
        if self._target is None:
            return not snapshot.idle
        return not snapshot.is_commanded(self._target)

    def _fault(self, snapshot: Snapshot, *, moving: bool) -> str:
        """A fault in LinuxCNC's words where it has any; empty when nothing is wrong."""
        said = "; ".join(self._messages)
        if not snapshot.machine_on:
            return said or "the machine is off"
        if not snapshot.in_control:
            return "another client has taken control of LinuxCNC"
        if self._is_frozen(snapshot, moving=moving):
            return said or (
                f"a motion has not moved for {self._deadlines.frozen_s:g} s: "
                "feed hold, or a dead task or realtime part"
            )
        return said

    def _is_frozen(self, snapshot: Snapshot, *, moving: bool) -> bool:
        """Positions that should change have stopped changing: stale values look like it."""
        now_s, seen = self._clock.now_s(), (*snapshot.commanded, *snapshot.joints)
        if seen != self._seen or not moving:
            self._seen, self._changed_s = seen, now_s
        return now_s - self._changed_s > self._deadlines.frozen_s

    def _has_begun(self, target: Place) -> bool:
        """True when the move has begun; raises its refusal. What comes later `state` tells."""
        snapshot = self._machine.snapshot()
        messages = self._machine.client.messages()
        if messages or not snapshot.has_power:
            raise self._refusal(snapshot, messages)
        return not snapshot.idle or snapshot.is_commanded(target)

    def _refusal(self, snapshot: Snapshot, messages: Sequence[str] = ()) -> DeviceRefused:
        """The meaning of what is said now; what was refused keeps no motion."""
        error = self._machine.refusal(snapshot, messages)
        self._target = None
        return error

    def _not_taken(self, error: DeviceRefused) -> DeviceRefused | LinkDown:
        """The meaning of an order that was not even received."""
        snapshot = self._machine.snapshot()
        if not (snapshot.has_power and snapshot.in_control):
            return self._refusal(snapshot)
        self._machine.client.close()
        return LinkDown(
            f"{error.problem}: it shows a machine that is on, but takes no orders",
            remedy=f"its task or realtime part seems to have died: {RESTART}",
        )

    def _cut_power(self, give_up_s: float) -> None:
        client = self._machine.client
        client.order("estop", "on")
        if not self._comes(lambda: not client.is_on("machine"), give_up_s):
            raise MotionFault(
                f"{client.name}: LinuxCNC takes neither abort nor e-stop",
                remedy="use the hardware stop",
            )

    def _comes(self, is_so: Callable[[], bool], latest_s: float = inf) -> bool:
        give_up_s = min(self._clock.now_s() + self._deadlines.start_s, latest_s)
        return comes_true(is_so, self._clock, give_up_s=give_up_s, pause_s=self._deadlines.poll_s)


def rounded(place: Sequence[float]) -> Place:
    """Numbers as they are sent; raises `LimitViolation` for what is no place."""
    if not all(isfinite(value) and abs(value) < OVERLONG_MM for value in place):
        raise LimitViolation(f"{list(place)} is no place", remedy="check the plan")
    return tuple(round(value, DECIMALS) + 0.0 for value in place)


def block(letters: str, place: Place, duration_s: float | None) -> str:
    """The block of G-code for a move, such as `… G53 G0 X12.345679 Y…`.

    Without a duration it is the machine's own rapid (G0). Below full speed it is given one: a rapid
    does not follow the feed override in all versions, and a feed would not count the rotary letter.
    Millimetres and absolute positions are said each time: somebody may have changed them by hand.
    """
    words = " ".join(f"{a}{value:.{DECIMALS}f}" for a, value in zip(letters, place, strict=True))
    if duration_s is None:
        return f"G21 G90 G94 G53 G0 {words}"
    return f"G21 G90 G93 G53 G1 {words} F{MINUTE_S / max(duration_s, SHORTEST_S):.{DECIMALS}f}"


PARTS = (1, 2, 4, 8, 16)
LOOKS_A_PART = 8
REMEDY = "jog the robot towards the workspace's centre, or allow the joints more on their way"


def way_to(
    kinematics: Kinematics, passing: JointLimits, here: Sequence[float], there: Sequence[float]
) -> tuple[Pose, ...]:
    """Poses to pass, the last being that of the joints `there`; raises `LimitViolation`."""
    start, end = kinematics.pose(here), kinematics.pose(there)
    for parts in PARTS:
        between = (_between(here, there, part / parts) for part in range(1, parts))
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
    """True where joints keep their limits on the straight line; its ends are not looked at."""
    try:
        for look in range(1, LOOKS_A_PART):
            there = Pose(*_between(start.coordinates, end.coordinates, look / LOOKS_A_PART))
            passing.check(kinematics.joints(there))
    except LimitViolation:
        return False
    return True


def _between(first: Sequence[float], last: Sequence[float], part: float) -> tuple[float, ...]:
    return tuple(one + part * (other - one) for one, other in zip(first, last, strict=True))
