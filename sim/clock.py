"""The simulated cell's time: passed by waiting, or faster than the wall clock.

Devices and drivers wait by a clock that they are given, never by the computer's. Two kinds of clock
let a simulated campaign of hours end in seconds:

- `EventClock`: time is a number that only a sleep increases. Everything runs in one thread, so that
  no answer can be late because the computer was busy: deadlines count the cell's seconds and the
  results depend on scenario and seed alone. A campaign on a simulated cell takes it.
- `ScaledClock`: the wall clock times `speed_up`. Other programs and real devices do not wait for an
  event clock, so `pkmcal sim` and a cell beside a real device take this one.
"""

import math
import time

SHORTEST_SLEEP_S = 0.005
"""Real seconds below which sleeps are gathered: systems wake a sleeper no more exactly."""


class EventClock:
    """Time that passes only while a caller sleeps, and then at once.

    `speed_up` paces it for people who look on, in seconds of the cell for one outside.
    """

    def __init__(self, speed_up: float = math.inf) -> None:
        self._speed_up = speed_up
        self._now_s = 0.0
        self._owed_s = 0.0
        """Real seconds that have passed in the cell and have not been slept yet."""

    def now_s(self) -> float:
        """Return the seconds slept since this clock was made."""
        return self._now_s

    def sleep_s(self, seconds: float) -> None:
        """Let a number of the cell's seconds pass; a negative number counts as 0."""
        self._now_s += max(seconds, 0.0)
        # without pacing (speed_up infinite) nothing is ever owed, and this never sleeps
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
        """Sleep for the real time that a number of virtual seconds takes."""
        time.sleep(self.real_s(max(seconds, 0.0)))

    def real_s(self, virtual_s: float) -> float:
        """Convert virtual seconds to real ones."""
        return virtual_s / self._speed_up
