"""Texts of devices, files and operators, made fit to be shown: the one place that cleans them.

A serial number or a file's cell comes from outside and is printed, logged and written into reports.
It may hold what a terminal obeys (escape sequences), what forges a second line, or what turns the
reading direction of the words behind it. Such characters are replaced, and all letters of all
scripts stay.
"""

import re
import shlex
import sys
import unicodedata
from collections.abc import Iterable
from datetime import datetime
from difflib import get_close_matches

INSTEAD = "?"
# `str.splitlines` breaks lines at these, and so may a terminal.
_GAPS = "\t\n\v\f\r\x1c\x1d\x1e\x85\u2028\u2029"
# Zero-width non-joiner and joiner: Persian and Indic scripts need them inside words.
_JOINERS = "\u200c\u200d"
# Unicode's categories of control, format, surrogate, line and paragraph separator.
_HIDDEN = frozenset({"Cc", "Cf", "Cs", "Zl", "Zp"})
_PLAIN_ON_WINDOWS = re.compile(r"[\w.:/\\+-]+")
_AS_BLANKS = str.maketrans(dict.fromkeys(_GAPS, " "))


def printable(text: str) -> str:
    """Return a text on one line without control, bidirectional or other hidden characters.

    Line breaks and tabs become blanks, the others `?`. Joiners of letters stay.
    """
    if text.isprintable():
        return text
    return "".join(INSTEAD if _is_hidden(sign) else sign for sign in text.translate(_AS_BLANKS))


def as_word(path: str) -> str:
    """Return a path as a word that no command takes for an option: `-a` gets its folder, `./-a`."""
    return f"./{path}" if path.startswith("-") else path


def quoted(path: str, *, for_windows: bool = sys.platform == "win32") -> str:
    r"""Quote a path for the shell; one with bytes that are no UTF-8 as bash takes it, `$'\xfc'`.

    A name that begins with a dash would be read as an option: it gets its folder, `./`. Both shells
    of Windows take double quotes.
    """
    word = as_word(path)
    if for_windows:
        end = "\\" if word.endswith("\\") else ""  # a last one would quote the quotation mark
        return word if _PLAIN_ON_WINDOWS.fullmatch(word) else f'"{word}{end}"'
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


def moment(utc: str) -> str:
    """Return a time of the journal as local time with its zone: `2026-03-02 09:15 CET`.

    A text that is no time is returned as it is.
    """
    try:
        return f"{datetime.fromisoformat(utc).astimezone():%Y-%m-%d %H:%M %Z}"
    except ValueError:
        return utc


def nearest_word(word: str, choices: Iterable[str], *, likeness: float = 0.6) -> str | None:
    """Return the choice that is spelled most like a word, whatever its case, or None."""
    by_lower = {choice.lower(): choice for choice in choices}
    matches = get_close_matches(word.lower(), by_lower, n=1, cutoff=likeness)
    return by_lower[matches[0]] if matches else None


def _is_hidden(sign: str) -> bool:
    return unicodedata.category(sign) in _HIDDEN and sign not in _JOINERS
