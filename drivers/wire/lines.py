"""Numbered, checked lines: the grammar that robotline and pointline share.

Its specification is docs/reference/robotline.md. The lines are

    >NUMBER VERB words… *CCCC             a question
    <NUMBER VERB OK words… *CCCC          its answer
    <NUMBER VERB NO CODE text… *CCCC      or its refusal

The number ties an answer to its question, and the checksum CCCC finds bytes damaged on a serial
line. A protocol is a table of verbs, each with two dataclasses: of its question and of its answer.
The words are the fields of such a dataclass, in their order, and the annotation of a field says how
it is written: `int` as a whole number, `float` with a decimal point, `bool` as 0 or 1, `str` as a
percent-encoded name, `Title` as it stands. A tuple of three floats is three numbers;
`tuple[float, ...]` takes all numbers that the fields behind it leave.

Reading is strict: one way to write each value, and `WireError` for anything else.
"""

import math
import re
from binascii import crc_hqx
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from itertools import count
from typing import Any, NamedTuple, NewType, TypeVar, cast, get_args, get_origin
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
# With the longest number, verb and code the line still has less than robotline's 255 bytes.
_REFUSAL_CHARACTERS = 200
# Words of printable ASCII with exactly one space between, then the checksum: CR, tabs and double
# spaces do not fit.
_CHECKED_LINE = re.compile(rb"([!-~]+(?: [!-~]+)*) \*([0-9A-F]{4})")
_NUMBERED = re.compile(r"([<>])([1-9][0-9]{0,8})")
# The number of a damaged line may be damaged too, and is answered nevertheless: the client then
# sees an answer to another number, and waits until its deadline.
_DAMAGED_QUESTION = re.compile(rb">([1-9][0-9]{0,8}) ")
_CODE = re.compile(r"[A-Z]+")
_NOT_PRINTABLE = re.compile(r"[^ -~]")
# Stricter than `float()`, which takes `nan`, `1_000`, `1.` and digits of other scripts.
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
    """Answer to the question of this number and verb; `line` is the answer as it came."""

    number: int
    verb: str
    body: object
    line: str = field(default="", compare=False)


class BadQuestion(WireError):
    """A line that no device can act on. `answer` is what it must answer; None: nothing."""

    def __init__(self, problem: str, answer: Answer | None) -> None:
        super().__init__(problem)
        self.answer = answer


def numbers_from(first: int) -> Iterator[int]:
    """Count the questions up without an end; after the last number comes 1."""
    # A number of ten digits would be refused by the other side.
    return ((number - 1) % LAST_NUMBER + 1 for number in count(first))


