"""The wall clock, as the port asks for it."""

import time


class SystemClock:
    """Real time."""

    def now_s(self) -> float:
        """Seconds of the monotonic clock."""
        return time.monotonic()

    def sleep_s(self, seconds: float) -> None:
        """Sleep for real."""
        time.sleep(seconds)
