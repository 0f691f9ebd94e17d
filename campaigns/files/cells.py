"""Cells of tables that anybody wrote: separators, quotes, and numbers in any notation.

Programs and spreadsheets of all countries separate columns by commas, semicolons, tabs or blanks,
and write 2.5 as `2,5`, `−2.5`, `2.5D+00` or `2.5°`. What is recognised here is the same for points,
joints, shots, plans and targets. Which of two notations counts, where a text fits both, is for the
caller to say: `1.234` may be 1234.
"""

import csv
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from drivers.bounded_files import Encoding

DecimalSign = Literal["point", "comma"]
SEPARATORS: Mapping[str, str] = {";": "semicolons", "\t": "tabs", ",": "commas", "": "blanks"}
"""Separators of columns in words, from the least ambiguous on: blanks stand in names as well."""
NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""Number as files hold it; matched in a time that grows with the text's length, not its square."""
WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?", re.ASCII)
GROUPED = re.compile(
    r"[+-]?[1-9]\d{0,2}(?P<mark>[.,'’ \u00a0\u2009\u202f])\d{3}(?:(?P=mark)\d{3})*"
    r"(?P<rest>[.,]\d*)?",
    re.ASCII,
)
"""Number with thousands separators: an apostrophe or a blank of any width, too."""
COMMENT = re.compile(r"\s*(?:#|//|%|!)")
"""Beginning of a line that is a comment."""
_FOREIGN = re.compile(r"([+-]?[\d.,]+)(?:[dD]([+-]\d+))?\s*°?", re.ASCII)
"""Number with the exponent's sign of Fortran, or with a sign of degrees."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Notation:
    """What a user states of how a table is written; None in a field: the table shows it."""

    decimal: DecimalSign | None = None
    """Decimal sign; the other one groups thousands then."""
    encoding: Encoding | None = None


def split_line(line: str, separator: str) -> tuple[str, ...]:
    """Cut a line at a separator, or at blanks, as CSV with quotes."""
    text = line if separator else " ".join(line.split())
    # A line that CSV refuses, as one with a cell beyond its limit of size, is one cell.
    with suppress(csv.Error):
        cells = next(csv.reader([text], delimiter=separator or " ", skipinitialspace=True))
        return tuple(cell.strip() for cell in cells)
    return (line,)


def possible_splits(line: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each separator that a line may have, with the line cut there."""
    for separator in SEPARATORS:
        if separator in line:
            yield separator, split_line(line, separator)


def plain(text: str) -> str:
    """Return a number with ASCII's minus and `e`, and without `°`; any other text as it is."""
    bare = text.replace("\N{MINUS SIGN}", "-")
    if match := _FOREIGN.fullmatch(bare):
        return f"{match[1]}e{match[2]}" if match[2] else match[1]
    return bare if NUMBER.fullmatch(bare) else text


def is_number(text: str) -> bool:
    """Return whether a text is a number in any notation."""
    text = plain(text)
    return any(form.fullmatch(text) for form in (NUMBER, WITH_COMMA, GROUPED))


def point_text(text: str, decimal: DecimalSign | None) -> str | None:
    """Return a number of some decimal sign as one with a decimal point; None for any other text.

    Without a decimal sign numbers have a point, and no thousands separators.
    """
    # 1. Take out thousands separators, if their mark is not the decimal sign, and what follows is.
    text, sign = plain(text), "," if decimal == "comma" else "."
    if decimal and (grouped := GROUPED.fullmatch(text)):
        mark, decimals = grouped["mark"], grouped["rest"] or sign
        if mark != sign and decimals[0] == sign:
            text = text.replace(mark, "")
    # 2. Turn decimal commas into points. A point that is left then is neither: `?` is in no number.
    if decimal == "comma":
        text = text.replace(".", "?").replace(",", ".")
    return text if NUMBER.fullmatch(text) else None


def number_value(text: str, decimal: DecimalSign | None) -> float | None:
    """Return a number in the notation of a decimal sign; None for any other text."""
    number = point_text(text, decimal)
    return None if number is None else float(number)


def decimal_sign(texts: Iterable[str]) -> DecimalSign | None:
    """Return the decimal sign of a table's numbers, which is one for all; None if unclear.

    Numbers that can be read in one way alone decide: 1.5, 0.125, 1,5, 1.234,5. Thousands may be
    grouped by the other sign if such a number is: beside 2.5, 1,234 may be two things.
    """
    numbers = [text for cell in texts if (text := plain(cell)) and ("," in text or "." in text)]
    signs = {text: _sure_sign(text) for text in numbers if is_number(text)}
    sure = {sign for sign in signs.values() if sign is not None}
    if len(sure) != 1:
        return None
    sign = sure.pop()
    mark = "," if sign == "point" else "."
    of_mark = {signs[text] for text in signs if mark in text}
    return None if of_mark == {None} else sign


def _sure_sign(text: str) -> DecimalSign | None:
    """Return the decimal sign of a number that can be read in one way alone."""
    grouped = GROUPED.fullmatch(text)
    if grouped is None:
        return "comma" if "," in text else "point"
    mark, end = grouped["mark"], grouped["rest"] or ""
    if end and end[0] != mark:  # 1.234,5
        return "comma" if end[0] == "," else "point"
    if mark in ".," and text.count(mark) > 1:  # 1.234.567
        return "point" if mark == "," else "comma"
    return None
