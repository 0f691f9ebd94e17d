"""Signals as a wish that the work looks at, so that the robot is stopped in order."""

# A handler that stopped the robot itself would run between any two lines of a driver, perhaps in
# the middle of a message, and a KeyboardInterrupt there would leave the link half read. So a signal
# only sets a `StopRequest`. Whatever waits looks at it several times a second: drivers while an
# answer is pending, the engine between its steps. They then stop the robot in order and raise
# `Interrupted` or `Cancelled`.
#
# What signals mean depends on the block in which a command is:
#
# - `interrupted_by_signals`, around every command: they raise KeyboardInterrupt. Nothing moves.
# - `stop_on_signals`, while devices are connected: they become a wish to stop.
# - `asking`, inside such a block while a question is open: Ctrl-Z suspends, the others mean no.
# - `first_stop_counts`, around a command's work: what comes after a stop changes nothing of it.
# - `awaited_signal`, for servers: a function that waits for the signal to end.
#
# After SIGHUP, SIGTERM or SIGQUIT no question is asked: the terminal may be gone.

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from types import FrameType

from campaigns.errors import Interrupted
from drivers.system import signals_of, unblock

ENDING = signals_of("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
"""Ctrl-C, a polite kill, the loss of the terminal, Ctrl-\\; Windows has the first two."""
SUSPENDING = signals_of("SIGTSTP")
"""Ctrl-Z."""
WATCHED = (*ENDING, *SUSPENDING)
LOOK_S = 0.5
"""How often a server that waits for its end lets handlers run."""
ANSWERED = (signal.SIGINT, *SUSPENDING)
"""Those that come from somebody at the terminal, who can be asked whether to go on."""
LEFT_ALONE = signals_of("SIGHUP", "SIGTSTP")
"""Signals that stay ignored if the parent process ignores them: nohup outlives its terminal, and a
process that no shell could continue is not suspended."""


class StopRequest:
    """Request of the operator to stop.

    A second request changes nothing: a stop is under way, and its waits have deadlines. But after
    a signal other than Ctrl-C and Ctrl-Z no question is asked any more.
    """

    def __init__(self) -> None:
        self._asked_by: int | None = None
        """Number of the signal that asked; None while nothing has."""

    def __call__(self) -> bool:
        """Return whether a stop was asked for."""
        return self._asked_by is not None

    @property
    def may_go_on(self) -> bool:
        """Whether the operator can be asked: Ctrl-C and Ctrl-Z come from somebody there."""
        return self._asked_by in ANSWERED

    @property
    def suspends(self) -> bool:
        """Whether the process is to be suspended once the robot stands."""
        return self._asked_by in SUSPENDING

    def ask(self, number: int) -> None:
        """Ask to stop, by the number of a signal."""
        if self._asked_by is None or self.may_go_on:
            self._asked_by = number

    def withdraw(self) -> None:
        """Withdraw the stop: the operator has confirmed that the work goes on."""
        self._asked_by = None


def unblock_signals() -> None:
    """Unblock the signals that the parent process may have blocked; ignored ones stay ignored."""
    unblock(WATCHED)


@contextmanager
def stop_on_signals(wish: StopRequest) -> Iterator[None]:
    """Turn signals into the wish to stop, for the time of the block."""
    with _handling(wish.ask, WATCHED):
        yield


@contextmanager
def asking() -> Iterator[None]:
    """Let Ctrl-Z suspend and other signals mean no, within `stop_on_signals`.

    The others raise `KeyboardInterrupt`, so that the caller can still undo what is half done.
    """
    before = {number: signal.getsignal(number) for number in SUSPENDING}
    with _handling(_refuse, ENDING):
        for number, handler in before.items():
            if handler is not signal.SIG_IGN:
                signal.signal(number, signal.SIG_DFL)
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)


@contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Let the signals that end a process raise `KeyboardInterrupt`, as Ctrl-C does already."""
    with _handling(_refuse, [number for number in ENDING if number != signal.SIGINT]):
        yield


@contextmanager
def first_stop_counts() -> Iterator[None]:
    """Let a signal that comes while the block ends by a stop change nothing of that stop."""
    try:
        yield
    except KeyboardInterrupt as late:
        if isinstance(late.__context__, Interrupted):
            raise late.__context__ from None
        raise


@contextmanager
def awaited_signal() -> Iterator[Callable[[], None]]:
    """Yield a function that waits for a signal to end; an earlier signal is not lost."""
    # An Event could dead-lock here: its `set` takes a lock that `wait` may hold when the handler
    # interrupts it. `SimpleQueue.put` may be called from a signal handler.
    signals: SimpleQueue[int] = SimpleQueue()

    def wait() -> None:
        # by pieces, because Windows runs no handler while a thread waits for a lock
        while True:
            with suppress(Empty):
                signals.get(timeout=LOOK_S)
                return

    with _handling(signals.put, ENDING):
        yield wait


def suspend() -> None:
    """Suspend this process as an unhandled Ctrl-Z does; return when it is continued."""
    os.kill(os.getpid(), SUSPENDING[0])


def _refuse(_number: int) -> None:
    raise KeyboardInterrupt


@contextmanager
def _handling(handle: Callable[[int], None], numbers: Sequence[signal.Signals]) -> Iterator[None]:
    """Let a function handle these signals for the time of the block, then restore the handlers."""

    def called(number: int, frame: FrameType | None) -> None:  # noqa: ARG001 - Python's signature
        handle(number)

    before = {number: signal.getsignal(number) for number in numbers}
    for number, handler in before.items():
        if number not in LEFT_ALONE or handler is not signal.SIG_IGN:
            signal.signal(number, called)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
