"""First contact: one joint moves a little and back, to see whether a server keeps its promises.

A program has to rely on what a controller's server says of a motion. Most mistakes of a first
server make a run measure a robot that still moves, or leave it moving unwatched. So
before the first run one joint moves by a twentieth of its range, slowly, by a checked way:

1. There, asked all the time: joints between the ends have to be read, and `moving` is 1 meanwhile.
2. Back, and nothing is asked for 3 s on the way: a controller with a watchdog stops the robot.
   Then the robot goes where it began.

The operator's wish to stop is looked at all the time. Whatever goes wrong, the robot is stopped.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from campaigns.errors import NotSettled, TargetOutOfReach
from campaigns.measuring.motion import Mover
from campaigns.measuring.motion_watch import AWAY_RAD, LONG_LEG_RAD, REMEDY
from campaigns.measuring.run_state import EngineState
from campaigns.planning.paths import Joints, RobotModel
from campaigns.settings.sections import SettleConfig
from drivers.errors import ImplausibleAnswer
from drivers.ports import Clock, RobotController

RANGE_SHARE = 0.05
"""Share of a joint's range by which it moves."""
SPEED_FRACTION = 0.01
"""Speed, of the allowed one: a joint that turns by 180° a second takes 7 s for its twentieth."""
UNASKED_S = 3.0
"""Time without a question: the page's watchdog stops after 2 s."""
STANDS_S = 0.5
"""Time after which a robot that stands is read again."""
TIMEOUT_S = 120.0
"""Longest wait for one of these slow moves."""
POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class FirstContact:
    """What a small motion has shown of a controller."""

    joint: int
    """Joint that moved."""
    travel: float
    """Its travel there, rad or mm."""
    has_watchdog: bool | None
    """Whether the robot stops when nothing is asked; None: the motion was over before."""


class ContactTest:
    """Test of one controller by a small motion of its robot."""

    def __init__(
        self,
        robot: RobotController,
        clock: Clock,
        model: RobotModel,
        settle: SettleConfig,
        stop_requested: Callable[[], bool],
    ) -> None:
        self._robot, self._clock, self._model = robot, clock, model
        slow = settle.model_copy(update={"timeout_s": TIMEOUT_S})
        self._mover = Mover(robot, clock, SPEED_FRACTION, slow, model, stop_requested)

    def plan(self) -> tuple[Joints, int]:
        """Return joints to which the robot may move from where it stands, and the joint that does.

        Raise `TargetOutOfReach` if no joint can move so far.
        """
        here = self._mover.require_sound().joints
        kinematics, centre = self._model.kinematics, self._model.centre
        least = LONG_LEG_RAD * kinematics.mechanism.joint_scales
        inwards = np.where(kinematics.inverse(centre[None]).values[0] > here, 1.0, -1.0)
        for side in (1.0, -1.0):
            for joint, (low, high) in enumerate(self._model.limits.of_joints(len(here))):
                travel = max(RANGE_SHARE * (high - low), float(least[joint]))
                there = np.array(here)
                there[joint] += side * inwards[joint] * travel
                if low <= there[joint] <= high and not self._model.fault(np.array(here), there):
                    return tuple(there.tolist()), joint
        raise TargetOutOfReach(
            f"no joint can move by {RANGE_SHARE:.0%} of its range from where the robot stands",
            remedy="jog the robot near the workspace's centre, then try again",
        )

    def move(self) -> FirstContact:
        """Move there and back; raise `ImplausibleAnswer` for a server that cannot be trusted.

        Raise the errors of `Mover.go`. The robot is stopped first.
        """
        target, joint = self.plan()
        here = self._mover.require_sound().joints
        try:
            self._move_there(target)
            has_watchdog = self._stops_unasked(here)
            self._mover.return_to(here, "back to where it began", _unshown)
        except BaseException:
            self._robot.stop()
            raise
        return FirstContact(joint, target[joint] - here[joint], has_watchdog)

    def _move_there(self, target: Joints) -> None:
        """Move to joints; raise `ImplausibleAnswer` where the motion is not seen."""
        watch = self._mover.return_to(target, "to the test's place", _unshown).watch
        if not self._robot.knows_its_time:
            return  # a simulated robot's motion may be over between two readings
        if not watch.passed:
            raise ImplausibleAnswer(
                "no joints between start and target were read while the robot moved: these may be "
                "targets, not encoders",
                remedy=REMEDY,
            )
        if not watch.moved:
            raise ImplausibleAnswer(
                "the controller reported that the robot stands (moving 0) all the way",
                remedy=REMEDY,
            )

    def _stops_unasked(self, target: Joints) -> bool | None:
        """Begin a move, ask nothing for a time, and return whether it has been stopped."""
        start = self._mover.require_sound().joints
        self._mover.check_stop()
        self._robot.move_joints(target, SPEED_FRACTION)
        # on its way first: a controller may take a moment until the axes turn
        give_up_s = self._clock.now_s() + TIMEOUT_S
        while self._apart(start) <= AWAY_RAD:
            if self._clock.now_s() > give_up_s:
                raise NotSettled(
                    f"the robot has not begun its way back within {TIMEOUT_S:g} s",
                    remedy="look for what holds it, then try again",
                )
            self._mover.pause(POLL_S)
        self._mover.pause(UNASKED_S)
        self._mover.require_sound()
        self._mover.pause(STANDS_S)  # a robot that was stopped just now may still brake
        then = self._mover.require_sound()
        if self._apart(target) <= AWAY_RAD:
            return None
        self._mover.pause(STANDS_S)
        return not then.moving and self._apart(then.joints) <= AWAY_RAD

    def _apart(self, joints: Joints) -> float:
        """Return how far the robot is from joints, in comparable radians."""
        here = self._mover.require_sound().joints
        comparable = self._model.kinematics.comparable(np.subtract(here, joints))
        return float(np.abs(comparable).max())


def _unshown(_state: EngineState) -> None:
    """Show nothing."""
