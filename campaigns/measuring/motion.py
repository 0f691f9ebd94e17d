"""Motion: moves the robot by safe ways, and waits until it stands still in place.

Nothing moves before a whole way from where the robot stands to the target has been found in the
model. Every wait for the robot looks at four things in each round: the operator's wish to stop, the
emergency stop, the controller's faults and the deadline; so each of them is answered within one
poll. The wish to stop is looked at once more right before a motion is commanded.

Nothing in this module stops the robot: an exception that leaves it makes the engine do so.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf

import numpy as np

from campaigns.errors import Interrupted, JogRequired, NotSettled, TargetOutOfReach
from campaigns.kinematics.axes import Axis
from campaigns.measuring.motion_watch import MotionWatch
from campaigns.measuring.run_state import EngineState
from campaigns.planning.paths import Joints, RobotModel
from campaigns.planning.steps import Step
from campaigns.robots.robot import pose_row
from campaigns.settings.sections import SettleConfig
from drivers.errors import EmergencyStop, MotionFault
from drivers.ports import Clock, RobotController
from drivers.values import Pose, RobotState

POLL_S = 0.02
"""How often a robot is looked at while it settles."""
MOVING_POLL_S = 0.05
"""How often it is looked at on its way; a wish to stop ends the sleep between."""
WAYS_AT_ONCE = 32
"""Number of moves whose ways are found together: a robot waits for it a fraction of a second."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """Robot at rest in place, with the beginning of its last leg and the durations."""

    state: RobotState
    """State as it was read at the end of the settling time."""
    came_from: Joints
    """Joints as they were read where the last leg of the way began; backlash depends on them."""
    move_s: float
    settle_s: float
    watch: MotionWatch
    """Watch of the last leg."""


@dataclass(frozen=True, slots=True)
class _Target:
    """Joints to which a robot is sent, and how far from them it may be in place."""

    joints: Joints
    play: Joints = ()
    """Distance of each joint, rad or mm, by which a controller may take a pose differently; of a
    command by joints ()."""


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
        """Target at which the robot settled last."""
        self._moves: tuple[tuple[Joints, Joints], ...] = ()
        """Moves between the stops of a series, in its order."""
        self._ways: dict[tuple[Joints, Joints], list[Joints] | None] = {}
        """Safe ways of moves of the series, as far as they were needed; None where none is."""
        self._plays: dict[Pose, Joints] = {}
        """How far from their joints a controller may take the poses of the series, rad or mm."""

    def foresee(self, steps: Sequence[Step]) -> None:
        """Take the steps of a series, between whose stops ways will be needed in this order."""
        stops = [joints for step in steps for joints in (*step.approach, step.planned.joints)]
        self._moves, self._ways = tuple(pairwise(stops)), {}
        posed = [step.planned.pose for step in steps if step.command != "joints"]
        self._plays = dict(zip(posed, self._plays_of(posed), strict=True)) if posed else {}

    def go(self, step: Step, entering: Callable[[EngineState], None]) -> Arrival:
        """Take the step's way and settle at its end; `entering` gets each new state.

        Before anything moves raise `TargetOutOfReach` if no safe way is known, or `JogRequired` if
        none leads out of where the robot may not be. At any time raise `NotSettled`, `Interrupted`
        or a driver's error.
        """
        here = self._await_rest()
        way = self._way_of(self._standing_joints(here), step)
        target = _Target(way[-1], self._play_of(step))
        return self._take_way((way[:-1], target), here, lambda: self._start(step), entering)

    def return_to(
        self, joints: Joints, name: str, entering: Callable[[EngineState], None]
    ) -> Arrival:
        """Take a safe way to joints outside the plan; `name` describes them in an error.

        Raise the errors of `go`.
        """
        here = self._await_rest()
        way = self._safe_legs(self._standing_joints(here), joints, name)
        target = _Target(way[-1])
        return self._take_way(
            (way[:-1], target), here, lambda: self._start_joints(joints), entering
        )

    def pause(self, seconds: float) -> None:
        """Wait; raise `Interrupted` as soon as the operator asks to stop."""
        until_s = self._clock.now_s() + seconds
        while (left_s := until_s - self._clock.now_s()) > 0.0:
            self.check_stop()
            self._clock.sleep_s(min(left_s, POLL_S))

    def _take_way(
        self,
        way: tuple[Sequence[Joints], _Target],
        last_stop: RobotState,
        start: Callable[[], None],
        entering: Callable[[EngineState], None],
    ) -> Arrival:
        """Pass the joints of a way to its target; `start` begins the last leg. Settle there."""
        # The robot halts at the end of each leg: the ways are checked leg by leg, and a controller
        # that blends two of them would cut the corner. Each leg has a deadline of its own.
        entering(EngineState.MOVING)
        started_s = self._clock.now_s()
        stops, target = way
        for passed in stops:
            watch = self._watch(last_stop, passed)
            self._start_joints(passed)
            last_stop = self._await_arrival(_Target(passed), self._deadline_s(), watch)
        watch = self._watch(last_stop, target.joints)
        start()
        deadline_s = self._deadline_s()  # of the last leg and the settling together
        self._await_arrival(target, deadline_s, watch)
        arrived_s = self._clock.now_s()
        entering(EngineState.SETTLING)
        state = self._await_settled(target, deadline_s)
        self._last_target = target.joints
        settle_s = self._clock.now_s() - arrived_s
        return Arrival(state, last_stop.joints, arrived_s - started_s, settle_s, watch)

    def _watch(self, last_stop: RobotState, target: Joints) -> MotionWatch:
        """Return a watch of the leg that is commanded next."""
        # no time is too short for a simulated robot whose seconds may be shorter than the clock's
        ends, speed = (last_stop.joints, target), self._speed_fraction
        speed = speed if self._robot.knows_its_time else inf
        return MotionWatch(ends, self._axes, speed, self._clock.now_s())

    def has_moved(self, since: RobotState) -> bool:
        """Return whether the robot has left the place where it was read; raise its faults."""
        now = self.require_sound()
        distances = self._distances(now, since.joints)
        return now.moving or not _are_within(distances, self._settle.still_rad)

    def check_stop(self) -> None:
        """Raise `Interrupted` when the operator has asked to stop."""
        if self._stop_requested():
            raise Interrupted("stopped by the operator", remedy="the same command resumes it")

    def require_sound(self) -> RobotState:
        """Return the robot's state; raise `EmergencyStop` or `MotionFault` if it reports one."""
        # The only place that reads the state: no loop can forget to look at the faults.
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

    def _await_rest(self) -> RobotState:
        """Wait until the robot stands before a motion of ours; return its state.

        Raise `NotSettled` if someone else keeps it moving.
        """
        # A way that begins where the robot was a moment ago is not the way that was checked.
        deadline_s = self._deadline_s()
        while True:
            self.check_stop()
            # The time is read before the state: a process that has slept past the deadline still
            # looks at the robot once before it gives up.
            is_late = self._clock.now_s() >= deadline_s
            state = self.require_sound()
            if not state.moving:
                return state
            if is_late:
                raise NotSettled(
                    f"the robot has been moving for {self._settle.timeout_s:g} s unasked",
                    remedy="stop it at the controller, then run again",
                )
            self._clock.sleep_s(POLL_S)

    def _standing_joints(self, state: RobotState) -> Joints:
        """Return the robot's last target if it stands there, else the joints as they were read."""
        # As read, they differ a little from the target. From the target itself the way is the one
        # that the plan was checked with.
        last = self._last_target
        return (
            last if last is not None and self._is_in_place(state, _Target(last)) else state.joints
        )

    def _way_of(self, here: Joints, step: Step) -> list[Joints]:
        """Return the joint targets of a safe way, the last one being the step's."""
        # Joints to pass where the robot stands already are left out. The step's own target is
        # commanded even then: every way ends with it.
        way: list[Joints] = []
        for target in (*step.approach, step.planned.joints):
            if target != here or target is step.planned.joints:
                way += self._safe_legs(here, target, f"to shot {step.planned.shot}")
            here = target
        return way

    def _safe_legs(self, here: Joints, target: Joints, name: str) -> list[Joints]:
        """Return the legs of a safe way; raise `JogRequired` or `TargetOutOfReach`."""
        # Two errors with two remedies: a robot that has no way out of where it may not be can go
        # nowhere, and the run ends; one without a way to this target goes on with the next.
        legs = self._legs(here, target)
        if legs is None and (fault := self._model.standing_fault(here)):
            raise JogRequired(
                f"no way {name}: the robot stands where it may not be: {fault}",
                remedy="jog it out of there, or correct `space` in campaign.yaml, then run again",
            )
        if legs is None:
            raise TargetOutOfReach(
                f"no safe way {name} from joints {_joints_text(self._axes, here)}",
                remedy="jog the robot near the workspace's centre, then run again",
            )
        return legs

    def _legs(self, here: Joints, target: Joints) -> list[Joints] | None:
        """Return the legs of a safe way between joints, None if none was found."""
        # The ways of the next moves of a series are found together: one by one, before each
        # motion, they take four times as long. Other moves, as after a skipped shot, stand alone.
        move = here, target
        if move in self._ways:
            return self._ways[move]
        first = self._moves.index(move) if move in self._moves else len(self._moves)
        moves = self._moves[first : first + WAYS_AT_ONCE] or (move,)
        ways = dict(zip(moves, self._model.legs_of(moves), strict=True))
        self._ways |= ways
        return ways[move]

    def _deadline_s(self) -> float:
        """Return the time by which a move that begins now must have ended and settled."""
        return self._clock.now_s() + self._settle.timeout_s

    def _start(self, step: Step) -> None:
        """Command the step's target: its joints, or a pose that the controller solves itself."""
        if step.command == "joints":
            self._start_joints(step.planned.joints)
            return
        self.check_stop()
        pose = step.corrected or step.planned.pose
        self._robot.move_pose(pose, self._speed_fraction)

    def _start_joints(self, target: Joints) -> None:
        self.check_stop()  # the last moment at which a wish to stop costs no motion
        self._robot.move_joints(target, self._speed_fraction)

    def _await_arrival(self, target: _Target, deadline_s: float, watch: MotionWatch) -> RobotState:
        """Wait until the robot stands in place; return its state, or raise `NotSettled`.

        Raise `ImplausibleAnswer` for readings that no robot can give.
        """
        # At rest and in place: a controller may report rest before the motion has begun, and a
        # robot that overshoots is in place for a moment while it moves.
        while True:
            self.check_stop()
            is_late = self._clock.now_s() >= deadline_s
            state = self.require_sound()
            if self._robot.shows_motion:
                watch.see(state, self._clock.now_s())
            if not state.moving and self._is_in_place(state, target):
                return state
            if is_late:
                raise self._not_there(state, target)
            self._clock.sleep_s(MOVING_POLL_S)

    def _await_settled(self, target: _Target, deadline_s: float) -> RobotState:
        """Wait until the joints have been still, and in place, for the settling time.

        Return the state at its end; raise `NotSettled` after the deadline.
        """
        # Stillness is measured against a reference reading, not against the reading before: a slow
        # creep has small steps. Each motion beyond the limit begins the settling time again, with
        # the present reading as the new reference.
        #
        # A robot that stands in place is allowed one more settling time after the first look that
        # comes too late: this process may have slept, as with a laptop whose lid was closed.
        give_up_s = inf
        since_s, reference = self._clock.now_s(), self.require_sound()
        last_motion = (0, 0.0)
        while True:
            self._clock.sleep_s(POLL_S)
            self.check_stop()
            now_s = self._clock.now_s()
            state = self.require_sound()
            motion = self._distances(state, reference.joints)
            is_still = not state.moving and _are_within(motion, self._settle.still_rad)
            if not is_still:
                since_s, reference, last_motion = now_s, state, _worst(motion)
            is_in_place = self._is_in_place(state, target)
            if is_still and is_in_place and now_s >= since_s + self._settle.time_s:
                return state
            if now_s < deadline_s:
                continue
            if state.moving or not is_in_place:
                raise self._not_there(state, target)
            give_up_s = min(give_up_s, now_s + self._settle.time_s)
            if now_s >= give_up_s:
                raise self._not_settled(self._why_not_still(*last_motion))

    def _is_in_place(self, state: RobotState, target: _Target) -> bool:
        return _are_within(self._distances_from(target, state), self._settle.in_place_rad)

    def _not_there(self, state: RobotState, target: _Target) -> NotSettled:
        """Return the error of a robot that is not in place, or still moves there."""
        why = self._why_not_there(state, target)
        if target.play and not state.moving:
            return self._not_settled(
                why,
                remedy="see whether anything holds the robot; if not, its controller computes the "
                "pose otherwise than by the parameters that it shows",
            )
        return self._not_settled(why)

    def _not_settled(
        self,
        why: str,
        remedy: str = "look for what holds or shakes the robot, then at `settle` in campaign.yaml",
    ) -> NotSettled:
        since = f"{self._settle.timeout_s:g} s after the move began"
        return NotSettled(f"{why}, {since}", remedy=remedy)

    def _play_of(self, step: Step) -> Joints:
        """Return how far from the step's joints a controller may take its pose, rad or mm."""
        # A plan has the joints of a pose in the middle of their lost motion. A controller that
        # compensates it adds or takes off half of it, by the side from which each joint arrives.
        # A way round, or a way that is taken up again, may arrive from another side than the plan.
        if step.command == "joints":
            return ()
        pose = step.planned.pose
        return self._plays[pose] if pose in self._plays else self._plays_of([pose])[0]

    def _plays_of(self, poses: Sequence[Pose]) -> list[Joints]:
        """Return half of the lost motion of each joint at poses, rad or mm."""
        kinematics, rows = self._model.kinematics, np.array([pose_row(pose) for pose in poses])
        sides = np.ones((len(rows), len(self._axes)))
        above, below = (kinematics.inverse(rows, side).values for side in (sides, -sides))
        return [tuple(play) for play in (0.5 * np.abs(above - below)).tolist()]

    def _distances_from(self, target: _Target, state: RobotState) -> list[float]:
        """Return the distance of each joint from where it is in place, in comparable radians."""
        away = self._distances(state, target.joints)
        if not target.play:
            return away
        play = (wide / axis.scale for axis, wide in zip(self._axes, target.play, strict=True))
        return [max(0.0, far - wide) for far, wide in zip(away, play, strict=True)]

    def _distances(self, state: RobotState, others: Joints) -> list[float]:
        """Return the distance of each joint from another value, in comparable radians."""
        # The limits in campaign.yaml are angles. A carriage's mm are divided by those that compare
        # with one radian of a crank.
        joints = zip(self._axes, state.joints, others, strict=True)
        return [abs(here - other) / axis.scale for axis, here, other in joints]

    def _why_not_there(self, state: RobotState, target: _Target) -> str:
        joint, away = _worst(self._distances_from(target, state))
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


def _are_within(sizes: Sequence[float], limit: float) -> bool:
    """Return whether all sizes are within the limit; NaN is not."""
    return all(size <= limit for size in sizes)


def _worst(sizes: Sequence[float]) -> tuple[int, float]:
    """Return the joint of the largest size, and that size."""
    return max(enumerate(sizes), key=lambda entry: entry[1])


def _joints_text(axes: Sequence[Axis], joints: Joints) -> str:
    texts = (axis.text(value, ".3f") for axis, value in zip(axes, joints, strict=True))
    return f"({', '.join(texts)})"
