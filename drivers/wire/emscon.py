"""Grammar of emScon: commands, answers and what comes unasked, as packets."""

import struct
from dataclasses import dataclass, field

from drivers.errors import WireError
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import (
    OTHER_TAILS_BYTES,
    Command,
    DataType,
    ResultStatus,
    status_text,
)
from drivers.wire.framing import Packet, PacketFramer, encode_packet

NOTHING = bodies.Nothing()
COMMAND_HEADER = struct.Struct("<i")
ANSWER_HEADER = struct.Struct("<ii")


@dataclass(frozen=True, slots=True)
class Shape:
    """Contents after the command code in a request, and after the status in an answer."""

    request: type[bodies.Body] = bodies.Nothing
    answer: type[bodies.Body] = bodies.Nothing


SHAPES: dict[Command, Shape] = {
    Command.GET_SYSTEM_STATUS: Shape(answer=bodies.SystemStatus),
    Command.GET_TRACKER_STATUS: Shape(answer=bodies.TrackerStatus),
    Command.SET_UNITS: Shape(request=bodies.Units),
    Command.GET_UNITS: Shape(answer=bodies.Units),
    Command.INITIALIZE: Shape(),
    Command.SET_STATION_ORIENTATION_PARAMS: Shape(request=bodies.StationOrientation),
    Command.GET_STATION_ORIENTATION_PARAMS: Shape(answer=bodies.StationOrientation),
    Command.SET_TRANSFORMATION_PARAMS: Shape(request=bodies.Transformation),
    Command.GET_TRANSFORMATION_PARAMS: Shape(answer=bodies.Transformation),
    Command.SET_ENVIRONMENT_PARAMS: Shape(request=bodies.Environment),
    Command.GET_ENVIRONMENT_PARAMS: Shape(answer=bodies.Environment),
    Command.SET_REFRACTION_PARAMS: Shape(request=bodies.Refraction),
    Command.GET_REFRACTION_PARAMS: Shape(answer=bodies.Refraction),
    Command.SET_MEASUREMENT_MODE: Shape(request=bodies.MeasurementMode),
    Command.GET_MEASUREMENT_MODE: Shape(answer=bodies.MeasurementMode),
    Command.SET_COORDINATE_SYSTEM_TYPE: Shape(request=bodies.CoordinateSystem),
    Command.GET_COORDINATE_SYSTEM_TYPE: Shape(answer=bodies.CoordinateSystem),
    Command.SET_STATIONARY_MODE_PARAMS: Shape(request=bodies.StationaryMode),
    Command.GET_STATIONARY_MODE_PARAMS: Shape(answer=bodies.StationaryMode),
    Command.SET_REFLECTOR: Shape(request=bodies.ReflectorChoice),
    Command.GET_REFLECTOR: Shape(answer=bodies.ReflectorChoice),
    Command.GET_REFLECTORS: Shape(answer=bodies.ReflectorEntry),
    Command.SET_SEARCH_PARAMS: Shape(request=bodies.SearchParams),
    Command.GET_SEARCH_PARAMS: Shape(answer=bodies.SearchParams),
    Command.SET_SYSTEM_SETTINGS: Shape(request=bodies.SystemSettings),
    Command.GET_SYSTEM_SETTINGS: Shape(answer=bodies.SystemSettings),
    Command.START_MEASUREMENT: Shape(),
    Command.STOP_MEASUREMENT: Shape(),
    Command.GO_POSITION: Shape(request=bodies.BeamTarget),
    Command.FIND_REFLECTOR: Shape(request=bodies.ApproximateDistance),
    Command.GET_DIRECTION: Shape(answer=bodies.Direction),
    Command.SET_STATISTIC_MODE: Shape(request=bodies.StatisticMode),
    Command.GET_STATISTIC_MODE: Shape(answer=bodies.StatisticMode),
    Command.GET_MEASUREMENT_STATUS_INFO: Shape(answer=bodies.MeasurementStatusInfo),
    Command.GET_FACE: Shape(answer=bodies.Face),
    Command.GET_TRACKER_INFO: Shape(answer=bodies.TrackerInfo),
    Command.GO_AND_MEASURE: Shape(request=bodies.ReflectorPlace),
    Command.GET_SYSTEM_SOFTWARE_VERSION: Shape(answer=bodies.SoftwareVersion),
}


@dataclass(frozen=True, slots=True)
class EmsconRequest:
    """A command with its parameters."""

    command: Command
    body: bodies.Body = field(default=NOTHING)

    def describe(self) -> str:
        """Say it to people."""
        return f"{self.command.title} {self.body}"


@dataclass(frozen=True, slots=True)
class UnknownRequest:
    """A well-formed command that this grammar has no parameters for."""

    command: int

    def describe(self) -> str:
        """Say it to people."""
        return f"command {self.command}, which is not known here"


@dataclass(frozen=True, slots=True)
class Answer:
    """A command's answer. A refusal (status not 0) has no body, whatever followed on the wire."""

    command: Command
    status: int = ResultStatus.ALL_OK
    body: bodies.Body = field(default=NOTHING)

    def describe(self) -> str:
        """Say it to people."""
        said = self.body if self.status == ResultStatus.ALL_OK else status_text(self.status)
        return f"answer to {self.command.title}: {said}"


