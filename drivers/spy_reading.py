"""What the bytes of a byte log mean, by each protocol's own grammar."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, TypeVar

from drivers.errors import WireError
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
from drivers.wire.emscon_status import ResultStatus, status_text
from drivers.wire.geocom_constants import procedure_text, result_text
from drivers.wire.lines import LineFramer
from drivers.wire.packets import Packet, PacketFramer

Message = TypeVar("Message")

PROCEDURES_KEPT = 100
LONGEST_MEANING = 500


class Reading(Protocol):
    """Reads both directions of one connection; never raises, whatever comes."""

    def sent(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes to the device complete."""
        ...

    def received(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes from the device complete."""
        ...


class NoReading:
    """Of a protocol without a grammar here: the bytes speak for themselves."""

    def sent(self, data: bytes) -> Sequence[str]:  # noqa: ARG002 - of the protocol
        """Nothing."""
        return ()

    def received(self, data: bytes) -> Sequence[str]:  # noqa: ARG002 - of the protocol
        """Nothing."""
        return ()


class EmsconReading:
    """Packets."""

    def __init__(self) -> None:
        self._to_device = _PacketStream(lambda packet: _asked(parse_from_client(packet)))
        self._from_device = _PacketStream(lambda packet: _said(parse_from_server(packet)))

    def sent(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes to the device complete."""
        return self._to_device.meanings(data)

    def received(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes from the device complete."""
        return self._from_device.meanings(data)


class RobotlineReading:
    """Lines with checksums."""

    def __init__(self) -> None:
        self._to_device, self._from_device = robotline.line_framer(), robotline.line_framer()

    def sent(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes to the device complete."""
        return _lines(self._to_device, data, lambda line: str(robotline.decode_request(line)))

    def received(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes from the device complete."""
        return _lines(self._from_device, data, _robotline_reply)


class GeocomReading:
    """Lines; a reply names the procedure that its number belongs to."""

    def __init__(self) -> None:
        self._to_device, self._from_device = geocom.line_framer(), geocom.line_framer()
        self._procedures: dict[int, str] = {}

    def sent(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes to the device complete."""
        return _lines(self._to_device, data, self._request)

    def received(self, data: bytes) -> Sequence[str]:
        """What the messages mean that these bytes from the device complete."""
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


READINGS: Mapping[str, Callable[[], Reading]] = {
    "emscon": EmsconReading,
    "geocom": GeocomReading,
    "robotline": RobotlineReading,
}


def reading_for(driver: str) -> Callable[[], Reading]:
    """Return what makes readings for a driver of that name."""
    return READINGS.get(driver, NoReading)


def _lines(framer: LineFramer, data: bytes, meaning: Callable[[bytes], str]) -> Sequence[str]:
    return [_meant(meaning, line) for line in framer.feed(data) if line]


class _PacketStream:
    """One direction of packets. A stream that has lost its step is not read any further."""

    def __init__(self, meaning: Callable[[Packet], str]) -> None:
        self._meaning = meaning
        self._framer: PacketFramer | None = PacketFramer()

    def meanings(self, data: bytes) -> Sequence[str]:
        """What the packets mean that these bytes complete."""
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


def _robotline_reply(line: bytes) -> str:
    reply = robotline.decode_reply(line)
    return f"answer {reply.sequence} to {reply.verb}: {reply.outcome}"


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
