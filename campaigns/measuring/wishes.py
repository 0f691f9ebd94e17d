"""Wishes of the operator while a series is measured, heeded where the robot stands still."""

from enum import Enum
from threading import Lock


class Wish(Enum):
    """What the operator may ask for, beside a stop."""

    PAUSE = "pause"
    """After this pair; asked for again, it goes on."""
    SKIP = "skip"
    """The shot that is being moved to or looked for is left out, and its pair."""
    AGAIN = "again"
    """The last shot, of a pair the pair, does not count and is measured again."""
    PARK = "park"
    """After this pair the robot goes where somebody can reach the reflector, and waits there."""


class Wishes:
    """Wishes asked for by any thread, each heeded once."""

    def __init__(self) -> None:
        self._asked: set[Wish] = set()
        self._lock = Lock()

    def ask(self, wish: Wish) -> None:
        """Ask for something; a second time before it is heeded changes nothing."""
        with self._lock:
            self._asked.add(wish)

    def take(self, wish: Wish) -> bool:
        """Whether it was asked for since it was taken last."""
        with self._lock:
            is_asked = wish in self._asked
            self._asked.discard(wish)
            return is_asked
