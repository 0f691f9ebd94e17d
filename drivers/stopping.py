"""Stopping a robot: tried until it is confirmed, whatever wire and operator do meanwhile.

A stop meets the wire in any state, and may wait neither for a pending answer nor for another call:

* A question may be open. The wish to stop abandons it, which closes its connection (link.py); the
  stop goes over a new one, as the first word on it (docs/reference/robotline.md, STOP).
* A connection may be dead without a sign. A try waits for its answer for `answer_s` only; then it
  is left for a new one, which waits longer, so that a controller that is only slow is heard as
  well.
* The operator's wish stays set while the robot stops. It must not abandon the stop's own questions.

Only the controller's word that the robot stands ends a stop. Without it the operator is alarmed
after the first try, while trying goes on, and after `within_s` the stop ends in
`RobotStateUnknown`. It is no safety function and replaces no emergency stop circuit.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drivers.errors import PRESS_THE_EMERGENCY_STOP, DriverError, MotionFault, RobotStateUnknown
from drivers.polling import wait_for
from drivers.ports import Clock
from drivers.session import Connected, DeviceSession

PATIENCE_GROWTH = 4.0
"""Factor from one try's patience to the next: a link that is dead is soon left for a new one, and
a controller that is only slow is waited for in the end."""


Alarm = Callable[[str], None]
"""What the operator has to read at once."""


def unheard(_alarm: str) -> None:
    """Alarm without effect."""


StopOnce = Callable[[float, float], None]
"""One try to stop and to see the robot stand; raises `DriverError`.

It may watch until the clock shows the first number, s, and waits for each answer for the second. It
may open a connection where there is none.
"""


class StopProcedure:
    """Stop of a robot: how it is done, and whether it is under way. `clock` is real time.

    `answer_s` is the first try's patience with an answer; `alarm` is raised when that was in vain.
    """

    def __init__(
        self,
        clock: Clock,
        *,
        within_s: float,
        answer_s: float,
        pause_s: float,
        cancelled: Callable[[], bool],
        alarm: Alarm = unheard,
    ) -> None:
        self._clock = clock
        self._within_s = within_s
        self._answer_s = answer_s
        self._pause_s = pause_s
        self._cancelled = cancelled
        self._alarm = alarm
        # A count: a stop may begin inside a block that is undisturbed already.
        self._undisturbed = 0
        # Clock's seconds at which the stop under way is given up; None: no stop is under way.
        self._give_up_s: float | None = None
        # Patience of the present try with an answer, s.
        self._try_s = answer_s
        # Clock's seconds from which the operator is alarmed; infinite once that has been done.
        self._alarm_s = math.inf

    @property
    def is_under_way(self) -> bool:
        """Whether the robot is being stopped now."""
        return self._give_up_s is not None

    def at_most_s(self, seconds: float) -> float:
        """Return the seconds, or less where a stop that is under way has less left."""
        if self._give_up_s is None:
            return seconds
        # Never less than a pause: a limit of zero would let no answer come at all.
        return min(seconds, max(self._give_up_s - self._clock.now_s(), self._pause_s))

    def patience_s(self, seconds: float) -> float:
        """Return the seconds to connect in: during a stop at most the present try's patience."""
        return self.at_most_s(min(seconds, self._try_s) if self.is_under_way else seconds)

    def is_cancelled(self) -> bool:
        """Return whether the operator wants to stop, False where that may not disturb."""
        return not self._undisturbed and self._cancelled()

    @contextmanager
    def undisturbed(self) -> Iterator[None]:
        """Abandon nothing for the operator's wish: the robot stands, or is being stopped."""
        self._undisturbed += 1
        try:
            yield
        finally:
            self._undisturbed -= 1

    def insist(
        self, session: DeviceSession[Connected], stop_once: StopOnce, leave: Callable[[], None]
    ) -> None:
        """Try again and again until the stop is confirmed; raises `RobotStateUnknown`.

        A connection that a try has opened is left at the end: what comes after the stop waits for a
        reconnection.
        """
        # A try opens connections without a greeting. No one has asked there who answers, so that
        # nothing but a stop may go over them.
        before = session.latest
        with self.undisturbed():
            self._give_up_s = self._clock.now_s() + self._within_s
            try:
                self._try_until_confirmed(stop_once, self._give_up_s)
            finally:
                self._give_up_s = None
                if session.latest is not before:
                    leave()

    def _try_until_confirmed(self, stop_once: StopOnce, give_up_s: float) -> None:
        # The patience is this stop's own: an earlier one may have left a long one behind.
        self._try_s, self._alarm_s = self._answer_s, self._clock.now_s() + self._answer_s
        while True:
            try:
                return stop_once(give_up_s, self.at_most_s(self._try_s))
            except DriverError as error:
                # A refusal too is tried again: nothing but a confirmation ends a stop.
                if self._clock.now_s() + self._pause_s >= give_up_s:
                    raise state_unknown(
                        f"the stop was not confirmed within {self._within_s:g} s ({error.problem})"
                    ) from error
                self._alarm_once(error.problem)
            self._clock.sleep_s(self._pause_s)
            self._try_s *= PATIENCE_GROWTH

    def await_standstill(self, is_moving: Callable[[], bool], *, give_up_s: float) -> None:
        """Return when the robot stands; raises `MotionFault` when it moves on until `give_up_s`.

        The operator is alarmed as soon as without an answer: an accepted stop may have no effect.
        """

        def stands() -> bool:
            if not is_moving():
                return True
            if self._clock.now_s() >= self._alarm_s:
                self._alarm_once("it still moves")
            return False

        if not wait_for(stands, self._clock, give_up_s=give_up_s, pause_s=self._pause_s):
            raise MotionFault("it still moves", remedy="use the hardware stop")

    def _alarm_once(self, why: str) -> None:
        """Alarm unless this stop has raised one already."""
        if self._alarm_s < math.inf:
            self._alarm_s = math.inf
            self._alarm(
                f"{PRESS_THE_EMERGENCY_STOP} unless you see the robot stand: "
                f"it has not confirmed its stop yet ({why})"
            )


def state_unknown(problem: str) -> RobotStateUnknown:
    """Return the error for a robot of which no one knows whether it stands."""
    return RobotStateUnknown(f"robot state unknown: {problem}", remedy="use the hardware stop")
