"""Lines of robotline, our protocol for robot controllers: checksum, question and answer.

The specification is docs/robotline.md. The client and the simulated controller share this grammar.
"""

import re
from binascii import crc_hqx
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import TypeVar

from drivers.errors import WireError
from drivers.wire.framing import LineFramer
from drivers.wire.robotline_messages import (
    ANSWERS,
    COMMANDS,
    Answer,
    Command,
    Message,
    RobotLayout,
)
from drivers.wire.robotline_words import Words

LINE_BYTES = 255
"""The longest line; line feed and carriage return count."""
LAST_SEQUENCE = 999_999_999
UNREAD_VERB = "?"
"""Verb in the refusal of a line whose own cannot be read."""
CLIENT_MARK, CONTROLLER_MARK = ">", "<"
EMPTY_LINE = b"\n"
"""Line that says nothing, but ends one that was left half sent."""

_REFUSAL_CHARACTERS = 200
_SHOWN_BYTES = 80
_CHECKSUM_START = 0xFFFF
_CHECKED_LINE = re.compile(rb"([!-~]+(?: [!-~]+)*) \*([0-9A-F]{4})")
_NUMBERED = re.compile(r"([<>])([1-9][0-9]{0,8})")
_DAMAGED_QUESTION = re.compile(rb">([1-9][0-9]{0,8}) ")
_CODE = re.compile(r"[A-Z]+")
_NOT_PRINTABLE = re.compile(r"[^ -~]")

MessageT = TypeVar("MessageT", bound=Message)


@dataclass(frozen=True, slots=True)
class Request:
    """A numbered command."""

    sequence: int
    command: Command


@dataclass(frozen=True, slots=True)
class Refused:
    """The controller says no; `code` is a word of the specification, `text` is for people."""

    code: str
    text: str


@dataclass(frozen=True, slots=True)
class Reply:
    """Reply to the question of that number and verb; `line` is it as it came."""

    sequence: int
    verb: str
    outcome: Answer | Refused
    line: str = field(default="", compare=False)


class BadRequest(WireError):
    """A line that no controller can act on. `reply` is what it must say; None: nothing."""

    def __init__(self, problem: str, reply: Reply | None) -> None:
        super().__init__(problem)
        self.reply = reply


def sequence_from(first: int) -> Iterator[int]:
    """Count up without an end; after the last number comes 1."""
    return ((number - 1) % LAST_SEQUENCE + 1 for number in count(first))


def checksum(text: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected or inverted."""
    return crc_hqx(text, _CHECKSUM_START)


def encode_request(request: Request) -> bytes:
    """Write a question as a line; raises `WireError` for a number that is not finite."""
    command = request.command
    return _pack([f"{CLIENT_MARK}{request.sequence}", command.verb, *command.words()])


def encode_reply(reply: Reply) -> bytes:
    """Write an answer as a line; a refusal's text is cleaned and cut to what a line can hold."""
    head = [f"{CONTROLLER_MARK}{reply.sequence}", reply.verb]
    if isinstance(reply.outcome, Refused):
        text = _NOT_PRINTABLE.sub("?", reply.outcome.text)[:_REFUSAL_CHARACTERS]
        return _pack([*head, "NO", reply.outcome.code, *text.split()])
    return _pack([*head, "OK", *reply.outcome.words()])


def decode_request(line: bytes, robot: RobotLayout) -> Request:
    """Question of a line without its line feed; raises `BadRequest`."""
    try:
        sequence, words = _unpack(line, CLIENT_MARK)
    except WireError as error:
        raise BadRequest(error.problem, _reply_to_damaged(line, error.problem)) from error
    verb = words[0] if words else ""
    kind = COMMANDS.get(verb)
    if kind is None:
        problem = f"verb '{verb}' is not known"
        raise BadRequest(problem, Reply(sequence, UNREAD_VERB, Refused("VERB", problem)))
    try:
        return Request(sequence, _read_all(words[1:], kind, robot))
    except WireError as error:
        reply = Reply(sequence, verb, Refused("ARGUMENT", error.problem))
        raise BadRequest(error.problem, reply) from error


def decode_reply(line: bytes, robot: RobotLayout) -> Reply:
    """Answer of a line without its line feed; raises `WireError`."""
    sequence, words = _unpack(line, CONTROLLER_MARK)
    match words:
        case [verb, "OK", *rest] if kind := ANSWERS.get(verb):
            return Reply(sequence, verb, _read_all(rest, kind, robot), line.decode("ascii"))
        case [verb, "NO", code, *rest] if _is_refusal(verb, code):
            return Reply(sequence, verb, Refused(code, " ".join(rest)), line.decode("ascii"))
    raise WireError(f"neither 'VERB OK …' nor 'VERB NO CODE …': {line[:_SHOWN_BYTES]!r}")


class ReplyFramer:
    """Bytes to replies; empty lines are passed over; raises only `WireError`."""

    def __init__(self, robot: RobotLayout) -> None:
        self._lines = line_framer()
        self._robot = robot

    def feed(self, data: bytes) -> list[Reply]:
        """Return the replies completed by these bytes."""
        return [decode_reply(line, self._robot) for line in self._lines.feed(data) if line]


def line_framer() -> LineFramer:
    """Cut a stream into lines of robotline."""
    return LineFramer(LINE_BYTES - len(EMPTY_LINE))


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


def _read_all(words: Sequence[str], kind: type[MessageT], robot: RobotLayout) -> MessageT:
    to_take = Words(words)
    message = kind.read(to_take, robot)
    to_take.end()
    return message


def _is_refusal(verb: str, code: str) -> bool:
    return (verb in ANSWERS or verb == UNREAD_VERB) and _CODE.fullmatch(code) is not None


def _reply_to_damaged(line: bytes, problem: str) -> Reply | None:
    damaged = _DAMAGED_QUESTION.match(line)
    if damaged is None:
        return None
    return Reply(int(damaged[1]), UNREAD_VERB, Refused("CHECKSUM", problem))
