"""The simulated cell's time: passed by waiting, or faster than the wall clock."""

import math
import time

SHORTEST_SLEEP_S = 0.005
"""Real seconds below which sleeps are gathered: the system is no more exact than that."""


class EventClock:
    """Time that passes only where somebody waits, at once: no process is too slow for it.

    `speed_up` paces it for people who look on, in seconds of the cell for one outside.
    """

    def __init__(self, speed_up: float = math.inf) -> None:
        self._speed_up = speed_up
        self._now_s = 0.0
        self._owed_s = 0.0

    def now_s(self) -> float:
        """Return the seconds that were waited for since this clock was made."""
        return self._now_s

    def sleep_s(self, seconds: float) -> None:
        """Let so much time pass."""
        self._now_s += max(seconds, 0.0)
        self._owed_s += max(seconds, 0.0) / self._speed_up
        if self._owed_s >= SHORTEST_SLEEP_S:
            time.sleep(self._owed_s)
            self._owed_s = 0.0


class ScaledClock:
    """Virtual time that runs `speed_up` times faster than the wall clock."""

    def __init__(self, speed_up: float) -> None:
        self._speed_up = speed_up
        self._start_s = time.monotonic()

    def now_s(self) -> float:
        """Return the virtual seconds since this clock was made."""
        return (time.monotonic() - self._start_s) * self._speed_up

    def sleep_s(self, seconds: float) -> None:
        """Sleep for the real time that this takes."""
        time.sleep(self.real_s(max(seconds, 0.0)))

    def real_s(self, virtual_s: float) -> float:
        """Return the real seconds for that much virtual time."""
        return virtual_s / self._speed_up
