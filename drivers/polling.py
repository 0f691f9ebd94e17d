"""Asking again until something is so, or time is over."""

from collections.abc import Callable
from typing import TypeVar

from drivers.ports import Clock

Answer = TypeVar("Answer")


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
