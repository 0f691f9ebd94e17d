"""Numbered, checked lines: the grammar that robotline and pointline share.

Its specification is docs/reference/robotline.md.

A question is `>NUMBER VERB words… *CCCC`; its answer `<NUMBER VERB OK words… *CCCC`, or
`<NUMBER VERB NO CODE text… *CCCC`. The words are the fields of a dataclass, in their order. The
annotation of a field says how it is written: `int` as a whole number, `float` with a decimal point,
`bool` as 0 or 1, `str` as a percent-encoded name, `Title` as it stands. A tuple of three floats is
three numbers; `tuple[float, ...]` takes all numbers that the fields behind it leave.
"""

import math
import re
from binascii import crc_hqx
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import count
from typing import Any, NewType, TypeVar, cast, get_args, get_origin
from urllib.parse import quote, unquote

from drivers.errors import WireError
from drivers.wire.framing import LineFramer, messages

LAST_NUMBER = 999_999_999
UNREAD_VERB = "?"
"""Verb in the refusal of a line whose own verb cannot be read."""
QUESTION_MARK, ANSWER_MARK = ">", "<"
EMPTY_LINE = b"\n"
"""Line that says nothing, but ends one that was left half sent."""
NO_NAME = "-"
_REFUSAL_CHARACTERS = 200
_CHECKED_LINE = re.compile(rb"([!-~]+(?: [!-~]+)*) \*([0-9A-F]{4})")
_NUMBERED = re.compile(r"([<>])([1-9][0-9]{0,8})")
_DAMAGED_QUESTION = re.compile(rb">([1-9][0-9]{0,8}) ")
_CODE = re.compile(r"[A-Z]+")
_NOT_PRINTABLE = re.compile(r"[^ -~]")
_DECIMAL = re.compile(r"-?[0-9]+\.[0-9]+([eE][+-]?[0-9]{1,3})?")
_WHOLE = re.compile(r"0|[1-9][0-9]{0,8}")
_NAME = re.compile(r"([!-$&-~]|%[0-9A-F]{2})+")
_UNQUOTED = "".join(chr(code) for code in range(0x21, 0x7F) if chr(code) != "%")

Title = NewType("Title", str)
"""A word as it stands, and a whole number behind it if there is one: `PLATE`, `ARM 2`."""
Body = TypeVar("Body")


@dataclass(frozen=True, slots=True)
class Nothing:
    """No words behind the verb, or behind OK."""


@dataclass(frozen=True, slots=True)
class Hello:
    """Greeting of a client, with the version of the protocol that it speaks."""

    version: int


@dataclass(frozen=True, slots=True)
class Greeting:
    """Identity of a device, with the version of the protocol that it speaks."""

    version: int
    vendor: str
    model: str
    serial: str
    firmware: str


@dataclass(frozen=True, slots=True)
class Refused:
    """Refusal; `code` is a word of the specification, `text` is for people."""

    code: str
    text: str


@dataclass(frozen=True, slots=True)
class Question:
    """A numbered question."""

    number: int
    verb: str
    body: object = Nothing()


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to the question of that number and verb; `line` is it as it came."""

    number: int
    verb: str
    body: object
    line: str = field(default="", compare=False)


class BadQuestion(WireError):
    """A line that no device can act on. `answer` is what it must say; None: nothing."""

    def __init__(self, problem: str, answer: Answer | None) -> None:
        super().__init__(problem)
        self.answer = answer


def numbers_from(first: int) -> Iterator[int]:
    """Count the questions up without an end; after the last number comes 1."""
    return ((number - 1) % LAST_NUMBER + 1 for number in count(first))


def checksum(text: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE: 0x1021, start 0xFFFF, nothing reflected or inverted."""
    return crc_hqx(text, 0xFFFF)


