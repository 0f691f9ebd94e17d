"""The simulated cell's time: faster than the wall clock, or moved by hand in tests."""

import time
from typing import Protocol

LOOK_AGAIN_S = 0.001


class CellClock(Protocol):
    """A clock that also says how long to wait in real time."""

    def now_s(self) -> float:
        """Virtual seconds since the start; never goes back."""
        ...

    def sleep_s(self, seconds: float) -> None:
        """Return after that much virtual time."""
        ...

    def real_s(self, virtual_s: float) -> float:
        """Real seconds to wait for that much virtual time."""
        ...


class ScaledClock:
    """Virtual time that runs `speed_up` times faster than the wall clock."""

    def __init__(self, speed_up: float) -> None:
        self._speed_up = speed_up
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Virtual seconds since this clock was made."""
        return (time.monotonic() - self._start_s) * self._speed_up

    def sleep_s(self, seconds: float) -> None:
        """Sleep for the real time that this takes."""
        time.sleep(self.real_s(max(seconds, 0.0)))

    def real_s(self, virtual_s: float) -> float:
        """Real seconds for that much virtual time."""
        return virtual_s / self._speed_up


class ManualClock:
    """Time that stands still until somebody advances it."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Seconds advanced so far."""
        return self._now_s

    def advance(self, seconds: float) -> None:
        """Let that much time pass."""
        self._now_s += seconds

    def sleep_s(self, seconds: float) -> None:
        """Let that much time pass, at once."""
        self.advance(seconds)

    def real_s(self, virtual_s: float) -> float:
        """A moment: nobody knows when this clock will be advanced, so look again soon."""
        return min(LOOK_AGAIN_S, max(virtual_s, 0.0))
