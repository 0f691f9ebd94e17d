"""Texts of devices, files and operators, made fit to be shown: the one place that cleans them."""

import shlex
import unicodedata
from collections.abc import Iterable
from difflib import get_close_matches

INSTEAD = "?"
_GAPS = "\t\n\v\f\r\x1c\x1d\x1e\x85\u2028\u2029"
_JOINERS = "\u200c\u200d"
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
_AS_BLANKS = str.maketrans(dict.fromkeys(_GAPS, " "))


def printable(text: str) -> str:
    """Return a text on one line without control, bidirectional or other hidden characters.

    Line breaks and tabs become blanks, the others `?`: a serial number cannot clear a terminal,
    forge a line, or turn the reading direction of what stands behind it. What scripts join their
    letters by stays.
    """
    if text.isprintable():
        return text
    return "".join(INSTEAD if _is_hidden(sign) else sign for sign in text.translate(_AS_BLANKS))


def quoted(word: str) -> str:
    r"""Quote a word for the shell; one with bytes that are no UTF-8 as bash takes it, `$'\xfc'`."""
    if word.isprintable():
        return shlex.quote(word)
    escaped = (f"\\x{byte:02x}" for byte in word.encode("utf-8", "surrogateescape"))
    return f"$'{''.join(escaped)}'"


def shortened(text: str, most: int) -> str:
    """Return a text of at most so many characters: the beginning and end of a longer one."""
    if len(text) <= most:
        return text
    half = (most - 1) // 2
    return f"{text[:half]}…{text[-half:]}"


def nearest_word(word: str, known: Iterable[str], *, likeness: float = 0.6) -> str | None:
    """Find the known word that looks most like it, whatever the case; None when none does."""
    by_lower = {name.lower(): name for name in known}
    matches = get_close_matches(word.lower(), by_lower, n=1, cutoff=likeness)
    return by_lower[matches[0]] if matches else None


def _is_hidden(sign: str) -> bool:
    return unicodedata.category(sign) in _HIDDEN and sign not in _JOINERS
