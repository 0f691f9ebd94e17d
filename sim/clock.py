"""The simulated cell's time: faster than the wall clock."""

import time


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
