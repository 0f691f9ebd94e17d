"""Grammar of robotline, our protocol for robot controllers: docs/robotline.md is its specification.

Millimetres and degrees, as on the wire. `MESSAGES` says which command each verb is, and what is
answered; `FIELDS` of a message, which words it has. How many joints, coordinates and parameters
there are is the robot's: its `RobotLayout` counts.
"""

import math
import re
from binascii import crc_hqx
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import cached_property
from itertools import count
from typing import Any, ClassVar, Self, TypeVar, cast
from urllib.parse import quote, unquote

from drivers.errors import WireError
from drivers.values import Coordinate
from drivers.wire.framing import LineFramer, messages

VERSION = 1
LINE_BYTES = 255
"""The longest line; line feed and carriage return count."""
LAST_SEQUENCE = 999_999_999
FASTEST_PERCENT = 100.0
UNREAD_VERB = "?"
"""Verb in the refusal of a line whose own cannot be read."""
CLIENT_MARK, CONTROLLER_MARK = ">", "<"
EMPTY_LINE = b"\n"
"""Line that says nothing, but ends one that was left half sent."""
NO_NAME = "-"
_REFUSAL_CHARACTERS = 200
_SHOWN_BYTES = 80
_CHECKSUM_START = 0xFFFF
_CHECKED_LINE = re.compile(rb"([!-~]+(?: [!-~]+)*) \*([0-9A-F]{4})")
_NUMBERED = re.compile(r"([<>])([1-9][0-9]{0,8})")
_DAMAGED_QUESTION = re.compile(rb">([1-9][0-9]{0,8}) ")
_CODE = re.compile(r"[A-Z]+")
_NOT_PRINTABLE = re.compile(r"[^ -~]")
_NUMBER = re.compile(r"-?[0-9]+\.[0-9]+([eE][+-]?[0-9]{1,3})?")
_WHOLE = re.compile(r"0|[1-9][0-9]{0,8}")
_NAME = re.compile(r"([!-$&-~]|%[0-9A-F]{2})+")
_UNQUOTED = "".join(chr(code) for code in range(0x21, 0x7F) if chr(code) != "%")


@dataclass(frozen=True)
class RobotLayout:
    """Joints, coordinates and parameters of a robot.

    Each of `extensions`, `arm0.axis_tilt_deg`, has a line by its name; a controller may have none
    of a kind.
    """

    joints: tuple[Coordinate, ...]
    coordinates: tuple[Coordinate, ...]
    parts: Mapping[str, tuple[str, ...]]
    """Parameters of each line that every controller has, by the words that begin it.

    Those of an arm, `arm0.x_mm`, are in one line `ARM 0`, any other in one of its own.
    """
    extensions: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        joints: Iterable[Coordinate],
        coordinates: Iterable[Coordinate],
        parameters: Iterable[tuple[str, int | None, str]],
        extensions: Iterable[str] = (),
    ) -> Self:
        """Layout of parameters by name, arm and stem: one of no arm has a line `STEM`."""
        parts: dict[str, tuple[str, ...]] = {}
        for name, arm, stem in parameters:
            words = stem.upper() if arm is None else f"ARM {arm}"
            parts[words] = (*parts.get(words, ()), name)
        return cls(tuple(joints), tuple(coordinates), parts, tuple(extensions))

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that every controller has."""
        return frozenset(name for names in self.parts.values() for name in names)

    @cached_property
    def extension_kinds(self) -> tuple[tuple[str, ...], ...]:
        """Extensions by what they are of each arm: `axis_tilt_deg`."""
        by_kind: dict[str, tuple[str, ...]] = {}
        for name in self.extensions:
            kind = name.rpartition(".")[2]
            by_kind[kind] = (*by_kind.get(kind, ()), name)
        return tuple(by_kind.values())

    def parts_of(self, parameters: Mapping[str, float]) -> "Iterator[Part]":
        """Lines that hold a whole parameter set; raises `KeyError` for one that is missing."""
        for words, names in self.parts.items():
            yield Part(words, tuple(parameters[name] for name in names))
        for name in self.extensions:
            if name in parameters:
                yield Part(name, (parameters[name],))

    def names_of(self, words: str) -> tuple[str, ...]:
        """Parameters of a line by the words that begin it; raises `KeyError`."""
        return (words,) if words in self.extensions else self.parts[words]

    def flat(self, part: "Part") -> dict[str, float]:
        """Parameters of a line by their names."""
        return dict(zip(self.names_of(part.name), part.values, strict=True))


class RobotlineMessage:
    """Message with a letter of `FIELDS` for each field, in the order of its words.

    `w` whole number, `d` number, `f` flag, `n` name, `s` speed in percent, `j` joints, `c`
    coordinates, `a` words that name a part, `v` the values of that part.
    """

    __slots__ = ()
    FIELDS: ClassVar[str] = ""

    def words(self) -> list[str]:
        """Words of the message; raises `WireError` for a number that is not finite."""
        slots = zip(self.FIELDS, fields(cast("Any", self)), strict=True)
        return [word for code, slot in slots for word in _WRITTEN[code](getattr(self, slot.name))]


@dataclass(frozen=True, slots=True)
class Hello(RobotlineMessage):
    """Greets, and says which version of the protocol the client speaks."""

    FIELDS = "w"
    version: int


@dataclass(frozen=True, slots=True)
class MoveJoints(RobotlineMessage):
    """Starts a move to joint values."""

    FIELDS = "js"
    joints: tuple[float, ...]
    speed_percent: float


@dataclass(frozen=True, slots=True)
class MovePose(RobotlineMessage):
    """Starts a move to a pose by the controller's own kinematics."""

    FIELDS = "cs"
    coordinates: tuple[float, ...]
    speed_percent: float


