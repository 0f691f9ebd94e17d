"""Grammar of emScon: commands, answers and what comes unasked, as packets.

Everything on this wire is a packet: size, type and body (`framing.py`), little endian. After these
eight bytes comes

    command     type 0, from the client      int command, parameters
    answer      type 0, from the server      int command, int status, values
    error       type 1, unasked              int command, int status
    result      type 2 or 9, unasked         int status, values
    position    type 7, unasked              int status, point
    change      type 8, unasked              int code

Commands and answers have the same type, and only the direction distinguishes them: there are two
readers, `from_server` and `from_client`. Parameters and values are the bodies of
`emscon_messages.py`; the tables `REQUESTS` and `ANSWERS` tie them to their commands.
Layouts and sources: docs/reference/emscon.md.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from drivers.errors import WireError
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import Command, DataType, ResultStatus
from drivers.wire.framing import Packet, PacketFramer, encode_packet, messages

NOTHING = bodies.Nothing()
COMMAND_HEADER = struct.Struct("<i")
ANSWER_HEADER = struct.Struct("<ii")


REQUESTS: Mapping[Command, type[bodies.Body]] = {
    Command.SET_UNITS: bodies.Units,
    Command.SET_ENVIRONMENT_PARAMS: bodies.Environment,
    Command.SET_MEASUREMENT_MODE: bodies.Code,
    Command.SET_COORDINATE_SYSTEM_TYPE: bodies.Code,
    Command.SET_STATIONARY_MODE_PARAMS: bodies.StationaryMode,
    Command.SET_REFLECTOR: bodies.Code,
    Command.SET_SEARCH_PARAMS: bodies.SearchParams,
    Command.SET_SYSTEM_SETTINGS: bodies.SystemSettings,
    Command.GO_POSITION: bodies.BeamTarget,
    Command.FIND_REFLECTOR: bodies.ApproximateDistance,
    Command.SET_STATISTIC_MODE: bodies.StatisticMode,
}
"""Contents after the command code, of a command that has any."""
ANSWERS: Mapping[Command, type[bodies.Body]] = {
    Command.GET_SYSTEM_STATUS: bodies.SystemStatus,
    Command.GET_TRACKER_STATUS: bodies.Code,
    Command.GET_UNITS: bodies.Units,
    Command.GET_ENVIRONMENT_PARAMS: bodies.Environment,
    Command.GET_MEASUREMENT_MODE: bodies.Code,
    Command.GET_COORDINATE_SYSTEM_TYPE: bodies.Code,
    Command.GET_STATIONARY_MODE_PARAMS: bodies.StationaryMode,
    Command.GET_REFLECTOR: bodies.Code,
    Command.GET_REFLECTORS: bodies.ReflectorEntry,
    Command.GET_SEARCH_PARAMS: bodies.SearchParams,
    Command.GET_SYSTEM_SETTINGS: bodies.SystemSettings,
    Command.GET_DIRECTION: bodies.Direction,
    Command.GET_STATISTIC_MODE: bodies.StatisticMode,
    Command.GET_MEASUREMENT_STATUS_INFO: bodies.MeasurementStatusInfo,
    Command.GET_TRACKER_INFO: bodies.TrackerInfo,
}
"""Contents after the status of an answer, where it has any."""


@dataclass(frozen=True, slots=True)
class EmsconRequest:
    """A command with its parameters."""

    command: Command
    body: bodies.Body = field(default=NOTHING)


@dataclass(frozen=True, slots=True)
class UnknownRequest:
    """A well-formed command that this grammar has no parameters for."""

    command: int


@dataclass(frozen=True, slots=True)
class Answer:
    """A command's answer. A refusal (status not 0) has no body, whatever followed on the wire."""

    command: Command
    status: int = ResultStatus.ALL_OK
    body: bodies.Body = field(default=NOTHING)


Unasked = (
    bodies.ErrorResponse
    | bodies.StatusChange
    | bodies.ReflectorPosition
    | bodies.SingleResult
    | bodies.SingleResult2
)
"""Messages that come unasked."""
FromServer = Answer | Unasked | Packet
"""Message of an instrument; a `Packet` where it is of an unknown type, or of one not used here."""
FromClient = EmsconRequest | UnknownRequest

_UNASKED: Mapping[int, type[Unasked]] = {
    DataType.ERROR: bodies.ErrorResponse,
    DataType.STATUS_CHANGE: bodies.StatusChange,
    DataType.REFLECTOR_POSITION: bodies.ReflectorPosition,
    DataType.SINGLE_RESULT: bodies.SingleResult,
    DataType.SINGLE_RESULT_2: bodies.SingleResult2,
}
_KIND_OF = {body: kind for kind, body in _UNASKED.items()}


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
        case Packet():
            return message
        case _:
            return Packet(_KIND_OF[type(message)], bodies.encode_body(message))


def refusal(command: int, status: int) -> bytes:
    """Write a refusal, also of a command that the grammar does not have.

    Zeros stand in place of the answer's fields: some clients read them whatever the status is.
    """
    listed = _command_of(command)
    tail_bytes = 656  # of the longest of the public answers
    if listed is not None:
        tail_bytes = bodies.layout_of(ANSWERS.get(listed, bodies.Nothing)).size
    body = ANSWER_HEADER.pack(command, status) + bytes(tail_bytes)
    return encode_packet(Packet(DataType.COMMAND, body))


def parse_from_server(packet: Packet) -> FromServer:
    """Read what an instrument sent; raises `WireError`."""
    if packet.kind == DataType.COMMAND:
        return _answer(packet.body)
    if kind := _UNASKED.get(packet.kind):
        return bodies.decode_body(kind, packet.body, may_be_longer=True)
    return packet


def parse_from_client(packet: Packet) -> FromClient:
    """Read what a client sent; raises `WireError`."""
    if packet.kind != DataType.COMMAND:
        raise WireError(f"packet of type {packet.kind} from a client, only commands are expected")
    if len(packet.body) < COMMAND_HEADER.size:
        raise WireError(f"command of {len(packet.body)} bytes")
    (code,) = COMMAND_HEADER.unpack_from(packet.body)
    command = _command_of(code)
    if command is None:
        return UnknownRequest(code)
    # A client is held to exact sizes; only what an instrument sends may be longer.
    kind = REQUESTS.get(command, bodies.Nothing)
    return EmsconRequest(command, bodies.decode_body(kind, packet.body[COMMAND_HEADER.size :]))


def _answer(body: bytes) -> Answer:
    if len(body) < ANSWER_HEADER.size:
        raise WireError(f"answer of {len(body)} bytes")
    code, status = ANSWER_HEADER.unpack_from(body)
    command = _command_of(code)
    if command is None:
        raise WireError(f"answer to command {code}, which is never asked")
    # What follows a refusal is unconfirmed: nothing, or the answer's fields without meaning.
    if status != ResultStatus.ALL_OK:
        return Answer(command, status)
    kind, tail = ANSWERS.get(command, bodies.Nothing), body[ANSWER_HEADER.size :]
    return Answer(command, status, bodies.decode_body(kind, tail, may_be_longer=True))


def _command_of(code: int) -> Command | None:
    try:
        return Command(code)
    except ValueError:
        return None


def from_server() -> Callable[[bytes], list[FromServer]]:
    """Return a reader that takes a server's bytes, cut anywhere, and returns whole messages.

    The reader raises only `WireError`.
    """
    return messages(PacketFramer().feed, parse_from_server)


def from_client() -> Callable[[bytes], list[FromClient]]:
    """Return a reader of a client's bytes, in any pieces; it raises only `WireError`."""
    return messages(PacketFramer().feed, parse_from_client)
