"""G-code as lines of words (RS274/NGC as far as a program of moves needs it), and back to text.

A line that is no move is written as it was read, to the byte. Numbers only: expressions, variables
and O-words are refused, for nobody but the controller can follow them.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import TargetsInvalid
from campaigns.files.text_file import read_text
from campaigns.files.wording import shown
from drivers.bounded_files import MEGABYTE

MOST_LINES = 100_000
MOST_BYTES = 10 * MEGABYTE
_TOKEN = re.compile(
    r"[ \t]*(?:(?P<comment>\([^()\r\n]*\)|;.*)"
    r"|(?P<letter>[A-Za-z])[ \t]*(?P<number>[+-]?(?:\d+(?:\.\d*)?|\.\d+))"
    r"|(?P<percent>%))[ \t]*",
    re.ASCII,
)
_LINE = re.compile(r"(?P<body>[^\r\n]*)(?P<ending>\r\n|\n|\r|\Z)")
_MESSAGE = re.compile(r"[ \t]*(?:[Nn]\d+[ \t]*)?[Mm]11[78]\b", re.ASCII)
"""Printers' words for a message: the rest of the line is text."""
_FOLLOWED_BY_CONTROLLER = re.compile(r"[A-Za-z]?[ \t]*[+-]?[#\[<]|[Oo]")


@dataclass(frozen=True, slots=True)
class Word:
    """Letter with a number, as `X-12.5`."""

    letter: str
    """Upper case."""
    value: float
    text: str
    """As it was written, without blanks."""

    @property
    def code(self) -> str:
        """Code of a G or M word without needless zeros, every other digit kept: `G1`, `G91.1`."""
        whole, _, part = self.text[1:].lstrip("+").partition(".")
        fraction = part.rstrip("0")
        return f"{self.letter}{whole.lstrip('0') or '0'}" + (f".{fraction}" if fraction else "")


@dataclass(frozen=True, slots=True)
class Block:
    """Line of a program."""

    number: int
    """From 1."""
    body: str
    ending: str
    words: tuple[Word, ...] = ()
    comments: tuple[str, ...] = ()
    may_be_skipped: bool = False
    """Whether it begins with `/`."""

    @property
    def text(self) -> str:
        """Line as it was read."""
        return self.body + self.ending

    def codes(self, letter: str) -> tuple[str, ...]:
        """Codes of its G or M words."""
        return tuple(word.code for word in self.words if word.letter == letter)

    def values(self) -> dict[str, float]:
        """Values of the other words, by letter."""
        return {word.letter: word.value for word in self.words if word.letter not in "GM"}


def read_program(path: Path) -> str:
    """Text of a program; raises `TargetsInvalid` for one that is too long, before parsing it."""
    missing = "name a robot program"
    text = read_text(path, TargetsInvalid, if_missing=missing, most_bytes=MOST_BYTES)
    lines = text.count("\n") + text.count("\r") - text.count("\r\n")
    if lines > MOST_LINES:
        raise TargetsInvalid(
            f"{path}: has {lines} lines, at most {MOST_LINES} are corrected",
            remedy="split the program",
        )
    return text


def parse_gcode(text: str, name: str) -> Iterator[Block]:
    """Lines of a program, one after the other.

    Raises `TargetsInvalid` naming the line that cannot be read, or in the end if there was no word.
    """
    has_words = False
    for number, line in enumerate(_LINE.finditer(text), start=1):
        if line[0]:
            block = _block(line["body"], line["ending"], number, name)
            has_words = has_words or bool(block.words)
            yield block
    if not has_words:
        raise TargetsInvalid(f"{name}: holds no G-code", remedy="check that it is the right file")


def _block(body: str, ending: str, number: int, name: str) -> Block:
    if _MESSAGE.match(body):
        return Block(number, body, ending)
    bare = body.lstrip(" \t")
    skipped = bare.startswith("/")
    bare = bare.removeprefix("/")
    words: list[Word] = []
    comments: list[str] = []
    place = 0
    while place < len(bare):
        token = _TOKEN.match(bare, place)
        if token is None:
            raise _unreadable(bare, place, words, f"{name}:{number}")
        if token["comment"]:
            comments.append(token["comment"])
        elif token["letter"]:
            words.append(_word(token["letter"], token["number"], f"{name}:{number}"))
        place = token.end()
    _check_once(words, f"{name}:{number}")
    return Block(number, body, ending, tuple(words), tuple(comments), skipped)


def _word(letter: str, number: str, where: str) -> Word:
    value = float(number)
    if not math.isfinite(value):
        raise TargetsInvalid(f"{where}: {letter} is no number", remedy="correct the value")
    return Word(letter.upper(), value, letter + number)


def _check_once(words: list[Word], where: str) -> None:
    letters = [word.letter for word in words if word.letter not in "GM"]
    for letter in letters:
        if letters.count(letter) > 1:
            raise TargetsInvalid(f"{where}: {letter} stands twice in a line", remedy="keep one")


def _unreadable(bare: str, place: int, before: list[Word], where: str) -> TargetsInvalid:
    rest = shown(bare[place:].strip())
    of_o_word = any(word.letter == "O" for word in before)
    if of_o_word or _FOLLOWED_BY_CONTROLLER.match(bare[place:].lstrip()):
        return TargetsInvalid(
            f"{where}: '{rest}': variables, expressions and O-words are not followed",
            remedy="let the CAM write the program with numbers, without loops and subprograms",
        )
    return TargetsInvalid(
        f"{where}: '{rest}' is no word of G-code (a letter and a number)",
        remedy="correct the line, or make it a comment",
    )
