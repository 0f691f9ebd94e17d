"""Byte log, and the meaning of its bytes by each protocol's own grammar."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Protocol, TextIO, TypeVar

from drivers.errors import DriverError, WireError
from drivers.transport import CONNECT_S, Opener, Transport
from drivers.wire import geocom, robotline
from drivers.wire.emscon import (
    Answer,
    FromClient,
    FromServer,
    OtherPacket,
    Request,
    UnknownRequest,
    parse_from_client,
    parse_from_server,
)
from drivers.wire.emscon_constants import ResultStatus, status_text
from drivers.wire.framing import LineFramer, Packet, PacketFramer
from drivers.wire.geocom_constants import procedure_text, result_text
from drivers.wire.robotline import RobotLayout

Message = TypeVar("Message")

PROCEDURES_KEPT = 100
LONGEST_MEANING = 500


class Reading(Protocol):
    """Reading of both directions of one connection; never raises, whatever comes."""

    def sent(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes to the device complete."""
        ...

    def received(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes from the device complete."""
        ...


class NoReading:
    """Reading of a protocol without a grammar here: the bytes speak for themselves."""

    def sent(self, data: bytes) -> Sequence[str]:  # noqa: ARG002 - of the protocol
        """Meanings: none."""
        return ()

    def received(self, data: bytes) -> Sequence[str]:  # noqa: ARG002 - of the protocol
        """Meanings: none."""
        return ()


class EmsconReading:
    """Packets."""

    def __init__(self) -> None:
        self._to_device = _PacketStream(lambda packet: _asked(parse_from_client(packet)))
        self._from_device = _PacketStream(lambda packet: _said(parse_from_server(packet)))

    def sent(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes to the device complete."""
        return self._to_device.meanings(data)

    def received(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes from the device complete."""
        return self._from_device.meanings(data)


class RobotlineReading:
    """Lines with checksums."""

    def __init__(self, robot: RobotLayout) -> None:
        self._robot = robot
        self._to_device, self._from_device = robotline.line_framer(), robotline.line_framer()

    def sent(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes to the device complete."""
        return _lines(self._to_device, data, self._request)

    def received(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes from the device complete."""
        return _lines(self._from_device, data, self._reply)

    def _request(self, line: bytes) -> str:
        return str(robotline.decode_request(line, self._robot))

    def _reply(self, line: bytes) -> str:
        reply = robotline.decode_reply(line, self._robot)
        return f"answer {reply.sequence} to {reply.verb}: {reply.outcome}"


class GeocomReading:
    """Lines; a reply names the procedure that its number belongs to."""

    def __init__(self) -> None:
        self._to_device, self._from_device = geocom.line_framer(), geocom.line_framer()
        self._procedures: dict[int, str] = {}

    def sent(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes to the device complete."""
        return _lines(self._to_device, data, self._request)

    def received(self, data: bytes) -> Sequence[str]:
        """Meanings of the messages that these bytes from the device complete."""
        return _lines(self._from_device, data, self._reply)

    def _request(self, line: bytes) -> str:
        request = geocom.decode_request(line)
        if isinstance(request, geocom.Abort):
            return "abort the motion"
        while len(self._procedures) >= PROCEDURES_KEPT:
            del self._procedures[next(iter(self._procedures))]
        self._procedures[request.transaction] = name = procedure_text(request.rpc)
        return f"{name}({', '.join(request.parameters)}), question {request.transaction}"

    def _reply(self, line: bytes) -> str:
        if line == geocom.ABORTED:
            return "the motion is aborted"
        reply = geocom.decode_reply(line)
        name = self._procedures.pop(reply.transaction, "nothing that was asked")
        code = reply.communication or reply.result
        said = result_text(code) if code else f"({', '.join(reply.parameters)})"
        return f"answer {reply.transaction} to {name}: {said}"


def reading_for(driver: str, robot: RobotLayout) -> Callable[[], Reading]:
    """Factory of readings for a driver of that name, of a robot of that layout."""
    readings: Mapping[str, Callable[[], Reading]] = {
        "emscon": EmsconReading,
        "geocom": GeocomReading,
        "robotline": lambda: RobotlineReading(robot),
    }
    return readings.get(driver, NoReading)


def _lines(framer: LineFramer, data: bytes, meaning: Callable[[bytes], str]) -> Sequence[str]:
    return [_meant(meaning, line) for line in framer.feed(data) if line]


class _PacketStream:
    """Packets of one direction. A stream that has lost its step is not read any further."""

    def __init__(self, meaning: Callable[[Packet], str]) -> None:
        self._meaning = meaning
        self._framer: PacketFramer | None = PacketFramer()

    def meanings(self, data: bytes) -> Sequence[str]:
        """Meanings of the packets that these bytes complete."""
        if self._framer is None:
            return ()
        try:
            packets = self._framer.feed(data)
        except WireError as error:
            self._framer = None
            return [f"cannot be read, nor what follows: {error.problem}"]
        return [_meant(self._meaning, packet) for packet in packets]


def _meant(meaning: Callable[[Message], str], message: Message) -> str:
    try:
        return meaning(message)[:LONGEST_MEANING]
    except WireError as error:
        return f"cannot be read: {error.problem}"[:LONGEST_MEANING]


def _asked(message: FromClient) -> str:
    match message:
        case Request(command, body):
            return f"{command.title} {body}"
        case UnknownRequest(command):
            return f"command {command}, which is not known here"


def _said(message: FromServer) -> str:
    match message:
        case Answer(command, ResultStatus.ALL_OK, body):
            return f"answer to {command.title}: {body}"
        case Answer(command, status):
            return f"answer to {command.title}: {status_text(status)}"
        case OtherPacket(kind, body):
            return f"packet of type {kind} with {len(body)} bytes"
        case _:
            return f"unasked: {message}"


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

    def __init__(self, pipe: Transport, log: ByteLog, device: str, reading: Reading) -> None:
        self._pipe = pipe
        self._log = log
        self._device = device
        self._reading = reading
        self._is_open = True

    @property
    def name(self) -> str:
        """Name of the device's place."""
        return self._pipe.name

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
    open_pipe: Opener,
    log: ByteLog,
    device: str,
    new_reading: Callable[[], Reading],
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
