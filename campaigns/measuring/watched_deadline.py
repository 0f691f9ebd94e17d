"""Deadline of a wait at the cell, by what was watched of it."""

from drivers.ports import Clock

FEWEST_LOOKS = 10
"""Looks without which no deadline of a watched wait passes."""
ROUNDING = 1e-9
"""Share by which a sum of times may fall short of the whole."""


class WatchedDeadline:
    """Deadline of a wait that looks again and again; it passes only after looks enough.

    Seconds between two looks count no more than their share of the deadline. It is about what is
    watched, not about the watcher: 10 s of a simulated cell at speed_up 100 are 0.1 s of the wall
    clock, which a process that gets no processor sleeps through without having seen anything.
    Looks that come more often than that, as they do at real devices, leave the deadline as it is.
    """

    def __init__(self, clock: Clock, within_s: float, *, fewest_looks: int = FEWEST_LOOKS) -> None:
        self._clock = clock
        self._within_s = within_s
        self._longest_s = within_s / fewest_looks
        self._looked_s = clock.now_s()
        self._watched_s = 0.0

    def has_passed(self) -> bool:
        """Whether it had passed when this look began: call it before each."""
        before_s, self._looked_s = self._looked_s, self._clock.now_s()
        self._watched_s += min(self._looked_s - before_s, self._longest_s)
        return self._watched_s >= self._within_s * (1.0 - ROUNDING)
