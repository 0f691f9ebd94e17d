"""The parameters of GeoCOM as words: numbers and quoted strings."""

import re
from collections.abc import Sequence

from drivers.errors import WireError

DECIMALS = 15
"""With which a client writes a number."""

_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_ESCAPE = re.compile(r"\\(?:[xX](?P<byte>[0-9a-fA-F]{2})|(?P<sign>.))")
_WHOLE = re.compile(r"-?[0-9]{1,18}")
_NUMBER = re.compile(r"[+-]?[0-9]{1,18}(\.[0-9]{0,30})?([eE][+-]?[0-9]{1,2})?")


def words_of(*values: float | str) -> tuple[str, ...]:
    """Write whole numbers, numbers with a point, and strings, as a driver sends them."""
    return tuple(_word(value) for value in values)


def _word(value: float | str) -> str:
    if isinstance(value, str):
        return string_word(value)
    if isinstance(value, int):
        return f"{value:d}"
    return number_word(value, DECIMALS)


def number_word(value: float, digits: int) -> str:
    """Write a number with a point and at most so many decimals, as an instrument does."""
    text = f"{value:.{max(digits, 1)}f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text


def string_word(text: str) -> str:
    """Write a string in quotes; what is not printable ASCII, as its byte in hexadecimal."""
    return '"' + "".join(map(_escaped, text.encode("latin-1", "replace"))) + '"'


def _escaped(byte: int) -> str:
    sign = chr(byte)
    if sign in '\\"%~':
        return f"\\{sign}"
    return sign if " " <= sign <= "~" else f"\\x{byte:02X}"


def parse_string(word: str) -> str:
    """Read a string in quotes; raises `WireError`."""
    if not _STRING.fullmatch(word):
        raise WireError(f"{word!r:.80} is not a string in quotes")
    return _ESCAPE.sub(_unescaped, word[1:-1])


def _unescaped(found: re.Match[str]) -> str:
    return found["sign"] if found["byte"] is None else chr(int(found["byte"], 16))


def parse_whole(word: str) -> int:
    """Read a whole number; raises `WireError`."""
    if not _WHOLE.fullmatch(word):
        raise WireError(f"{word!r:.80} is not a whole number")
    return int(word)


def parse_number(word: str) -> float:
    """Read a number, with or without a point; raises `WireError`."""
    if not _NUMBER.fullmatch(word):
        raise WireError(f"{word!r:.80} is not a number")
    return float(word)


def parse_words(parameters: Sequence[str], count: int) -> Sequence[str]:
    """Insist on so many parameters; raises `WireError`."""
    if len(parameters) != count:
        raise WireError(f"{len(parameters)} parameters where {count} are needed")
    return parameters
