"""Stopping a robot: tried until it is confirmed, whatever wire and operator do meanwhile."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from drivers.errors import PRESS_THE_EMERGENCY_STOP, DriverError, MotionFault, RobotStateUnknown
from drivers.polling import comes_true
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
        self._undisturbed = 0
        self._give_up_s: float | None = None
        self._try_s = answer_s
        self._alarm_s = math.inf

    @property
    def is_under_way(self) -> bool:
        """Whether the robot is being stopped now."""
        return self._give_up_s is not None

    def at_most_s(self, seconds: float) -> float:
        """Return the seconds, or less where a stop that is under way has less left."""
        if self._give_up_s is None:
            return seconds
        return min(seconds, max(self._give_up_s - self._clock.now_s(), self._pause_s))

    def patience_s(self, seconds: float) -> float:
        """Return the seconds to connect in, or what a stop's try waits before the alarm."""
        return self.at_most_s(min(seconds, self._try_s) if self.is_under_way else seconds)

    def is_cancelled(self) -> bool:
        """Look at the operator's wish to stop, where it may disturb."""
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
        before = session.latest
        with self.undisturbed():
            self._give_up_s = self._clock.now_s() + self._within_s
            try:
                self._until_confirmed(stop_once, self._give_up_s)
            finally:
                self._give_up_s = None
                if session.latest is not before:
                    leave()

    def _until_confirmed(self, stop_once: StopOnce, give_up_s: float) -> None:
        self._try_s, self._alarm_s = self._answer_s, self._clock.now_s() + self._answer_s
        while True:
            try:
                return stop_once(give_up_s, self.at_most_s(self._try_s))
            except DriverError as error:
                if self._clock.now_s() + self._pause_s >= give_up_s:
                    raise state_unknown(
                        f"the stop was not confirmed within {self._within_s:g} s ({error.problem})"
                    ) from error
                self._alarm_once(error.problem)
            self._clock.sleep_s(self._pause_s)
            self._try_s *= PATIENCE_GROWTH

    def await_standstill(self, is_moving: Callable[[], bool], *, give_up_s: float) -> None:
        """Return when the robot stands; raises `MotionFault` when it moves on until `give_up_s`.

        The alarm comes as early as where no one answers: a stop that is taken may still do nothing.
        """

        def stands() -> bool:
            if not is_moving():
                return True
            if self._clock.now_s() >= self._alarm_s:
                self._alarm_once("it still moves")
            return False

        if not comes_true(stands, self._clock, give_up_s=give_up_s, pause_s=self._pause_s):
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
    """Return the error that says, as loudly as it can, that the robot's state is unknown."""
    return RobotStateUnknown(f"robot state unknown: {problem}", remedy="use the hardware stop")
