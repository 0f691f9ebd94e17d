"""Byte log: every byte of every wire in one file, with what it means by each protocol's grammar."""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TextIO, TypeVar

from drivers.errors import DriverError, WireError
from drivers.transport import CONNECT_S, Opener, Transport

LONGEST_MEANING = 500
LIMIT_CHARACTERS = 50_000_000
"""Length of days of measuring; a device that babbles cannot fill the disk."""
SHOWN_BYTES = 4096
"""Bytes shown of one piece; the rest is only counted."""
BYTES_A_LINE = 16
SENT, RECEIVED, HAPPENED = ">", "<", "!"

_TEXT = re.compile(rb"[\t\n\r -~]*")
_ESCAPES = {"\r": "\\r", "\n": "\\n", "\t": "\\t", "\\": "\\\\"}

HEADING = """\
# Byte log of pkmcal. One entry for each piece as it was sent or came:
#   time (UTC), device, direction, bytes;  > to the device, < from it, ! about the connection
# then the bytes, as text with \\r \\n \\t \\\\ or in hexadecimal, and behind = what they mean.
"""

Unit = TypeVar("Unit")
Meanings = Callable[[bytes], Sequence[str]]
"""Meanings of the messages that these bytes complete; never raises, whatever comes."""


@dataclass(frozen=True, slots=True)
class WireReading:
    """Reading of one connection: of the bytes to the device, and of those from it."""

    sent: Meanings
    received: Meanings


def meanings(feed: Callable[[bytes], Sequence[Unit]], meaning: Callable[[Unit], str]) -> Meanings:
    """Read what a framer cuts; both raise only `WireError`.

    A stream that has lost its step is not read any further.
    """
    has_lost_its_step = False

    def read(data: bytes) -> Sequence[str]:
        nonlocal has_lost_its_step
        if has_lost_its_step:
            return ()
        try:
            units = feed(data)
        except WireError as error:
            has_lost_its_step = True
            return [f"cannot be read, nor what follows: {error.problem}"]
        return [_meant(meaning, unit) for unit in units if unit]

    return read


def no_reading() -> WireReading:
    """Reading of a protocol without a grammar here: the bytes speak for themselves."""
    return WireReading(lambda _: (), lambda _: ())


def _meant(meaning: Callable[[Unit], str], unit: Unit) -> str:
    try:
        return meaning(unit)[:LONGEST_MEANING]
    except WireError as error:
        return f"cannot be read: {error.problem}"[:LONGEST_MEANING]


class ByteLog:
    """Entries of all wires in one file, in their order; each is in the file before work goes on.

    A file that cannot be written ends the log and not the work: `problem` then says why.
    """

    def __init__(
        self, file: TextIO, *, now_utc: Callable[[], str], limit_characters: int = LIMIT_CHARACTERS
    ) -> None:
        self._file = file
        self._now_utc = now_utc
        self._left = limit_characters
        self.problem = ""
        """Reason why the log ends before the work did; empty while it goes on."""
        self._put(HEADING)

    def enter(self, device: str, direction: str, what: str, lines: Iterable[str] = ()) -> None:
        """Write one entry."""
        head = f"{self._now_utc()} {device} {direction} {what}\n"
        self._put(head + "".join(f"    {line}\n" for line in lines))

    def _put(self, text: str) -> None:
        if self.problem:
            return
        self._left -= len(text)
        if self._left < 0:
            self.problem = "it has reached its largest size"
            text = f"# The log ends here: {self.problem}.\n"
        try:
            self._file.write(text)
            self._file.flush()
        except OSError as error:
            self.problem = f"it cannot be written ({error.strerror or error})"


class LoggedTransport:
    """A byte pipe that is written down; it raises what the pipe raises."""

    def __init__(self, pipe: Transport, log: ByteLog, device: str, reading: WireReading) -> None:
        self.name = pipe.name
        self._pipe = pipe
        self._log = log
        self._device = device
        self._reading = reading
        self._is_open = True

    def send(self, data: bytes, timeout_s: float) -> None:
        """Send all of it; it is written down first, because it may arrive in any case."""
        self._enter(SENT, data, self._reading.sent(data))
        try:
            self._pipe.send(data, timeout_s)
        except DriverError as error:
            self._log.enter(self._device, HAPPENED, error.problem)
            raise

    def receive(self, timeout_s: float) -> bytes:
        """Return what has arrived; silence is not written down."""
        try:
            data = self._pipe.receive(timeout_s)
        except DriverError as error:
            self._log.enter(self._device, HAPPENED, error.problem)
            raise
        if data:
            self._enter(RECEIVED, data, self._reading.received(data))
        return data

    def close(self) -> None:
        """Close; a second time does nothing."""
        if self._is_open:
            self._is_open = False
            self._log.enter(self._device, HAPPENED, f"{self.name}: closed by us")
        self._pipe.close()

    def _enter(self, direction: str, data: bytes, meanings: Sequence[str]) -> None:
        lines = [*bytes_as_lines(data), *(f"= {meaning}" for meaning in meanings)]
        self._log.enter(self._device, direction, f"{len(data)} bytes", lines)


def logged(
    open_pipe: Opener, log: ByteLog, device: str, new_reading: Callable[[], WireReading]
) -> Opener:
    """Open a pipe as before, but one that is written down; each time with a fresh reading."""

    def open_spied(*, timeout_s: float = CONNECT_S) -> Transport:
        try:
            pipe = open_pipe(timeout_s=timeout_s)
        except DriverError as error:
            log.enter(device, HAPPENED, error.problem)
            raise
        log.enter(device, HAPPENED, f"{pipe.name}: opened")
        return LoggedTransport(pipe, log, device, new_reading())

    return open_spied


def bytes_as_lines(data: bytes) -> list[str]:
    """Show bytes as text where they are text, else in hexadecimal; long ones are cut."""
    shown = data[:SHOWN_BYTES]
    lines = _text_lines(shown) if _TEXT.fullmatch(shown) else _dump_lines(shown)
    rest = len(data) - len(shown)
    return [*lines, f"… and {rest} bytes more"] if rest else lines


def _text_lines(data: bytes) -> list[str]:
    lines = data.decode("ascii").splitlines(keepends=True)
    return ["".join(_ESCAPES.get(sign, sign) for sign in line) for line in lines]


def _dump_lines(data: bytes) -> list[str]:
    return [
        _dump_line(start, data[start : start + BYTES_A_LINE])
        for start in range(0, len(data), BYTES_A_LINE)
    ]


def _dump_line(start: int, piece: bytes) -> str:
    text = "".join(chr(byte) if 0x20 <= byte <= 0x7E else "." for byte in piece)
    return f"{start:04x}  {piece.hex(' '):<{3 * BYTES_A_LINE}} {text}"
