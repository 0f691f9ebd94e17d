"""Stopping a robot: tried until it is confirmed, whatever wire and operator do meanwhile."""

from collections.abc import Callable

from drivers.errors import DriverError, MotionFault, RobotStateUnknown
from drivers.polling import comes_true
from drivers.ports import Clock
from drivers.session import Connected, Session


class StopProcedure:
    """Stop of a robot: how it is done, and whether it is under way. `clock` is real time."""

    def __init__(
        self, clock: Clock, *, within_s: float, pause_s: float, cancelled: Callable[[], bool]
    ) -> None:
        self._clock = clock
        self._within_s = within_s
        self._pause_s = pause_s
        self._cancelled = cancelled
        self._under_way = False

    def is_cancelled(self) -> bool:
        """Look at the operator's wish to stop, but never abandon the stop itself for it."""
        return not self._under_way and self._cancelled()

    def insist(
        self,
        session: Session[Connected],
        stop_once: Callable[[float], None],
        leave: Callable[[], None],
    ) -> None:
        """Try again and again until the stop is confirmed; raises `RobotStateUnknown`.

        `stop_once` is told until when it may watch, as the clock shows it, and may open a
        connection where there is none. Such a one is left at the end: what comes after the stop
        waits for a reconnection.
        """
        before = session.latest
        self._under_way = True
        try:
            self._until_confirmed(stop_once)
        finally:
            self._under_way = False
            if session.latest is not before:
                leave()

    def _until_confirmed(self, stop_once: Callable[[float], None]) -> None:
        give_up_s = self._clock.now_s() + self._within_s
        while True:
            try:
                return stop_once(give_up_s)
            except DriverError as error:
                if self._clock.now_s() >= give_up_s:
                    raise state_unknown(
                        f"the stop was not confirmed within {self._within_s:g} s ({error.problem})"
                    ) from error
            self._clock.sleep_s(self._pause_s)


def await_standstill(
    is_moving: Callable[[], bool], clock: Clock, *, give_up_s: float, pause_s: float
) -> None:
    """Return when the robot stands; raises `MotionFault` when it moves on until `give_up_s`."""
    if not comes_true(lambda: not is_moving(), clock, give_up_s=give_up_s, pause_s=pause_s):
        raise MotionFault("it still moves", remedy="use the hardware stop")


def state_unknown(problem: str) -> RobotStateUnknown:
    """Error that says as loudly as can be said that the robot's state is not known."""
    return RobotStateUnknown(f"robot state unknown: {problem}", remedy="use the hardware stop")