class LineGrammar:
    """A protocol: its verbs, with the dataclasses of question and answer, and its longest line.

    `check` raises `WireError` for a message that is well written but cannot be, such as one with
    more joints than the robot has.
    """

    def __init__(
        self,
        verbs: Mapping[str, tuple[type, type]],
        line_bytes: int,
        check: Callable[[object], None] = lambda _body: None,
    ) -> None:
        self._verbs = verbs
        self._line_bytes = line_bytes
        self._check = check

    def line_framer(self) -> LineFramer:
        """Cut a stream into lines."""
        return LineFramer(self._line_bytes - len(EMPTY_LINE))

    def answers(self) -> Callable[[bytes], list[Answer]]:
        """Read answers from bytes in any pieces; empty lines are passed over.

        Raises only `WireError`.
        """
        return messages(self.line_framer().feed, self.decode_answer)

    def encode_question(self, question: Question) -> bytes:
        """Write a question as a line; raises `WireError` for a number that is not finite."""
        head = f"{QUESTION_MARK}{question.number}"
        return self._pack([head, question.verb, *written(question.body)])

    def encode_answer(self, answer: Answer) -> bytes:
        """Write an answer as a line; a refusal's text is cleaned and cut to what a line holds."""
        head = [f"{ANSWER_MARK}{answer.number}", answer.verb]
        if isinstance(answer.body, Refused):
            text = _NOT_PRINTABLE.sub("?", answer.body.text)[:_REFUSAL_CHARACTERS]
            return self._pack([*head, "NO", answer.body.code, *text.split()])
        return self._pack([*head, "OK", *written(answer.body)])

    def decode_question(self, line: bytes) -> Question:
        """Read a line without its line feed; raises `BadQuestion`."""
        try:
            number, words = self._unpack(line, QUESTION_MARK)
        except WireError as error:
            raise BadQuestion(error.problem, _answer_to_damaged(line, error.problem)) from error
        verb = words[0] if words else ""
        if verb not in self._verbs:
            problem = f"verb '{verb}' is not known"
            raise BadQuestion(problem, Answer(number, UNREAD_VERB, Refused("VERB", problem)))
        try:
            return Question(number, verb, self._read(self._verbs[verb][0], words[1:]))
        except WireError as error:
            refused = Refused("ARGUMENT", error.problem)
            raise BadQuestion(error.problem, Answer(number, verb, refused)) from error

    def decode_answer(self, line: bytes) -> Answer:
        """Read a line without its line feed; raises `WireError`."""
        number, words = self._unpack(line, ANSWER_MARK)
        text = line.decode("ascii")
        match words:
            case [verb, "OK", *rest] if verb in self._verbs:
                return Answer(number, verb, self._read(self._verbs[verb][1], rest), text)
            case [verb, "NO", code, *rest] if _CODE.fullmatch(code):
                if verb in self._verbs or verb == UNREAD_VERB:
                    return Answer(number, verb, Refused(code, " ".join(rest)), text)
        raise WireError(f"neither 'VERB OK …' nor 'VERB NO CODE …': {line!r:.80}")

    def _read(self, kind: type[Body], words: Sequence[str]) -> Body:
        body = read(kind, words)
        self._check(body)
        return body

    def _pack(self, words: Sequence[str]) -> bytes:
        text = " ".join(words).encode("ascii")
        line = b"%s *%04X\n" % (text, checksum(text))
        if len(line) > self._line_bytes:
            raise WireError(
                f"a line of {len(line)} bytes cannot be sent, the limit is {self._line_bytes}"
            )
        return line

    def _unpack(self, line: bytes, mark: str) -> tuple[int, list[str]]:
        """Check a line and return its number and the words behind it."""
        if len(line) >= self._line_bytes:
            raise WireError(f"a line of more than {self._line_bytes} bytes: {line!r:.80}")
        checked = _CHECKED_LINE.fullmatch(line)
        if checked is None:
            raise WireError(f"not words and a checksum: {line!r:.80}")
        if checksum(checked[1]) != int(checked[2], 16):
            raise WireError(f"the checksum does not fit: {line!r:.80}")
        head, *words = checked[1].decode("ascii").split(" ")
        numbered = _NUMBERED.fullmatch(head)
        if numbered is None or numbered[1] != mark:
            raise WireError(f"does not begin with '{mark}' and a number: {line!r:.80}")
        return int(numbered[2]), words


