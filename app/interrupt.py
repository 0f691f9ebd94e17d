"""Ctrl-C as a wish that the work looks at, so that the robot is stopped in order."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopWish:
    """Whether the operator has asked to stop. Asking twice interrupts whatever is going on."""

    def __init__(self) -> None:
        self._asked = False

    def __call__(self) -> bool:
        """Whether it was asked for."""
        return self._asked

    def ask(self) -> None:
        """Ask to stop; raises `KeyboardInterrupt` when that had been asked before."""
        if self._asked:
            raise KeyboardInterrupt
        self._asked = True

    def forget(self) -> None:
        """Go on as if nothing had been asked."""
        self._asked = False


@contextmanager
def stop_on_signals(wish: StopWish) -> Iterator[None]:
    """Turn Ctrl-C and a polite kill into the wish to stop, for the time of the block."""

    def ask(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - the system's signature
        wish.ask()

    watched = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, ask) for number in watched]
    try:
        yield
    finally:
        for number, handler in zip(watched, before, strict=True):
            signal.signal(number, handler)
