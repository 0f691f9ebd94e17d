"""Times in tables, as ISO 8601: also those that other software and spreadsheets write.

`25.10.2026 02:59` has the day first, `10/25/2026 1:59 PM` the month. Of other dates one that can be
read in one way alone decides for all of a file, or else the order of rows, in which time goes on.
Where two readings remain, no such time is read.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime

from campaigns.files.cells import NUMBER

_FOREIGN = re.compile(
    r"(\d{1,4})([./-])(\d{1,2})\2(\d{4}|\d{2})[ T,]+(\d{1,2}):(\d{2})"
    r"(?::(\d{2})(?:[.,](\d{1,6})\d*)?)?(?:\s*([ap])\.?m\.?)?",
    re.ASCII | re.IGNORECASE,
)
"""Three numbers of a date in any order, and hours, minutes, seconds and a half of the day."""
CENTURY = 2000
"""Year that those of two digits are counted from."""
DAY_FIRST, MONTH_FIRST, YEAR_FIRST = _ORDERS = ((2, 1, 0), (2, 0, 1), (0, 1, 2))
"""Places of year, month and day in a date."""


def iso_times(texts: Sequence[str]) -> list[str | None]:
    """Return times (N,) as ISO 8601 or numbers; None for those that cannot be read."""
    plain = [_plain_time(text) for text in texts]
    foreign = {
        row: match
        for row, text in enumerate(texts)
        if plain[row] is None and (match := _FOREIGN.fullmatch(text))
    }
    orders = [_in_order([*foreign.values()], order) for order in _ORDERS]
    readings = [moments for moments in orders if moments]
    if len(readings) > 1:
        readings = [moments for moments in readings if moments == sorted(moments)]
    if len(readings) == 1:
        for row, moment in zip(foreign, readings[0], strict=True):
            plain[row] = moment.isoformat()
    return plain


def is_time(text: str) -> bool:
    """Return whether a text is a number or a time of ISO 8601."""
    return _plain_time(text) is not None


def _plain_time(text: str) -> str | None:
    if NUMBER.fullmatch(text):
        return text
    with suppress(ValueError):
        return datetime.fromisoformat(text).isoformat()
    return None


def _in_order(matches: Sequence[re.Match[str]], order: Sequence[int]) -> list[datetime]:
    """Return the times whose dates are all in an order; [] if any is not."""
    try:
        return [_moment(match, order) for match in matches]
    except ValueError:
        return []


def _moment(match: re.Match[str], order: Sequence[int]) -> datetime:
    """Return the time of a match with its date in an order; raise `ValueError` for others."""
    numbers, half = (match[1], match[3], match[4]), (match[9] or "").lower()
    # who writes AM has the month first, who writes points the day
    is_other = (half and order != MONTH_FIRST) or (match[2] == "." and order != DAY_FIRST)
    if is_other or (order == YEAR_FIRST and len(match[1]) < len("2026")):
        raise ValueError("another order")
    year, month, day = (int(numbers[place]) for place in order)
    hour = int(match[5])
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    return datetime(  # noqa: DTZ001 - the file states no zone
        year if year >= CENTURY else CENTURY + year,
        month,
        day,
        hour,
        int(match[6]),
        int(match[7] or 0),
        int((match[8] or "").ljust(6, "0")),
    )
