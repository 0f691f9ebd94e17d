"""Waiting: asking again until something is so, or time is over; sleeping no longer than wanted."""

from collections.abc import Callable
from typing import TypeVar

from drivers.ports import Clock

Answer = TypeVar("Answer")
NAP_S = 0.05
"""Duration of one sleep, after which the operator's wish to stop is looked at."""


class WakefulClock:
    """Clock whose sleep ends soon after the operator wants to stop: nothing waits on in its sleep.

    A signal alone ends no sleep. The one who sleeps looks at the wish himself.
    """

    def __init__(self, clock: Clock, cancelled: Callable[[], bool]) -> None:
        self._clock = clock
        self._cancelled = cancelled

    def now_s(self) -> float:
        """Return the seconds of the clock inside."""
        return self._clock.now_s()

    def sleep_s(self, seconds: float) -> None:
        """Return after that much of the clock's time, or after a nap once somebody wants to stop.

        The nap keeps a loop that has not yet seen the wish from spinning.
        """
        end_s = self._clock.now_s() + seconds
        while (left_s := end_s - self._clock.now_s()) > 0.0:
            self._clock.sleep_s(min(left_s, NAP_S))
            if self._cancelled():
                return


def ask_until(
    is_settled: Callable[[Answer], bool],
    ask: Callable[[], Answer],
    clock: Clock,
    *,
    give_up_s: float,
    pause_s: float,
) -> Answer:
    """Ask until the answer is settled or the clock shows `give_up_s`; returns the last answer."""
    while True:
        answer = ask()
        if is_settled(answer) or clock.now_s() >= give_up_s:
            return answer
        clock.sleep_s(pause_s)


def comes_true(
    condition: Callable[[], bool], clock: Clock, *, give_up_s: float, pause_s: float
) -> bool:
    """Whether it becomes true before the clock shows `give_up_s`; tried at least once."""
    return ask_until(bool, condition, clock, give_up_s=give_up_s, pause_s=pause_s)
