"""Ctrl-C as a wish that the work looks at, so that the robot is stopped in order."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from queue import SimpleQueue
from types import FrameType

WATCHED = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
"""Ctrl-C, a polite kill, and the loss of the terminal. Windows has no SIGHUP."""


class StopRequest:
    """Whether the operator has asked to stop.

    Asking again changes nothing: a stop is under way, and what it waits for has a deadline.
    """

    def __init__(self) -> None:
        self._asked_by: int | None = None

    def __call__(self) -> bool:
        """Whether it was asked for."""
        return self._asked_by is not None

    @property
    def may_go_on(self) -> bool:
        """Whether the operator can be asked: only Ctrl-C comes from somebody at the terminal."""
        return self._asked_by == signal.SIGINT

    def ask(self, number: int) -> None:
        """Ask to stop, by the number of a signal."""
        self._asked_by = number


@contextmanager
def stop_on_signals(wish: StopRequest) -> Iterator[None]:
    """Turn signals into the wish to stop, for the time of the block."""
    with _handled(wish.ask):
        yield


@contextmanager
def awaited_signal() -> Iterator[Callable[[], None]]:
    """Give a function that returns when a signal has come, also one that came before it."""
    came: SimpleQueue[int] = SimpleQueue()  # its `put` may be called from a signal handler

    def wait() -> None:
        came.get()

    with _handled(came.put):
        yield wait


@contextmanager
def _handled(handle: Callable[[int], None]) -> Iterator[None]:
    def called(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - Python's signature
        handle(number)

    before = [signal.signal(number, called) for number in WATCHED]
    try:
        yield
    finally:
        for number, handler in zip(WATCHED, before, strict=True):
            signal.signal(number, handler)
