"""Numbered, checked lines: the form that robotline and pointline share.

A question is `>NUMBER VERB words… *CCCC`; its answer `<NUMBER VERB OK words… *CCCC`, or
`<NUMBER VERB NO CODE text… *CCCC`. docs/robotline.md specifies it.
"""

import math
import re
from binascii import crc_hqx
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum
from itertools import count
from typing import Any, ClassVar, Generic, TypeVar, cast
from urllib.parse import quote, unquote

from drivers.errors import WireError
from drivers.wire.framing import LineFramer, messages

LAST_SEQUENCE = 999_999_999
UNREAD_VERB = "?"
"""Verb in the refusal of a line whose own cannot be read."""
CLIENT_MARK, DEVICE_MARK = ">", "<"
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

CommandT = TypeVar("CommandT")
AnswerT = TypeVar("AnswerT")


def sequence_from(first: int) -> Iterator[int]:
    """Count up without an end; after the last number comes 1."""
    return ((number - 1) % LAST_SEQUENCE + 1 for number in count(first))


def checksum(text: bytes) -> int:
    """CRC-16/CCITT-FALSE: polynomial 0x1021, start 0xFFFF, nothing reflected or inverted."""
    return crc_hqx(text, _CHECKSUM_START)


def number_word(value: float) -> str:
    """Write a number with a decimal point and enough digits to read the same double again."""
    if not math.isfinite(value):
        raise WireError(
            f"{value} cannot be sent: it is not a finite number",
            remedy="look where the value comes from: the plan or the robot file",
        )
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def number_words(values: Sequence[float]) -> list[str]:
    """Write numbers, a word each."""
    return [number_word(value) for value in values]


def name_word(text: str) -> str:
    """Write a text as one word: percent-encoded UTF-8, `-` when it is empty."""
    if text == NO_NAME:
        return "%2D"
    return quote(text, safe=_UNQUOTED) or NO_NAME


class LineWords:
    """The words of a line, taken one after another; every taker raises `WireError`."""

    def __init__(self, words: Sequence[str]) -> None:
        self._words = words
        self._taken = 0

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

    def end(self) -> None:
        """Insist that no word is left."""
        if self._taken < len(self._words):
            raise WireError(f"'{self._words[self._taken]}' is one word too many")

    # Any: the taker is called with the words of the class that lists it
    READERS: ClassVar[Mapping[str, Callable[[Any, str], object]]] = {
        "w": whole,
        "d": number,
        "f": flag,
        "n": name,
    }


class LineMessage:
    """Message with a letter of `FIELDS` for each field, in the order of its words.

    `w` whole number, `d` number, `s` one within limits, `f` flag, `n` name, `a` words as they
    stand; any other letter, whose meaning the protocol says, several numbers.
    """

    __slots__ = ()
    FIELDS: ClassVar[str] = ""
    # Any: the value's type is the field's, which no table can tell the type checker
    WRITTEN: ClassVar[Mapping[str, Callable[[Any], Sequence[str]]]] = {
        "w": lambda value: [str(value)],
        **dict.fromkeys("ds", lambda value: [number_word(value)]),
        "f": lambda value: ["1" if value else "0"],
        "n": lambda value: [name_word(value)],
        "a": str.split,
    }

    def words(self) -> list[str]:
        """Words of the message; raises `WireError` for a number that is not finite."""
        slots = zip(self.FIELDS, fields(cast("Any", self)), strict=True)
        return [
            word
            for code, slot in slots
            for word in self.WRITTEN.get(code, number_words)(getattr(self, slot.name))
        ]


@dataclass(frozen=True, slots=True)
class Hello(LineMessage):
    """Greets, and says which version of the protocol the client speaks."""

    FIELDS = "w"
    version: int


@dataclass(frozen=True, slots=True)
class CommandDone(LineMessage):
    """Done, and nothing more to say."""


class LineOrder(Enum):
    """Command of a verb alone."""

    def words(self) -> list[str]:
        """Words behind the verb: none."""
        return []


@dataclass(frozen=True)  # slots and a generic of given types do not go together
class LineRequest(Generic[CommandT]):
    """A numbered command."""

    sequence: int
    command: CommandT


@dataclass(frozen=True, slots=True)
class Refused:
    """The device says no; `code` is a word of the specification, `text` is for people."""

    code: str
    text: str


@dataclass(frozen=True)  # slots and a generic of given types do not go together
class LineReply(Generic[AnswerT]):
    """Reply to the question of that number and verb; `line` is it as it came."""

    sequence: int
    verb: str
    outcome: AnswerT | Refused
    line: str = field(default="", compare=False)


class BadRequest(WireError):
    """A line that no device can act on. `reply` is what it must say; None: nothing."""

    def __init__(self, problem: str, reply: LineReply[Any] | None) -> None:
        super().__init__(problem)
        self.reply = reply