class Order(Enum):
    """Command of a verb alone."""

    STATE = "STATE"
    """What do the encoders read now, and is anything wrong?"""
    STOP = "STOP"
    """Bring the robot to a stand at once."""
    COMMIT = "COMMIT"
    """Put all that was staged to work, or nothing."""
    ABANDON = "ABANDON"
    """Throw away what was staged."""

    def words(self) -> list[str]:
        """Words behind the verb: none."""
        return []


@dataclass(frozen=True, slots=True)
class Part(RobotlineMessage):
    """Parameters of one arm or a single one, by the words that name them.

    As a command: part of a new set, which is laid ready without any effect yet. As an answer: what
    the controller works with.
    """

    FIELDS = "av"
    name: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ReadPart(RobotlineMessage):
    """Question for the parameters of one part that the controller works with."""

    FIELDS = "a"
    part: str


@dataclass(frozen=True, slots=True)
class ControllerGreeting(RobotlineMessage):
    """Identity of the controller in its greeting."""

    FIELDS = "wnnnnw"
    version: int
    vendor: str
    model: str
    serial: str
    firmware: str
    axes: int


@dataclass(frozen=True, slots=True)
class ControllerStatus(RobotlineMessage):
    """Readings of the encoders at that moment; `fault` is empty when there is none."""

    FIELDS = "ffnj"
    moving: bool
    emergency_stop: bool
    fault: str
    joints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class MotionBegun(RobotlineMessage):
    """A motion has been accepted and has begun."""

    FIELDS = "d"
    expected_s: float


@dataclass(frozen=True, slots=True)
class CommandDone(RobotlineMessage):
    """Done, and nothing more to say."""


Told = Hello | MoveJoints | MovePose | ReadPart | Part
Command = Told | Order
Answer = ControllerGreeting | ControllerStatus | MotionBegun | CommandDone | Part
MESSAGES: Mapping[str, tuple[type[Told] | Order, type[Answer]]] = {
    "HELLO": (Hello, ControllerGreeting),
    "STATE": (Order.STATE, ControllerStatus),
    "MOVEJ": (MoveJoints, MotionBegun),
    "MOVEP": (MovePose, MotionBegun),
    "STOP": (Order.STOP, CommandDone),
    "GEOM": (ReadPart, Part),
    "STAGE": (Part, CommandDone),
    "COMMIT": (Order.COMMIT, CommandDone),
    "ABANDON": (Order.ABANDON, CommandDone),
}
"""Command and answer of each verb."""
_VERBS = {command: verb for verb, (command, _) in MESSAGES.items()}

