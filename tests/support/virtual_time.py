"""Time that a test moves on, and the operator's key that it presses at some moment."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

Act = Callable[[], None]


class VirtualClock:
    """Time that passes only when somebody sleeps; what was scheduled happens on the way."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._due: list[tuple[float, int, Act]] = []
        self._numbers = count()

    def now_s(self) -> float:
        return self._now_s

    def sleep_s(self, seconds: float) -> None:
        end_s = self._now_s + seconds
        while self._due and self._due[0][0] <= end_s:
            self._now_s, _, act = self._due.pop(0)
            act()
        self._now_s = end_s

    def after(self, seconds: float, act: Act) -> None:
        self._due.append((self._now_s + seconds, next(self._numbers), act))
        self._due.sort(key=lambda entry: entry[:2])


@dataclass
class StopWish:
    """Ctrl-C, with the time at which it was pressed."""

    clock: VirtualClock
    asked_s: float | None = None

    def __call__(self) -> bool:
        return self.asked_s is not None

    def ask(self) -> None:
        self.asked_s = self.clock.now_s()