@dataclass(frozen=True, slots=True)
class OtherPacket:
    """A packet of a kind that a client of stationary measurements has no use for, or none knows."""

    kind: int
    body: bytes

    @property
    def is_known(self) -> bool:
        """Whether the interface, as far as it is public, has such packets."""
        return self.kind in _KINDS

    def describe(self) -> str:
        """Say it to people."""
        return f"packet of type {self.kind} with {len(self.body)} bytes"


Unasked = (
    bodies.ErrorResponse
    | bodies.StatusChange
    | bodies.ReflectorPosition
    | bodies.SingleResult
    | bodies.SingleResult2
    | OtherPacket
)
FromServer = Answer | Unasked
FromClient = EmsconRequest | UnknownRequest

_UNASKED: dict[
    int,
    type[
        bodies.ErrorResponse
        | bodies.StatusChange
        | bodies.ReflectorPosition
        | bodies.SingleResult
        | bodies.SingleResult2
    ],
] = {
    DataType.ERROR: bodies.ErrorResponse,
    DataType.STATUS_CHANGE: bodies.StatusChange,
    DataType.REFLECTOR_POSITION: bodies.ReflectorPosition,
    DataType.SINGLE_RESULT: bodies.SingleResult,
    DataType.SINGLE_RESULT_2: bodies.SingleResult2,
}
_KIND_OF = {body: kind for kind, body in _UNASKED.items()}
_KINDS = frozenset(DataType)


def encode(message: FromServer | FromClient) -> bytes:
    """Write a message as one packet."""
    return encode_packet(_packet(message))


def _packet(message: FromServer | FromClient) -> Packet:
    match message:
        case EmsconRequest(command, body):
            return Packet(DataType.COMMAND, COMMAND_HEADER.pack(command) + bodies.encode_body(body))
        case UnknownRequest(command):
            return Packet(DataType.COMMAND, COMMAND_HEADER.pack(command))
        case Answer(command, status, body):
            return Packet(
                DataType.COMMAND, ANSWER_HEADER.pack(command, status) + bodies.encode_body(body)
            )
        case OtherPacket(kind, data):
            return Packet(kind, data)
        case _:
            return Packet(_KIND_OF[type(message)], bodies.encode_body(message))


def refusal(command: int, status: int) -> bytes:
    """Write a refusal, also of a command that the grammar doesn't know.

    With zeros in place of the answer's fields: some clients read them whatever the status says.
    """
    known = _known(command)
    tail_bytes = (
        OTHER_TAILS_BYTES.get(command, 0)
        if known is None
        else bodies.layout_of(SHAPES[known].answer).size
    )
    body = ANSWER_HEADER.pack(command, status) + bytes(tail_bytes)
    return encode_packet(Packet(DataType.COMMAND, body))


def parse_from_server(packet: Packet) -> FromServer:
    """Read what an instrument sent; raises `WireError`."""
    if packet.kind == DataType.COMMAND:
        return _answer(packet.body)
    if kind := _UNASKED.get(packet.kind):
        return bodies.decode_body(kind, packet.body, may_be_longer=True)
    return OtherPacket(packet.kind, packet.body)


def parse_from_client(packet: Packet) -> FromClient:
    """Read what a client sent; raises `WireError`."""
    if packet.kind != DataType.COMMAND:
        raise WireError(f"packet of type {packet.kind} from a client, only commands are expected")
    if len(packet.body) < COMMAND_HEADER.size:
        raise WireError(f"command of {len(packet.body)} bytes")
    (code,) = COMMAND_HEADER.unpack_from(packet.body)
    command = _known(code)
    if command is None:
        return UnknownRequest(code)
    return EmsconRequest(
        command, bodies.decode_body(SHAPES[command].request, packet.body[COMMAND_HEADER.size :])
    )


def _answer(body: bytes) -> Answer:
    if len(body) < ANSWER_HEADER.size:
        raise WireError(f"answer of {len(body)} bytes")
    code, status = ANSWER_HEADER.unpack_from(body)
    command = _known(code)
    if command is None:
        raise WireError(f"answer to command {code}, which is never asked")
    if status != ResultStatus.ALL_OK:
        return Answer(command, status)
    tail = body[ANSWER_HEADER.size :]
    return Answer(
        command, status, bodies.decode_body(SHAPES[command].answer, tail, may_be_longer=True)
    )


def _known(code: int) -> Command | None:
    try:
        return Command(code)
    except ValueError:
        return None


class FromServerFramer:
    """Messages of an instrument from its bytes, in any pieces; raises only `WireError`."""

    def __init__(self) -> None:
        self._packets = PacketFramer()

    def feed(self, data: bytes) -> list[FromServer]:
        """Return the messages completed by these bytes."""
        return [parse_from_server(packet) for packet in self._packets.feed(data)]


class FromClientFramer:
    """Messages of a client from its bytes, in any pieces; raises only `WireError`."""

    def __init__(self) -> None:
        self._packets = PacketFramer()

    def feed(self, data: bytes) -> list[FromClient]:
        """Return the messages completed by these bytes."""
        return [parse_from_client(packet) for packet in self._packets.feed(data)]
