"""Moves the robot by safe ways and waits until it stands still in place."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.errors import Interrupted, NotSettled, TargetOutOfReach
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.paths import route
from campaigns.numerics.reach import Limits
from campaigns.progress import EngineState
from campaigns.rules import MotionRules
from campaigns.steps import Step
from drivers.errors import EmergencyStop, MotionFault
from drivers.ports import Clock, RobotController
from drivers.values import RobotState


@dataclass(frozen=True, slots=True, eq=False)
class Mechanism:
    """What ways are checked against."""

    geometry: Geometry
    limits: Limits
    centre: Array
    """A pose well inside the workspace, (4,)."""


@dataclass(frozen=True, slots=True)
class Arrival:
    """The robot at rest in place, and what it took."""

    state: RobotState
    move_s: float
    settle_s: float


class Mover:
    """Drives one robot. Every wait looks at faults, at the deadline and at the operator's wish to stop."""

    def __init__(
        self,
        robot: RobotController,
        clock: Clock,
        rules: MotionRules,
        mechanism: Mechanism,
        stop_requested: Callable[[], bool],
    ) -> None:
        self._robot = robot
        self._clock = clock
        self._rules = rules
        self._mechanism = mechanism
        self._stop_requested = stop_requested

    def go(self, step: Step, entering: Callable[[EngineState], None]) -> Arrival:
        """Take the step's way and settle at its end; `entering` is told each new state.

        Raises `TargetOutOfReach` before anything moves when no safe way is known, `NotSettled`,
        `Interrupted`, or a driver's error.
        """
        self.check_stop()
        started_s = self._clock.now_s()
        way = self._way(self.standing(), step)
        entering(EngineState.MOVING)
        for joints in way[:-1]:
            self._robot.move_joints(joints, self._rules.speed_fraction)
            self._await_arrival(joints)
        if step.command == "pose":
            self._robot.move_pose(step.planned.pose, self._rules.speed_fraction)
        else:
            self._robot.move_joints(way[-1], self._rules.speed_fraction)
        self._await_arrival(way[-1])
        arrived_s = self._clock.now_s()
        entering(EngineState.SETTLING)
        state = self._settled(np.array(way[-1]))
        return Arrival(state, arrived_s - started_s, self._clock.now_s() - arrived_s)

    def standing(self) -> RobotState:
        """The robot's state, checked for faults."""
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

    def has_moved(self, since: RobotState) -> bool:
        """Whether the robot has left the place where it was read before."""
        now = self.standing()
        away = np.abs(np.subtract(now.joints_rad, since.joints_rad)).max()
        return now.moving or bool(away > self._rules.still_rad)

    def check_stop(self) -> None:
        """Raise `Interrupted` when the operator has asked to stop."""
        if self._stop_requested():
            raise Interrupted(
                "stopped by the operator", remedy="`pkmcal run` takes up where it was"
            )

    def _way(self, state: RobotState, step: Step) -> list[tuple[float, ...]]:
        here = np.array(state.joints_rad)
        way: list[tuple[float, ...]] = []
        for target in (*step.approach_rad, step.planned.joints_rad):
            legs = route(
                self._mechanism.geometry,
                self._mechanism.limits,
                here,
                np.array(target),
                self._mechanism.centre,
            )
            if legs is None:
                raise TargetOutOfReach(
                    f"no safe way to shot {step.planned.shot} from joints "
                    f"{np.round(np.degrees(here), 2).tolist()}°",
                    remedy="jog the robot near the workspace's centre, then run again",
                )
            way += [tuple(leg.tolist()) for leg in legs]
            here = np.array(target)
        return way

    def _await_arrival(self, target_rad: Sequence[float]) -> None:
        """Wait until the controller says that it has stopped moving."""
        deadline_s = self._clock.now_s() + self._rules.timeout_s
        while self.standing().moving:
            self.check_stop()
            if self._clock.now_s() > deadline_s:
                raise NotSettled(
                    f"still moving to {_degrees(target_rad)} after {self._rules.timeout_s:g} s",
                    remedy="look at the robot; raise settle.timeout_s if it is only slow",
                )
            self._clock.sleep_s(self._rules.poll_s)

    def _settled(self, target: Array) -> RobotState:
        """Wait until the joints have been still, and in place, for the settling time."""
        rules = self._rules
        deadline_s = self._clock.now_s() + rules.timeout_s
        still_since_s, reference = self._clock.now_s(), self.standing()
        while True:
            self._clock.sleep_s(rules.poll_s)
            self.check_stop()
            now_s, state = self._clock.now_s(), self.standing()
            joints = np.array(state.joints_rad)
            if np.abs(joints - reference.joints_rad).max() > rules.still_rad:
                still_since_s, reference = now_s, state
            in_place = np.abs(joints - target).max() <= rules.in_place_rad
            if in_place and now_s - still_since_s >= rules.settle_s:
                return state
            if now_s > deadline_s:
                raise NotSettled(_why_not_settled(joints, target, rules), remedy=NOT_SETTLED_REMEDY)


NOT_SETTLED_REMEDY = "look for what holds or shakes the robot, then at `settle` in campaign.yaml"


def _why_not_settled(joints: Array, target: Array, rules: MotionRules) -> str:
    away = np.abs(joints - target)
    joint = int(np.argmax(away))
    if away[joint] > rules.in_place_rad:
        return (
            f"joint {joint} stands {np.degrees(away[joint]):.4f}° from its target "
            f"(limit {np.degrees(rules.in_place_rad):g}°)"
        )
    return f"the joints were not still within {np.degrees(rules.still_rad):g}° for {rules.settle_s:g} s"


def _degrees(joints_rad: Sequence[float]) -> str:
    return f"{np.round(np.degrees(joints_rad), 3).tolist()}°"
