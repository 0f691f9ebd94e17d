"""Grammar of numbers that a person types or pastes: any separators, decimal points or commas.

A tracker's software shows points in the language of its computer: `2510,5; -35,2; 75` or `X =
2510.5 mm`. A comma may thus be a decimal comma or a separator. A line is read only if there is one
way to read it; where there are two, the person is asked again.
"""

import math
import re

from drivers.errors import WireError

_LABELS = re.compile(r"\b[A-Za-z][A-Za-z_]*\d*\s*[=:]|\b[xyzXYZ]\b|\bmm\b|\bdeg\b|°")
"""Words that stand between numbers: `X=`, `q0:`, `x`, a unit."""
# A comma separates only with a blank behind it; between digits it is a decimal comma.
_BETWEEN = re.compile(r"\s*[;\t]\s*|,\s+|\s+")
_NUMBER = re.compile(r"[+-]?\d+([.,]\d*)?([eE][+-]?\d{1,3})?|[+-]?[.,]\d+")
_SHOWN_CHARACTERS = 60
AGAIN = "type them with decimal points and blanks between: 2510.012 -35.487 -75.002"


def typed_numbers(text: str, count: int) -> tuple[float, ...]:
    """Read so many finite numbers; raises `WireError` where there are two ways to read.

    Blanks, tabs, semicolons or commas stand between them, and perhaps axes' names and a unit.
    """
    # U+2212 is the minus sign that documents and spreadsheets use in place of the hyphen.
    plain = _LABELS.sub(" ", text.replace("\u2212", "-")).strip().rstrip(";,")
    words = [word for word in _BETWEEN.split(plain) if word]
    # `1.5,2.5,3.5`: without any blank, commas are separators if their count fits.
    if len(words) == 1 and plain.count(",") == count - 1 > 0:
        words = plain.split(",")
    shown = text.strip()[:_SHOWN_CHARACTERS]
    for word in words:
        if not _NUMBER.fullmatch(word):
            raise WireError(f"'{word[:_SHOWN_CHARACTERS]}' in '{shown}' is no number", remedy=AGAIN)
    if len(words) != count:
        raise WireError(f"'{shown}' has {len(words)} numbers, {count} are needed", remedy=AGAIN)
    if any("," in word for word in words) and any("." in word for word in words):
        raise WireError(f"'{shown}' has decimal commas and decimal points", remedy=AGAIN)
    values = tuple(float(word.replace(",", ".")) for word in words)
    if not all(map(math.isfinite, values)):
        raise WireError(f"'{shown}' has a number that is too large", remedy=AGAIN)
    return values
