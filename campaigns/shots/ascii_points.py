"""Points as tracker software exports them: one a line, name and X Y Z, in a unit nobody wrote down.

SpatialAnalyzer writes up to three name parts (collection, group, target), then X Y Z, then what was
ticked in its dialog, by blanks or commas, with comments behind `//`. OpenIndy writes a name, X Y Z,
then group and comment, by blanks or semicolons, with comments behind `#` or `;`.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from itertools import groupby
from pathlib import Path
from typing import Literal, get_args

from campaigns.arrays import AXES
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import NUMBER, WITH_COMMA, check_lines
from campaigns.files.text_file import read_text
from campaigns.files.wording import shown, suggestion
from drivers.bounded_files import CSV_BYTES
from drivers.values import Vector3

LengthUnit = Literal["mm", "m", "inch", "ft", "cm", "um"]
MM_PER_UNIT: Mapping[LengthUnit, float] = {
    "mm": 1.0,
    "m": 1000.0,
    "inch": 25.4,
    "ft": 304.8,
    "cm": 10.0,
    "um": 1e-3,
}
UNIT_WORDS = get_args(LengthUnit)

COLUMN_WORDS = ("name", "x", "y", "z", "-")
"""A line's columns, when they are told: a name may have several parts, `-` is passed over."""
NAME_JOINT = "::"
"""Separator of the parts of a name, as SpatialAnalyzer has it."""
MOST_NAME_PARTS = 3
COMMENTS = ("//", "#", ";")
SEPARATORS: Mapping[str, str] = {";": "semicolons", "\t": "tabs", ",": "commas", "": "blanks"}
FARTHEST_MM = 1e8
"""Whatever is farther is in no unit that could be told by its distances."""

_HEADER = re.compile(r"([a-z]+)(?:[_ ]?[\[(]?([a-z]+)[\])]?)?")
"""Word of a header: `x`, `x_mm`, `"x [mm]"`."""
_WHOLE = re.compile(r"\d+", re.ASCII)
_COLUMNS_REMEDY = "say what they are, for example --columns name,x,y,z"


@dataclass(frozen=True, slots=True)
class NamedPoint:
    """Point with its name, empty when it has none, and where it stands in its file."""

    where: str
    name: str
    point_mm: Vector3


Lines = Mapping[str, tuple[str, ...]]
"""Words of each line by its file and number."""


def read_points(
    path: Path, *, unit: LengthUnit | None, columns: Sequence[str] | None = None
) -> tuple[tuple[NamedPoint, ...], str]:
    """The points of a file in its order, and how it was understood, for the user to see.

    Raises `ShotsInvalid`, also when nobody says the unit.
    """
    text = read_text(path, ShotsInvalid, if_missing="check the file's name", most_bytes=CSV_BYTES)
    return parse_points(text, str(path), unit=unit, columns=columns)


def parse_points(
    text: str, name: str, *, unit: LengthUnit | None, columns: Sequence[str] | None = None
) -> tuple[tuple[NamedPoint, ...], str]:
    """Read points from a file's text; without `columns`, these follow from the lines themselves."""
    if unit is None:
        raise ShotsInvalid(
            f"{name}: the file does not say its unit of length",
            remedy=f"give it with --unit {'|'.join(UNIT_WORDS)}",
        )
    check_lines(text, name, ShotsInvalid)
    separator, lines = _split_lines(text, name)
    order = _told_order(columns, name) if columns is not None else _found_order(lines)
    points = tuple(_point(where, words, order, unit) for where, words in lines.items())
    _check_unique(points)
    words = ", ".join("skipped" if word == "-" else word for word in order)
    return points, f"{words} by {SEPARATORS[separator]}, in {unit}"


def data_rows(text: str) -> tuple[str, ...]:
    """Lines of a text that hold points: none that is empty, a comment or a header."""
    lines = (line.strip() for line in StringIO(text, newline=None))
    return tuple(
        line
        for line in lines
        if line and not line.startswith(COMMENTS) and told_columns(line) is None
    )


def told_columns(line: str) -> tuple[tuple[str, ...], LengthUnit | None] | None:
    """Columns that a header tells, `name;x_mm;y_mm;z_mm`, and their unit; None: it is none."""
    found = [_HEADER.fullmatch(word.lower()) for word in _words(line, _separator(line))]
    places = {word[1]: word[2] for word in found if word and word[1] in AXES}
    if places.keys() != {*AXES}:
        return None
    columns = tuple(word[1] if word and word[1] in COLUMN_WORDS else "-" for word in found)
    units = [unit for unit in UNIT_WORDS if {*places.values()} == {unit}]
    return columns, units[0] if units else None


def point_of_row(
    row: str, text: str, name: str, *, unit: LengthUnit, columns: Sequence[str] | None
) -> Vector3:
    """Point, mm, of one row of a file's text; its header tells columns and unit where it has one.

    Raises `ShotsInvalid`.
    """
    lines = (line.strip() for line in StringIO(text, newline=None))
    header = next((told for line in lines if (told := told_columns(line))), None)
    if header is not None:
        columns, unit = columns or header[0], header[1] or unit
    (point,), _ = parse_points(row, name, unit=unit, columns=columns)
    return point.point_mm


