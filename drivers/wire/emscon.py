"""Bodies of emScon packets: dataclass ↔ bytes.

A body's `LAYOUT` has one letter a field: `i` 32-bit integer (also enumerations and flags, 0 or 1),
`d` double, `v` three doubles, `s` text of 32 UTF-16 units. All little endian, without padding.
"""

import struct
from dataclasses import dataclass, field

from drivers.errors import WireError
from drivers.wire.emscon_constants import (
    OTHER_TAILS_BYTES,
    Command,
    DataType,
    ResultStatus,
    status_text,
)
from drivers.wire.emscon_messages import (
    ApproximateDistance,
    BeamTarget,
    Body,
    CoordinateSystem,
    Direction,
    Environment,
    ErrorResponse,
    Face,
    MeasurementMode,
    MeasurementStatusInfo,
    Nothing,
    ReflectorChoice,
    ReflectorEntry,
    ReflectorPlace,
    ReflectorPosition,
    Refraction,
    SearchParams,
    SingleResult,
    SingleResult2,
    SoftwareVersion,
    StationaryMode,
    StationOrientation,
    StatisticMode,
    StatusChange,
    SystemSettings,
    SystemStatus,
    TrackerInfo,
    TrackerStatus,
    Transformation,
    Units,
    decode_body,
    encode_body,
    layout_of,
)
from drivers.wire.framing import Packet, PacketFramer, encode_packet

NOTHING = Nothing()
COMMAND_HEADER = struct.Struct("<i")
ANSWER_HEADER = struct.Struct("<ii")


@dataclass(frozen=True, slots=True)
class Shape:
    """Contents after the command code in a request, and after the status in an answer."""

    request: type[Body] = Nothing
    answer: type[Body] = Nothing


SHAPES: dict[Command, Shape] = {
    Command.GET_SYSTEM_STATUS: Shape(answer=SystemStatus),
    Command.GET_TRACKER_STATUS: Shape(answer=TrackerStatus),
    Command.SET_UNITS: Shape(request=Units),
    Command.GET_UNITS: Shape(answer=Units),
    Command.INITIALIZE: Shape(),
    Command.SET_STATION_ORIENTATION_PARAMS: Shape(request=StationOrientation),
    Command.GET_STATION_ORIENTATION_PARAMS: Shape(answer=StationOrientation),
    Command.SET_TRANSFORMATION_PARAMS: Shape(request=Transformation),
    Command.GET_TRANSFORMATION_PARAMS: Shape(answer=Transformation),
    Command.SET_ENVIRONMENT_PARAMS: Shape(request=Environment),
    Command.GET_ENVIRONMENT_PARAMS: Shape(answer=Environment),
    Command.SET_REFRACTION_PARAMS: Shape(request=Refraction),
    Command.GET_REFRACTION_PARAMS: Shape(answer=Refraction),
    Command.SET_MEASUREMENT_MODE: Shape(request=MeasurementMode),
    Command.GET_MEASUREMENT_MODE: Shape(answer=MeasurementMode),
    Command.SET_COORDINATE_SYSTEM_TYPE: Shape(request=CoordinateSystem),
    Command.GET_COORDINATE_SYSTEM_TYPE: Shape(answer=CoordinateSystem),
    Command.SET_STATIONARY_MODE_PARAMS: Shape(request=StationaryMode),
    Command.GET_STATIONARY_MODE_PARAMS: Shape(answer=StationaryMode),
    Command.SET_REFLECTOR: Shape(request=ReflectorChoice),
    Command.GET_REFLECTOR: Shape(answer=ReflectorChoice),
    Command.GET_REFLECTORS: Shape(answer=ReflectorEntry),
    Command.SET_SEARCH_PARAMS: Shape(request=SearchParams),
    Command.GET_SEARCH_PARAMS: Shape(answer=SearchParams),
    Command.SET_SYSTEM_SETTINGS: Shape(request=SystemSettings),
    Command.GET_SYSTEM_SETTINGS: Shape(answer=SystemSettings),
    Command.START_MEASUREMENT: Shape(),
    Command.STOP_MEASUREMENT: Shape(),
    Command.GO_POSITION: Shape(request=BeamTarget),
    Command.FIND_REFLECTOR: Shape(request=ApproximateDistance),
    Command.GET_DIRECTION: Shape(answer=Direction),
    Command.SET_STATISTIC_MODE: Shape(request=StatisticMode),
    Command.GET_STATISTIC_MODE: Shape(answer=StatisticMode),
    Command.GET_MEASUREMENT_STATUS_INFO: Shape(answer=MeasurementStatusInfo),
    Command.GET_FACE: Shape(answer=Face),
    Command.GET_TRACKER_INFO: Shape(answer=TrackerInfo),
    Command.GO_AND_MEASURE: Shape(request=ReflectorPlace),
    Command.GET_SYSTEM_SOFTWARE_VERSION: Shape(answer=SoftwareVersion),
}


@dataclass(frozen=True, slots=True)
class EmsconRequest:
    """A command with its parameters."""

    command: Command
    body: Body = field(default=NOTHING)

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
    body: Body = field(default=NOTHING)

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
    ErrorResponse | StatusChange | ReflectorPosition | SingleResult | SingleResult2 | OtherPacket
)
FromServer = Answer | Unasked
FromClient = EmsconRequest | UnknownRequest

_UNASKED: dict[
    int, type[ErrorResponse | StatusChange | ReflectorPosition | SingleResult | SingleResult2]
] = {
    DataType.ERROR: ErrorResponse,
    DataType.STATUS_CHANGE: StatusChange,
    DataType.REFLECTOR_POSITION: ReflectorPosition,
    DataType.SINGLE_RESULT: SingleResult,
    DataType.SINGLE_RESULT_2: SingleResult2,
}
_KIND_OF = {body: kind for kind, body in _UNASKED.items()}
_KINDS = frozenset(DataType)


def encode(message: FromServer | FromClient) -> bytes:
    """Write a message as one packet."""
    return encode_packet(_packet(message))


def _packet(message: FromServer | FromClient) -> Packet:
    match message:
        case EmsconRequest(command, body):
            return Packet(DataType.COMMAND, COMMAND_HEADER.pack(command) + encode_body(body))
        case UnknownRequest(command):
            return Packet(DataType.COMMAND, COMMAND_HEADER.pack(command))
        case Answer(command, status, body):
            return Packet(DataType.COMMAND, ANSWER_HEADER.pack(command, status) + encode_body(body))
        case OtherPacket(kind, data):
            return Packet(kind, data)
        case _:
            return Packet(_KIND_OF[type(message)], encode_body(message))


def refusal(command: int, status: int) -> bytes:
    """Write a refusal, also of a command that the grammar doesn't know.

    With zeros in place of the answer's fields: some clients read them whatever the status says.
    """
    known = _known(command)
    tail_bytes = (
        OTHER_TAILS_BYTES.get(command, 0) if known is None else layout_of(SHAPES[known].answer).size
    )
    body = ANSWER_HEADER.pack(command, status) + bytes(tail_bytes)
    return encode_packet(Packet(DataType.COMMAND, body))


def parse_from_server(packet: Packet) -> FromServer:
    """Read what an instrument sent; raises `WireError`."""
    if packet.kind == DataType.COMMAND:
        return _answer(packet.body)
    if kind := _UNASKED.get(packet.kind):
        return decode_body(kind, packet.body, may_be_longer=True)
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
        command, decode_body(SHAPES[command].request, packet.body[COMMAND_HEADER.size :])
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
    return Answer(command, status, decode_body(SHAPES[command].answer, tail, may_be_longer=True))


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