MessageT = TypeVar("MessageT", bound=RobotlineMessage)


def verb_of(command: Command) -> str:
    """Verb that a command begins with."""
    return _VERBS[command if isinstance(command, Order) else type(command)]


@dataclass(frozen=True, slots=True)
class RobotlineRequest:
    """A numbered command."""

    sequence: int
    command: Command

    def describe(self) -> str:
        """Say it to people."""
        return f"question {self.sequence}: {self.command}"


@dataclass(frozen=True, slots=True)
class Refused:
    """The controller says no; `code` is a word of the specification, `text` is for people."""

    code: str
    text: str


@dataclass(frozen=True, slots=True)
class RobotlineReply:
    """Reply to the question of that number and verb; `line` is it as it came."""

    sequence: int
    verb: str
    outcome: Answer | Refused
    line: str = field(default="", compare=False)

    def describe(self) -> str:
        """Say it to people."""
        return f"answer {self.sequence} to {self.verb}: {self.outcome}"


class BadRequest(WireError):
    """A line that no controller can act on. `reply` is what it must say; None: nothing."""

    def __init__(self, problem: str, reply: RobotlineReply | None) -> None:
        super().__init__(problem)
        self.reply = reply


def sequence_from(first: int) -> Iterator[int]:
    """Count up without an end; after the last number comes 1."""
    return ((number - 1) % LAST_SEQUENCE + 1 for number in count(first))