def checksum(text: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE: 0x1021, start 0xFFFF, nothing reflected or inverted."""
    # `crc_hqx` has the polynomial; CCITT-FALSE is its variant that starts with 0xFFFF.
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
        """Return a framer that cuts a stream into lines of this protocol."""
        # The limit counts the line feed, the framer does not.
        return LineFramer(self._line_bytes - len(EMPTY_LINE))

    def answer_reader(self) -> Callable[[bytes], list[Answer]]:
        """Return a function that reads answers from bytes in any pieces; raises only `WireError`.

        Empty lines are passed over.
        """
        return messages(self.line_framer().feed, self.decode_answer)

    def encode_question(self, question: Question) -> bytes:
        """Write a question as a line; raises `WireError` for a number that is not finite."""
        head = f"{QUESTION_MARK}{question.number}"
        return self._pack([head, question.verb, *words_of(question.body)])

    def encode_answer(self, answer: Answer) -> bytes:
        """Write an answer as a line; a refusal's text is cleaned and cut to what a line holds."""
        head = [f"{ANSWER_MARK}{answer.number}", answer.verb]
        if isinstance(answer.body, Refused):
            text = _NOT_PRINTABLE.sub("?", answer.body.text)[:_REFUSAL_CHARACTERS]
            return self._pack([*head, "NO", answer.body.code, *text.split()])
        return self._pack([*head, "OK", *words_of(answer.body)])

    def decode_question(self, line: bytes) -> Question:
        """Read a line without its line feed; raises `BadQuestion`."""
        # In the order of the specification: the line (CHECKSUM), the verb, the arguments.
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
            case [verb, "OK", *fields_words] if verb in self._verbs:
                return Answer(number, verb, self._read(self._verbs[verb][1], fields_words), text)
            # Any code is read: which ones mean what is the dialect's.
            case [verb, "NO", code, *reason] if _CODE.fullmatch(code):
                if verb in self._verbs or verb == UNREAD_VERB:
                    return Answer(number, verb, Refused(code, " ".join(reason)), text)
        raise WireError(f"neither 'VERB OK …' nor 'VERB NO CODE …': {line!r:.80}")

    def _read(self, kind: type[Body], words: Sequence[str]) -> Body:
        body = body_of(kind, words)
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
        # `>=`: without its line feed a line must be shorter than the limit.
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
    """Return the refusal of a damaged question, None if not even its number can be read."""
    damaged = _DAMAGED_QUESTION.match(line)
    return damaged and Answer(int(damaged[1]), UNREAD_VERB, Refused("CHECKSUM", problem))


# `Any` below: the fields of a message are known by their annotations only.


def words_of(body: object) -> list[str]:
    """Write a message as words; raises `WireError` for a number that is not finite."""
    # A tuple and a title are several words, and every other field is one.
    words: list[str] = []
    for slot in fields(cast("Any", body)):
        value = getattr(body, slot.name)
        if get_origin(slot.type) is tuple:
            words += map(_decimal_word, value)
        elif slot.type is Title:
            words += value.split()
        else:
            words.append(_FORMS[slot.type].write(value))
    return words


def body_of(kind: type[Body], words: Sequence[str]) -> Body:
    """Read a message of its words; raises `WireError`."""
    values: list[Any] = []
    unread = list(words)
    slots = fields(cast("Any", kind))
    # Each field takes its words off the front of `unread`. `behind` counts the fields after it: a
    # tuple of any length leaves one word for each of them.
    for behind, slot in zip(reversed(range(len(slots))), slots, strict=True):
        values.append(_take_field(slot.type, unread, behind, slot.name))
    if unread:
        raise WireError(f"'{unread[0]}' is one word too many")
    return kind(*values)


def _take_field(form: Any, unread: list[str], behind: int, meaning: str) -> object:
    """Take a field's words off the unread ones; `behind` fields follow it, a word each."""
    if get_origin(form) is tuple:
        sizes = get_args(form)
        size = max(len(unread) - behind, 0) if Ellipsis in sizes else len(sizes)
        return tuple(_read_decimal(_take_word(unread, meaning), meaning) for _ in range(size))
    word = _take_word(unread, meaning)
    # `ARM 2` is one title. Behind a title come decimal numbers, which are not whole ones.
    if form is Title:
        return f"{word} {unread.pop(0)}" if unread and _WHOLE.fullmatch(unread[0]) else word
    return _FORMS[form].read(word, meaning)


def _take_word(unread: list[str], meaning: str) -> str:
    if not unread:
        raise WireError(f"the line ends where {meaning} was expected")
    return unread.pop(0)


def _decimal_word(value: float) -> str:
    """Write a number with a decimal point and enough digits to read the same double again."""
    if not math.isfinite(value):
        raise WireError(
            f"{value} cannot be sent: it is not a finite number",
            remedy="look where the value comes from: the plan or the robot file",
        )
    # `repr` is the shortest text of this double, but writes 1e-07 without a point.
    text = repr(float(value))
    return text if "." in text else text.replace("e", ".0e")


def _read_decimal(word: str, meaning: str) -> float:
    # `1.0e999` fits the form and is infinite.
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
    # A text that is `-` itself would read as empty, and is written `%2D`.
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


class _WordForm(NamedTuple):
    """Form of a field of one word."""

    write: Callable[[Any], str]
    read: Callable[[str, str], object]
    """Reads a word; takes the field's meaning for its errors."""


_FORMS: Mapping[Any, _WordForm] = {
    int: _WordForm(str, _read_whole),
    float: _WordForm(_decimal_word, _read_decimal),
    bool: _WordForm(lambda value: "1" if value else "0", _read_flag),
    str: _WordForm(_name_word, _read_name),
}
"""Forms by a field's annotation."""
