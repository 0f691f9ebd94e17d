"""The words of robotline: numbers, whole numbers, flags and names. See docs/robotline.md."""

import math
import re
from collections.abc import Sequence
from urllib.parse import quote, unquote

from drivers.errors import WireError

NO_NAME = "-"
_NUMBER = re.compile(r"-?[0-9]+\.[0-9]+([eE][+-]?[0-9]{1,3})?")
_WHOLE = re.compile(r"0|[1-9][0-9]{0,8}")
_NAME = re.compile(r"([!-$&-~]|%[0-9A-F]{2})+")
_UNQUOTED = "".join(chr(code) for code in range(0x21, 0x7F) if chr(code) != "%")


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


def flag_word(flag: bool) -> str:  # noqa: FBT001 - a flag is what it writes
    """Write 1 or 0."""
    return "1" if flag else "0"


class Words:
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

    def numbers(self, count: int, meaning: str) -> tuple[float, ...]:
        """Take so many numbers."""
        return tuple(self.number(f"{meaning} {index}") for index in range(count))

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


def _unquoted(word: str, meaning: str) -> str:
    if not _NAME.fullmatch(word):
        raise WireError(f"{meaning} '{word}' is not percent-encoded text")
    try:
        return unquote(word, errors="strict")
    except UnicodeDecodeError as error:
        raise WireError(f"{meaning} '{word}' is not UTF-8") from error
