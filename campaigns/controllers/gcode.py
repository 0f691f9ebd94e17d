"""G-code as lines of words (RS274/NGC as far as a program of moves needs it), and back to text.

A line that is no move is written as it was read, to the byte. Numbers only: expressions, variables
and O-words are refused, for nobody but the controller can follow them.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from campaigns.errors import TargetsInvalid
from campaigns.files.wording import shown

MOST_LINES = 1_000_000
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
        """Code of a G or M word without leading zeros: `G1`, `G91.1`."""
        return f"{self.letter}{self.value:g}"


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


def parse_gcode(text: str, name: str) -> tuple[Block, ...]:
    """Lines of a program; raises `TargetsInvalid` naming the line that cannot be read."""
    blocks = tuple(_blocks(text, name))
    if not any(block.words for block in blocks):
        raise TargetsInvalid(f"{name}: holds no G-code", remedy="check that it is the right file")
    return blocks


def block_text(words: list[str], comments: tuple[str, ...] = ()) -> str:
    """Text of a new line, without its end."""
    return " ".join([*words, *comments])


def _blocks(text: str, name: str) -> Iterator[Block]:
    for number, line in enumerate(_LINE.finditer(text), start=1):
        body, ending = line["body"], line["ending"]
        if not body and not ending:
            return
        if number > MOST_LINES:
            raise TargetsInvalid(
                f"{name}: has more than {MOST_LINES} lines, the most that are read",
                remedy="split the program",
            )
        yield _block(body, ending, number, name)


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