def _split_lines(text: str, name: str) -> tuple[str, Lines]:
    """Leave out what holds no data, and cut the rest at the separator of the first line."""
    filled = {
        f"{name}:{number}": line.strip()
        for number, line in enumerate(StringIO(text, newline=None), start=1)
        if line.strip() and not line.lstrip().startswith(COMMENTS)
    }
    if not filled:
        raise ShotsInvalid(f"{name}: holds no points", remedy="check that it is the right file")
    where, first = next(iter(filled.items()))
    _check_decimal_comma(where, first)
    separator = _separator(first)
    return separator, {where: _words(line, separator) for where, line in filled.items()}


def _check_decimal_comma(where: str, line: str) -> None:
    """Refuse `2000,5 10,25 -300,125`, which commas would cut to pieces."""
    for words in (line.split(), line.split(";"), line.split("\t")):
        commas = [word for word in words if WITH_COMMA.fullmatch(word.strip())]
        if len(commas) >= len(AXES) - 1 and len(words) > len(AXES) - 1:
            raise ShotsInvalid(
                f"{where}: '{shown(commas[0].strip())}' is a decimal comma",
                remedy="export the points with decimal points",
            )


def _separator(line: str) -> str:
    return next((sign for sign in SEPARATORS if sign and sign in line), "")


def _words(line: str, separator: str) -> tuple[str, ...]:
    words = line.split(separator) if separator else line.split()
    return tuple(word.strip().strip('"').strip() for word in words)


def _told_order(columns: Sequence[str], name: str) -> tuple[str, ...]:
    for word in columns:
        if word not in COLUMN_WORDS:
            raise ShotsInvalid(
                f"{name}: unknown column '{shown(word)}'", remedy=suggestion(word, COLUMN_WORDS)
            )
    for axis in AXES:
        if columns.count(axis) != 1:
            raise ShotsInvalid(
                f"{name}: the columns {','.join(columns)} have {columns.count(axis)} {axis}",
                remedy="give each of x, y and z once",
            )
    return tuple(columns)


def _found_order(lines: Lines) -> tuple[str, ...]:
    """Find name and X Y Z: the first run of three numbers, the same in every line.

    Of four numbers the first is a name if it is a whole number in every line.
    """
    first, first_words = next(iter(lines.items()))
    start, numbers = _run(first, first_words)
    for where, words in lines.items():
        if _run(where, words) != (start, numbers):
            raise ShotsInvalid(
                f"{where}: '{shown(' '.join(words))}' has other columns than line "
                f"{first.rpartition(':')[2]}, '{shown(' '.join(first_words))}'",
                remedy="correct the line, export with commas if names hold blanks, "
                "or tell all columns, for example --columns name,x,y,z",
            )
    names_are_numbers = numbers == len(AXES) + 1 and all(
        _WHOLE.fullmatch(words[start]) for words in lines.values()
    )
    names = start + 1 if names_are_numbers else start
    if numbers > len(AXES) and not names_are_numbers:
        raise ShotsInvalid(
            f"{first}: {numbers} numbers in a row, X Y Z are three", remedy=_COLUMNS_REMEDY
        )
    if names > MOST_NAME_PARTS:
        raise ShotsInvalid(
            f"{first}: {names} words before X Y Z, a name has at most {MOST_NAME_PARTS}",
            remedy=_COLUMNS_REMEDY,
        )
    return (*["name"] * names, *AXES)


def _run(where: str, words: Sequence[str]) -> tuple[int, int]:
    """Start of the first run of at least three numbers, and how many there are."""
    start = 0
    for is_number, run in groupby(words, lambda word: NUMBER.fullmatch(word) is not None):
        length = len(list(run))
        if is_number and length >= len(AXES):
            return start, length
        start += length
    raise ShotsInvalid(
        f"{where}: no X Y Z: '{shown(' '.join(words))}' has no three numbers in a row",
        remedy="take the line out, or put // before it",
    )


def _point(where: str, words: Sequence[str], order: Sequence[str], unit: LengthUnit) -> NamedPoint:
    if len(words) < len(order):
        raise ShotsInvalid(
            f"{where}: {len(words)} words for {len(order)} columns {','.join(order)}",
            remedy="correct the line, or --columns",
        )
    parts = [word for word, column in zip(words, order, strict=False) if column == "name"]
    x, y, z = (_length_mm(f"{where}: {axis}", words[order.index(axis)], unit) for axis in AXES)
    return NamedPoint(where, NAME_JOINT.join(parts), (x, y, z))


def _length_mm(what: str, word: str, unit: LengthUnit) -> float:
    if not NUMBER.fullmatch(word):
        raise ShotsInvalid(
            f"{what} is '{shown(word)}', must be a number", remedy="correct the line, or --columns"
        )
    length_mm = float(word) * MM_PER_UNIT[unit]
    if abs(length_mm) > FARTHEST_MM:  # an infinite one, too
        raise ShotsInvalid(
            f"{what} is {shown(word)} {unit}, farther than {FARTHEST_MM:g} mm",
            remedy="check --unit, and that it is a point of this campaign",
        )
    return length_mm


def _check_unique(points: Sequence[NamedPoint]) -> None:
    seen: dict[str, str] = {}
    for point in points:
        if point.name and point.name in seen:
            raise ShotsInvalid(
                f"{point.where}: point '{shown(point.name)}' stands already in "
                f"line {seen[point.name].rpartition(':')[2]}",
                remedy="give each point a name of its own",
            )
        seen[point.name] = point.where