def checksum(text: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected or inverted."""
    return crc_hqx(text, _CHECKSUM_START)


def encode_request(request: RobotlineRequest) -> bytes:
    """Write a question as a line; raises `WireError` for a number that is not finite."""
    command = request.command
    return _pack([f"{CLIENT_MARK}{request.sequence}", verb_of(command), *command.words()])


def encode_reply(reply: RobotlineReply) -> bytes:
    """Write an answer as a line; a refusal's text is cleaned and cut to what a line can hold."""
    head = [f"{CONTROLLER_MARK}{reply.sequence}", reply.verb]
    if isinstance(reply.outcome, Refused):
        text = _NOT_PRINTABLE.sub("?", reply.outcome.text)[:_REFUSAL_CHARACTERS]
        return _pack([*head, "NO", reply.outcome.code, *text.split()])
    return _pack([*head, "OK", *reply.outcome.words()])


def decode_request(line: bytes, robot: RobotLayout) -> RobotlineRequest:
    """Question of a line without its line feed; raises `BadRequest`."""
    try:
        sequence, words = _unpack(line, CLIENT_MARK)
    except WireError as error:
        raise BadRequest(error.problem, _reply_to_damaged(line, error.problem)) from error
    verb = words[0] if words else ""
    if verb not in MESSAGES:
        problem = f"verb '{verb}' is not known"
        reply = RobotlineReply(sequence, UNREAD_VERB, Refused("VERB", problem))
        raise BadRequest(problem, reply)
    try:
        return RobotlineRequest(sequence, _command(words[1:], MESSAGES[verb][0], robot))
    except WireError as error:
        reply = RobotlineReply(sequence, verb, Refused("ARGUMENT", error.problem))
        raise BadRequest(error.problem, reply) from error


def decode_reply(line: bytes, robot: RobotLayout) -> RobotlineReply:
    """Answer of a line without its line feed; raises `WireError`."""
    sequence, words = _unpack(line, CONTROLLER_MARK)
    match words:
        case [verb, "OK", *rest] if verb in MESSAGES:
            answer = _read_all(rest, MESSAGES[verb][1], robot)
            return RobotlineReply(sequence, verb, answer, line.decode("ascii"))
        case [verb, "NO", code, *rest] if _is_refusal(verb, code):
            refused = Refused(code, " ".join(rest))
            return RobotlineReply(sequence, verb, refused, line.decode("ascii"))
    raise WireError(f"neither 'VERB OK …' nor 'VERB NO CODE …': {line[:_SHOWN_BYTES]!r}")


def replies(robot: RobotLayout) -> Callable[[bytes], list[RobotlineReply]]:
    """Replies from bytes, in any pieces; empty lines are passed over; raises only `WireError`."""
    return messages(line_framer().feed, lambda line: decode_reply(line, robot))


def line_framer() -> LineFramer:
    """Cut a stream into lines of robotline."""
    return LineFramer(LINE_BYTES - len(EMPTY_LINE))


def number_word(value: float) -> str:
    """Write a number with a decimal point and enough digits to read the same double again."""
    if not math.isfinite(value):
        raise WireError(
            f"{value} cannot be sent: it is not a finite number",
            remedy="look where the value comes from: the plan or the robot file",
        )
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def name_word(text: str) -> str:
    """Write a text as one word: percent-encoded UTF-8, `-` when it is empty."""
    if text == NO_NAME:
        return "%2D"
    return quote(text, safe=_UNQUOTED) or NO_NAME


class Words:
    """The words of a line, taken one after another; every taker raises `WireError`."""

    def __init__(self, words: Sequence[str], robot: RobotLayout) -> None:
        self._words = words
        self._robot = robot
        self._taken = 0
        self._part = ""

    def word(self, meaning: str) -> str:
        """Take the next word as it stands."""
        if self._taken == len(self._words):
            raise WireError(f"the line ends where {meaning} was expected")
        self._taken += 1
        return self._words[self._taken - 1]

    def number(self, meaning: str) -> float:
        """Take a finite number written with a decimal point."""
        word = self.word(meaning)
        value = float(word) if _NUMBER.fullmatch(word) else math.nan
        if not math.isfinite(value):
            raise WireError(f"{meaning} is '{word}', not a number like -12.5")
        return value

    def speed(self, meaning: str) -> float:
        """Take a share of the full speed in percent."""
        value = self.number(meaning)
        if not 0.0 < value <= FASTEST_PERCENT:
            raise WireError(f"{meaning} is {value:g}, not above 0 and up to 100")
        return value

    def joints(self, _meaning: str) -> tuple[float, ...]:
        """Take as many numbers as the robot has joints."""
        return tuple(self.number(f"joint {index}") for index in range(len(self._robot.joints)))

    def coordinates(self, _meaning: str) -> tuple[float, ...]:
        """Take as many numbers as the robot has coordinates."""
        indices = range(len(self._robot.coordinates))
        return tuple(self.number(f"coordinate {index}") for index in indices)

    def whole(self, meaning: str) -> int:
        """Take a whole number from 0 to 999999999."""
        word = self.word(meaning)
        if not _WHOLE.fullmatch(word):
            raise WireError(f"{meaning} is '{word}', not a whole number")
        return int(word)

    def flag(self, meaning: str) -> bool:
        """Take 0 or 1."""
        word = self.word(meaning)
        if word not in {"0", "1"}:
            raise WireError(f"{meaning} is '{word}', neither 0 nor 1")
        return word == "1"

    def name(self, meaning: str) -> str:
        """Take a percent-encoded text of printable characters."""
        word = self.word(meaning)
        if word == NO_NAME:
            return ""
        text = _unquoted(word, meaning)
        if not text.isprintable():
            raise WireError(f"{meaning} '{word}' holds characters that cannot be printed")
        return text

    def part_name(self, _meaning: str) -> str:
        """Take `ARM` with a number, or the name of a single parameter."""
        parts = self._robot.parts
        singles = [name for name in parts if " " not in name]
        word = self.word(" or ".join(["ARM", *singles]))
        if word in singles or word in self._robot.extensions:
            self._part = word
            return word
        if word != "ARM":
            raise WireError(f"'{word}' is neither {' nor '.join(['ARM', *singles])}")
        name = f"ARM {self.whole('arm')}"
        if name not in parts:
            last = len(parts) - len(singles) - 1
            raise WireError(f"arm is {name.removeprefix('ARM ')}, not 0 to {last}")
        self._part = name
        return name

    def values(self, _meaning: str) -> tuple[float, ...]:
        """Take the values of the part that was named before."""
        return tuple(self.number(each) for each in self._robot.names_of(self._part))

    def end(self) -> None:
        """Insist that no word is left."""
        if self._taken < len(self._words):
            raise WireError(f"'{self._words[self._taken]}' is one word too many")


def _numbers(values: Sequence[float]) -> list[str]:
    return [number_word(value) for value in values]


# Any: the value's type is the field's, which no table can tell the type checker
_WRITTEN: Mapping[str, Callable[[Any], Sequence[str]]] = {
    "w": lambda value: [str(value)],
    "d": lambda value: [number_word(value)],
    "f": lambda value: ["1" if value else "0"],
    "n": lambda value: [name_word(value)],
    "s": lambda value: [number_word(value)],
    "j": _numbers,
    "c": _numbers,
    "a": str.split,
    "v": _numbers,
}
_READ: Mapping[str, Callable[[Words, str], object]] = {
    "w": Words.whole,
    "d": Words.number,
    "f": Words.flag,
    "n": Words.name,
    "s": Words.speed,
    "j": Words.joints,
    "c": Words.coordinates,
    "a": Words.part_name,
    "v": Words.values,
}


def _command(words: Sequence[str], kind: type[Told] | Order, robot: RobotLayout) -> Command:
    if isinstance(kind, Order):
        Words(words, robot).end()
        return kind
    return _read_all(words, kind, robot)


def _read_all(words: Sequence[str], kind: type[MessageT], robot: RobotLayout) -> MessageT:
    taken = Words(words, robot)
    slots = zip(kind.FIELDS, fields(cast("Any", kind)), strict=True)
    make = cast("Callable[..., MessageT]", kind)
    message = make(*(_READ[code](taken, slot.name) for code, slot in slots))
    taken.end()
    return message


def _unquoted(word: str, meaning: str) -> str:
    if not _NAME.fullmatch(word):
        raise WireError(f"{meaning} '{word}' is not percent-encoded text")
    try:
        return unquote(word, errors="strict")
    except UnicodeDecodeError as error:
        raise WireError(f"{meaning} '{word}' is not UTF-8") from error


def _pack(words: Sequence[str]) -> bytes:
    body = " ".join(words).encode("ascii")
    line = b"%s *%04X\n" % (body, checksum(body))
    if len(line) > LINE_BYTES:
        raise WireError(f"a line of {len(line)} bytes cannot be sent, the limit is {LINE_BYTES}")
    return line


def _unpack(line: bytes, mark: str) -> tuple[int, list[str]]:
    """Check a line and return its number and the words behind it."""
    if len(line) >= LINE_BYTES:
        raise WireError(f"a line of more than {LINE_BYTES} bytes: {line[:_SHOWN_BYTES]!r}")
    checked = _CHECKED_LINE.fullmatch(line)
    if checked is None:
        raise WireError(f"not words and a checksum: {line[:_SHOWN_BYTES]!r}")
    if checksum(checked[1]) != int(checked[2], 16):
        raise WireError(f"the checksum does not fit: {line[:_SHOWN_BYTES]!r}")
    head, *words = checked[1].decode("ascii").split(" ")
    numbered = _NUMBERED.fullmatch(head)
    if numbered is None or numbered[1] != mark:
        raise WireError(f"does not begin with '{mark}' and a number: {line[:_SHOWN_BYTES]!r}")
    return int(numbered[2]), words


def _is_refusal(verb: str, code: str) -> bool:
    return (verb in MESSAGES or verb == UNREAD_VERB) and _CODE.fullmatch(code) is not None


def _reply_to_damaged(line: bytes, problem: str) -> RobotlineReply | None:
    damaged = _DAMAGED_QUESTION.match(line)
    if damaged is None:
        return None
    return RobotlineReply(int(damaged[1]), UNREAD_VERB, Refused("CHECKSUM", problem))
