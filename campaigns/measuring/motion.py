"""Motion: the robot moved by safe ways, and waited for until it stands still in place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf

from campaigns.errors import Interrupted, JogRequired, NotSettled, TargetOutOfReach
from campaigns.kinematics.axes import Axis
from campaigns.measuring.run_state import EngineState
from campaigns.planning.paths import Joints, RobotModel
from campaigns.planning.steps import Step
from campaigns.settings.sections import SettleConfig
from drivers.errors import EmergencyStop, MotionFault
from drivers.ports import Clock, RobotController
from drivers.values import RobotState

POLL_S = 0.02
"""How often a robot is looked at while it settles."""
MOVING_POLL_S = 0.05
"""How often it is looked at on its way; a wish to stop ends the sleep between."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """Robot at rest in place, from where it came there, and what it took."""

    state: RobotState
    came_from: Joints
    """The joints as they were read where the last leg of the way began."""
    move_s: float
    settle_s: float


class Mover:
    """Mover of one robot. Every wait looks at faults, at the deadline and at the wish to stop."""

    def __init__(
        self,
        robot: RobotController,
        clock: Clock,
        speed_fraction: float,
        settle: SettleConfig,
        model: RobotModel,
        stop_requested: Callable[[], bool],
    ) -> None:
        self._robot = robot
        self._clock = clock
        self._speed_fraction = speed_fraction
        self._settle = settle
        self._model = model
        self._axes = model.kinematics.mechanism.joints
        self._stop_requested = stop_requested
        self._last_target: Joints | None = None

    def go(self, step: Step, entering: Callable[[EngineState], None]) -> Arrival:
        """Take the step's way and settle at its end; `entering` gets each new state.

        Raises before anything moves `TargetOutOfReach` when no safe way is known and `JogRequired`
        when none may begin here; `NotSettled`, `Interrupted`, or a driver's error.
        """
        here = self._at_rest()
        way = self._way(self._stop_of(here), step)
        return self._take(way, here, lambda: self._start(step), entering)

    def return_to(
        self, joints: Joints, name: str, entering: Callable[[EngineState], None]
    ) -> Arrival:
        """Take a safe way to joints that are none of a step's; `name` says where that is.

        Raises like `go`.
        """
        here = self._at_rest()
        way = self._legs(self._stop_of(here), joints, name)
        return self._take(way, here, lambda: self._start_joints(joints), entering)

    def pause(self, seconds: float) -> None:
        """Wait, looking at the wish to stop all the time; raise `Interrupted`."""
        until_s = self._clock.now_s() + seconds
        while (left_s := until_s - self._clock.now_s()) > 0.0:
            self.check_stop()
            self._clock.sleep_s(min(left_s, POLL_S))

    def require_sound(self) -> None:
        """Raise `EmergencyStop` or `MotionFault` if the robot has one."""
        self._state()

    def _take(
        self,
        way: Sequence[Joints],
        last_stop: RobotState,
        start: Callable[[], None],
        entering: Callable[[EngineState], None],
    ) -> Arrival:
        """Take the legs of a way, whose last one `start` begins, and settle at its end."""
        entering(EngineState.MOVING)
        started_s = self._clock.now_s()
        for passed in way[:-1]:
            self._start_joints(passed)
            last_stop = self._await_arrival(passed, self._deadline_s())
        start()
        deadline_s = self._deadline_s()
        target = way[-1]
        self._await_arrival(target, deadline_s)
        arrived_s = self._clock.now_s()
        entering(EngineState.SETTLING)
        state = self._settled(target, deadline_s)
        self._last_target = target
        settle_s = self._clock.now_s() - arrived_s
        return Arrival(state, last_stop.joints, arrived_s - started_s, settle_s)

    def has_moved(self, since: RobotState) -> bool:
        """Return whether the robot has left the place where it was read; raise its faults."""
        now = self._state()
        return now.moving or not _within(self._apart(now, since.joints), self._settle.still_rad)

    def check_stop(self) -> None:
        """Raise `Interrupted` when the operator has asked to stop."""
        if self._stop_requested():
            raise Interrupted("stopped by the operator", remedy="the same command resumes it")

    def _state(self) -> RobotState:
        """Return the robot's state; raise `EmergencyStop` or `MotionFault`."""
        state = self._robot.state()
        if state.emergency_stop:
            raise EmergencyStop(
                "the emergency stop is pressed", remedy="make the cell safe, release it, run again"
            )
        if state.fault:
            raise MotionFault(
                f"the controller reports '{state.fault}'",
                remedy="clear the fault at the controller, run again",
                code=state.fault,
            )
        return state

    def _at_rest(self) -> RobotState:
        """Return the robot's state before a motion, once no one else is moving it."""
        deadline_s = self._deadline_s()
        while True:
            self.check_stop()
            is_late = self._clock.now_s() >= deadline_s
            state = self._state()
            if not state.moving:
                return state
            if is_late:
                raise NotSettled(
                    f"the robot has been moving for {self._settle.timeout_s:g} s unasked",
                    remedy="stop it at the controller, then run again",
                )
            self._clock.sleep_s(POLL_S)

    def _stop_of(self, state: RobotState) -> Joints:
        """Return where the robot stands: its last target if it is there, else as it was read."""
        last = self._last_target
        return last if last is not None and self._in_place(state, last) else state.joints

    def _way(self, here: Joints, step: Step) -> list[Joints]:
        """Return the joint targets of a safe way, the last one being the step's."""
        way: list[Joints] = []
        for target in (*step.approach, step.planned.joints):
            if target != here or target is step.planned.joints:  # else it stands there
                way += self._legs(here, target, f"to shot {step.planned.shot}")
            here = target
        return way

    def _legs(self, here: Joints, target: Joints, name: str) -> list[Joints]:
        legs = self._model.legs(here, target)
        if legs is None and (fault := self._model.standing_fault(here)):
            raise JogRequired(
                f"no way {name}: the robot stands where it may not be: {fault}",
                remedy="jog it out of there, or correct `space` in campaign.yaml, then run again",
            )
        if legs is None:
            raise TargetOutOfReach(
                f"no safe way {name} from joints {_listed(self._axes, here)}",
                remedy="jog the robot near the workspace's centre, then run again",
            )
        return legs

    def _deadline_s(self) -> float:
        """Return the time by which a move that begins now must have ended and settled."""
        return self._clock.now_s() + self._settle.timeout_s

    def _start(self, step: Step) -> None:
        if step.command == "joints":
            self._start_joints(step.planned.joints)
            return
        self.check_stop()
        pose = step.corrected or step.planned.pose
        self._robot.move_pose(pose, self._speed_fraction)

    def _start_joints(self, target: Joints) -> None:
        self.check_stop()
        self._robot.move_joints(target, self._speed_fraction)

    def _await_arrival(self, target: Joints, deadline_s: float) -> RobotState:
        """Wait until the controller has stopped moving, and in place: the next way starts there."""
        while True:
            self.check_stop()
            is_late = self._clock.now_s() >= deadline_s
            state = self._state()
            if not state.moving and self._in_place(state, target):
                return state
            if is_late:
                raise self._not_settled(self._why_not_there(state, target))
            self._clock.sleep_s(MOVING_POLL_S)

    def _settled(self, target: Joints, deadline_s: float) -> RobotState:
        """Wait until the joints have been still, and in place, for the settling time.

        A robot that stands in place is allowed one settling time after the first look that comes
        too late: this process may have slept, as with a laptop whose lid was closed.
        """
        give_up_s = inf
        since_s, reference = self._clock.now_s(), self._state()
        last_motion = (0, 0.0)
        while True:
            self._clock.sleep_s(POLL_S)
            self.check_stop()
            now_s = self._clock.now_s()
            state = self._state()
            motion = self._apart(state, reference.joints)
            still = not state.moving and _within(motion, self._settle.still_rad)
            if not still:
                since_s, reference, last_motion = now_s, state, _worst(motion)
            in_place = self._in_place(state, target)
            if still and in_place and now_s >= since_s + self._settle.time_s:
                return state
            if now_s < deadline_s:
                continue
            if state.moving or not in_place:
                raise self._not_settled(self._why_not_there(state, target))
            give_up_s = min(give_up_s, now_s + self._settle.time_s)
            if now_s >= give_up_s:
                raise self._not_settled(self._why_not_still(*last_motion))

    def _in_place(self, state: RobotState, target: Joints) -> bool:
        return _within(self._apart(state, target), self._settle.in_place_rad)

    def _not_settled(self, why: str) -> NotSettled:
        return NotSettled(
            f"{why}, {self._settle.timeout_s:g} s after the move began",
            remedy="look for what holds or shakes the robot, then at `settle` in campaign.yaml",
        )

    def _apart(self, state: RobotState, others: Joints) -> list[float]:
        """Return the distance of each joint from another value, in radians of a crank or alike."""
        joints = zip(self._axes, state.joints, others, strict=True)
        return [abs(here - other) / axis.scale for axis, here, other in joints]

    def _why_not_there(self, state: RobotState, target: Joints) -> str:
        joint, away = _worst(self._apart(state, target))
        limit = self._settle.in_place_rad
        if away <= limit:
            return "the controller still reports motion"
        moves = "and still moves" if state.moving else "and stands there"
        return (
            f"joint {joint} is {self._text(joint, away, '.4f')} from its target "
            f"(limit {self._text(joint, limit, 'g')}) {moves}"
        )

    def _why_not_still(self, joint: int, moved: float) -> str:
        return (
            f"joint {joint} moved {self._text(joint, moved, '.4f')} within the settling time of "
            f"{self._settle.time_s:g} s (limit {self._text(joint, self._settle.still_rad, 'g')})"
        )

    def _text(self, joint: int, size: float, form: str) -> str:
        """Return a size in comparable radians as text in the unit of the joint."""
        axis = self._axes[joint]
        return axis.text(size * axis.scale, form)


def _within(sizes: Sequence[float], limit: float) -> bool:
    """Return whether no size exceeds the limit; NaN does."""
    return all(size <= limit for size in sizes)


def _worst(sizes: Sequence[float]) -> tuple[int, float]:
    """Return the joint of the largest size, and that size."""
    return max(enumerate(sizes), key=lambda entry: entry[1])


def _listed(axes: Sequence[Axis], joints: Joints) -> str:
    texts = (axis.text(value, ".3f") for axis, value in zip(axes, joints, strict=True))
    return f"({', '.join(texts)})"
