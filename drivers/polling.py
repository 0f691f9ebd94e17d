"""Waiting: asking again until something is so, or time is over; sleeping no longer than wanted.

Devices say that they are busy, warming up or moving, and rarely when that is over: they are asked
again. Two rules hold for each such wait:

* It ends. `give_up_s` is a time of the clock and not a number of tries, because an answer may take
  any time. At least one answer is asked for, whatever the clock shows, and the last one counts.
* The operator can end it. Python's `sleep` goes on after a signal, so that a long pause is slept in
  naps, and `WakefulClock` looks at the wish to stop between them.

The clock is an argument. A simulated cell's runs faster than real time, and that of tests by hand.
"""

from collections.abc import Callable
from typing import TypeVar

from drivers.ports import Clock

Answer = TypeVar("Answer")
NAP_S = 0.05
"""Duration of one sleep, after which the operator's wish to stop is looked at."""


class WakefulClock:
    """Clock whose sleep ends soon after the operator wants to stop.

    It raises nothing: the caller looks at the wish to stop itself.
    """

    def __init__(self, clock: Clock, cancelled: Callable[[], bool]) -> None:
        self._clock = clock
        self._cancelled = cancelled

    def now_s(self) -> float:
        """Return the seconds of the clock inside."""
        return self._clock.now_s()

    def sleep_s(self, seconds: float) -> None:
        """Return after the clock's seconds, or after a nap once the operator wants to stop."""
        end_s = self._clock.now_s() + seconds
        while (remaining_s := end_s - self._clock.now_s()) > 0.0:
            self._clock.sleep_s(min(remaining_s, NAP_S))
            # After the nap, not before: a caller that has not seen the wish yet must not spin.
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
    # The time is looked at after asking: an answer that was settled just then still counts.
    while True:
        answer = ask()
        if is_settled(answer) or clock.now_s() >= give_up_s:
            return answer
        clock.sleep_s(pause_s)


def wait_for(
    condition: Callable[[], bool], clock: Clock, *, give_up_s: float, pause_s: float
) -> bool:
    """Wait until a condition is true; return False if it is not by `give_up_s`."""
    return ask_until(bool, condition, clock, give_up_s=give_up_s, pause_s=pause_s)