class LineGrammar(Generic[CommandT, AnswerT]):
    """A protocol's verbs, each with its command and what is answered, in lines of a length.

    `words_of` takes the words of a line as the protocol has them.
    """

    def __init__(
        self,
        verbs: Mapping[str, tuple[type[LineMessage] | LineOrder, type[LineMessage]]],
        line_bytes: int,
        words_of: Callable[[Sequence[str]], LineWords],
    ) -> None:
        self._messages = verbs
        self._words_of = words_of
        self._verbs = {command: verb for verb, (command, _) in verbs.items()}
        self._line_bytes = line_bytes

    def verb_of(self, command: CommandT) -> str:
        """Verb that a command begins with."""
        return self._verbs[
            command if isinstance(command, LineOrder) else cast("Any", type(command))
        ]

    def line_framer(self) -> LineFramer:
        """Cut a stream into lines."""
        return LineFramer(self._line_bytes - len(EMPTY_LINE))

    def encode_request(self, request: LineRequest[CommandT]) -> bytes:
        """Write a question as a line; raises `WireError` for a number that is not finite."""
        command = cast("LineMessage | LineOrder", request.command)
        head = f"{CLIENT_MARK}{request.sequence}"
        return self._pack([head, self.verb_of(request.command), *command.words()])

    def encode_reply(self, reply: LineReply[AnswerT]) -> bytes:
        """Write an answer as a line; a refusal's text is cleaned and cut to what a line holds."""
        head = [f"{DEVICE_MARK}{reply.sequence}", reply.verb]
        if isinstance(reply.outcome, Refused):
            text = _NOT_PRINTABLE.sub("?", reply.outcome.text)[:_REFUSAL_CHARACTERS]
            return self._pack([*head, "NO", reply.outcome.code, *text.split()])
        return self._pack([*head, "OK", *cast("LineMessage", reply.outcome).words()])

    def replies(self) -> Callable[[bytes], list[LineReply[AnswerT]]]:
        """Replies from bytes, in any pieces; empty lines are passed over.

        Raises only `WireError`.
        """
        return messages(self.line_framer().feed, self.decode_reply)

    def decode_request(self, line: bytes) -> LineRequest[CommandT]:
        """Question of a line without its line feed; raises `BadRequest`."""
        try:
            sequence, words = self._unpack(line, CLIENT_MARK)
        except WireError as error:
            raise BadRequest(error.problem, _reply_to_damaged(line, error.problem)) from error
        verb = words[0] if words else ""
        if verb not in self._messages:
            problem = f"verb '{verb}' is not known"
            unread: LineReply[Any] = LineReply(sequence, UNREAD_VERB, Refused("VERB", problem))
            raise BadRequest(problem, unread)
        kind, taken = self._messages[verb][0], self._words_of(words[1:])
        try:
            command = kind if isinstance(kind, LineOrder) else _read_all(taken, kind)
            taken.end()
        except WireError as error:
            wrong: LineReply[Any] = LineReply(sequence, verb, Refused("ARGUMENT", error.problem))
            raise BadRequest(error.problem, wrong) from error
        return LineRequest(sequence, cast("CommandT", command))

    def decode_reply(self, line: bytes) -> LineReply[AnswerT]:
        """Answer of a line without its line feed; raises `WireError`."""
        sequence, words = self._unpack(line, DEVICE_MARK)
        match words:
            case [verb, "OK", *rest] if verb in self._messages:
                taken = self._words_of(rest)
                answer = cast("AnswerT", _read_all(taken, self._messages[verb][1]))
                taken.end()
                return LineReply(sequence, verb, answer, line.decode("ascii"))
            case [verb, "NO", code, *rest] if self._is_refusal(verb, code):
                refused = Refused(code, " ".join(rest))
                return LineReply(sequence, verb, refused, line.decode("ascii"))
        raise WireError(f"neither 'VERB OK …' nor 'VERB NO CODE …': {line[:_SHOWN_BYTES]!r}")

    def _is_refusal(self, verb: str, code: str) -> bool:
        known = verb in self._messages or verb == UNREAD_VERB
        return known and _CODE.fullmatch(code) is not None

    def _pack(self, words: Sequence[str]) -> bytes:
        body = " ".join(words).encode("ascii")
        line = b"%s *%04X\n" % (body, checksum(body))
        if len(line) > self._line_bytes:
            raise WireError(
                f"a line of {len(line)} bytes cannot be sent, the limit is {self._line_bytes}"
            )
        return line

    def _unpack(self, line: bytes, mark: str) -> tuple[int, list[str]]:
        """Check a line and return its number and the words behind it."""
        if len(line) >= self._line_bytes:
            raise WireError(
                f"a line of more than {self._line_bytes} bytes: {line[:_SHOWN_BYTES]!r}"
            )
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


def _read_all(taken: LineWords, kind: type[LineMessage]) -> LineMessage:
    slots = zip(kind.FIELDS, fields(cast("Any", kind)), strict=True)
    values = [taken.READERS[code](taken, slot.name) for code, slot in slots]
    return cast("Callable[..., LineMessage]", kind)(*values)


def _unquoted(word: str, meaning: str) -> str:
    if not _NAME.fullmatch(word):
        raise WireError(f"{meaning} '{word}' is not percent-encoded text")
    try:
        return unquote(word, errors="strict")
    except UnicodeDecodeError as error:
        raise WireError(f"{meaning} '{word}' is not UTF-8") from error


def _reply_to_damaged(line: bytes, problem: str) -> LineReply[Any] | None:
    damaged = _DAMAGED_QUESTION.match(line)
    if damaged is None:
        return None
    return LineReply(int(damaged[1]), UNREAD_VERB, Refused("CHECKSUM", problem))