def _answer_to_damaged(line: bytes, problem: str) -> Answer | None:
    damaged = _DAMAGED_QUESTION.match(line)
    return damaged and Answer(int(damaged[1]), UNREAD_VERB, Refused("CHECKSUM", problem))


# Any in what follows: the fields of a message are known by their annotations only


def written(body: object) -> list[str]:
    """Write a message as words; raises `WireError` for a number that is not finite."""
    words: list[str] = []
    for slot in fields(cast("Any", body)):
        value = getattr(body, slot.name)
        if get_origin(slot.type) is tuple:
            words += map(_decimal_word, value)
        elif slot.type is Title:
            words += value.split()
        else:
            write, _ = _FORMS[slot.type]
            words.append(write(value))
    return words


def read(kind: type[Body], words: Sequence[str]) -> Body:
    """Read a message of its words; raises `WireError`."""
    values: list[Any] = []
    rest = list(words)
    slots = fields(cast("Any", kind))
    for behind, slot in zip(reversed(range(len(slots))), slots, strict=True):
        values.append(_take(slot.type, rest, behind, slot.name))
    if rest:
        raise WireError(f"'{rest[0]}' is one word too many")
    return kind(*values)


def _take(form: Any, rest: list[str], behind: int, meaning: str) -> object:
    """Take a field's words off those that are left; `behind` fields follow it, a word each."""
    if get_origin(form) is tuple:
        sizes = get_args(form)
        size = max(len(rest) - behind, 0) if Ellipsis in sizes else len(sizes)
        return tuple(_read_decimal(_next(rest, meaning), meaning) for _ in range(size))
    word = _next(rest, meaning)
    if form is Title:
        return f"{word} {rest.pop(0)}" if rest and _WHOLE.fullmatch(rest[0]) else word
    _, read_word = _FORMS[form]
    return read_word(word, meaning)


def _next(rest: list[str], meaning: str) -> str:
    if not rest:
        raise WireError(f"the line ends where {meaning} was expected")
    return rest.pop(0)


def _decimal_word(value: float) -> str:
    """Write a number with a decimal point and enough digits to read the same double again."""
    if not math.isfinite(value):
        raise WireError(
            f"{value} cannot be sent: it is not a finite number",
            remedy="look where the value comes from: the plan or the robot file",
        )
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def _read_decimal(word: str, meaning: str) -> float:
    value = float(word) if _DECIMAL.fullmatch(word) else math.nan
    if not math.isfinite(value):
        raise WireError(f"{meaning} is '{word}', not a number like -12.5")
    return value


def _read_whole(word: str, meaning: str) -> int:
    if not _WHOLE.fullmatch(word):
        raise WireError(f"{meaning} is '{word}', not a whole number")
    return int(word)


def _read_flag(word: str, meaning: str) -> bool:
    if word not in {"0", "1"}:
        raise WireError(f"{meaning} is '{word}', neither 0 nor 1")
    return word == "1"


def _name_word(text: str) -> str:
    """Write a text as one word: percent-encoded UTF-8, `-` when it is empty."""
    return "%2D" if text == NO_NAME else quote(text, safe=_UNQUOTED) or NO_NAME


def _read_name(word: str, meaning: str) -> str:
    if word == NO_NAME:
        return ""
    if not _NAME.fullmatch(word):
        raise WireError(f"{meaning} '{word}' is not percent-encoded text")
    try:
        text = unquote(word, errors="strict")
    except UnicodeDecodeError as error:
        raise WireError(f"{meaning} '{word}' is not UTF-8") from error
    if not text.isprintable():
        raise WireError(f"{meaning} '{word}' holds characters that cannot be printed")
    return text


_FORMS: Mapping[Any, tuple[Callable[[Any], str], Callable[[str, str], object]]] = {
    int: (str, _read_whole),
    float: (_decimal_word, _read_decimal),
    bool: (lambda value: "1" if value else "0", _read_flag),
    str: (_name_word, _read_name),
}
"""How a field of one word is written and read, by its annotation."""
