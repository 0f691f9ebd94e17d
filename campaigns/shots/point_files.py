"""Point files of tracker software: one point a line, with a header or without.

How a file is read:

1. A byte-order mark decides how it is decoded, else the encoding given, else it is UTF-8.
2. Empty lines are left out. Comments (`//`, `#`, `;`) are kept apart: a header may stand in one.
   Lines of words and values, `Cnt=1 X= 2.5 …`, are rows, and their words the header.
3. The layout is found: separator, columns, unit, header lines (`point_layout`, by the meanings of
   words in `point_words`).
4. The user's unit is used, else the file's; without either the file is refused.
5. The decimal sign is the user's, else that of the file's numbers, which decide together; where
   each can be read in two ways the file is refused. Each row becomes a point in mm. Uncertainties
   become covariances, times ISO 8601.
6. Notes say how the file was read, and what of it was not used.

A tracker that writes points into a growing file is read by the functions for single rows.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import get_args

from campaigns.arrays import AXES
from campaigns.errors import ShotsInvalid
from campaigns.files.cells import (
    COMMENT,
    GROUPED,
    SEPARATORS,
    decimal_sign,
    is_number,
    number_value,
    point_text,
    possible_splits,
    split_line,
)
from campaigns.files.csv_file import check_lines
from campaigns.files.wording import shown
from campaigns.shots.point_layout import (
    EXPANDED,
    SIGMAS,
    Layout,
    Line,
    PointFormat,
    find_header,
    find_layout,
)
from campaigns.shots.point_words import MM_PER_UNIT, LengthUnit
from campaigns.shots.time_texts import iso_times
from drivers.bounded_files import (
    CSV_BYTES,
    SAVE_AS_UTF8,
    Encoding,
    FileRefused,
    check_no_nul,
    decoded,
    read_bounded,
)
from drivers.values import Matrix3, Vector3

NAME_JOINT = "::"
"""Separator of the parts of a name, as in SpatialAnalyzer."""
FARTHEST_MM = 1e8
"""Largest coordinate that is accepted in any unit."""
_COMMENT = re.compile(rf"{COMMENT.pattern}|;(?!(?:[^;]*;){{2}})")
"""Mark of a comment; a row whose first column is empty begins with a semicolon, too."""
_VALUE = r"[+-]?[\d.,]*\d(?:[eE][+-]?\d+)?"
_KEY_AND_VALUE = re.compile(
    rf"(?<!\w)(?P<key>[^\W\d]\w*+)\s*[=:]\s*(?P<value>{_VALUE}|[^\s;,=:{{}}]++(?!\s*[=:]))"
    rf"|\b(?P<axis>[xyz])\s*(?P<at>{_VALUE})",
    re.IGNORECASE,
)
"""Word before its value, as in `X= 2081.434`, or an axis before its number, as in `X2081.434`.

Words are tried from their beginnings alone: the time grows with a line's length, not its square.
"""


@dataclass(frozen=True, slots=True)
class NamedPoint:
    """Point of a file."""

    where: str
    """File and line, for errors."""
    name: str
    """Name, its parts joined by `NAME_JOINT`; empty: it has none."""
    point_mm: Vector3
    covariance_mm2: Matrix3 | None = None
    """Covariance by the file's uncertainties; None: it has none."""
    time: str | None = None
    """Time as in the file, or ISO 8601 once all are read; None: it has none."""


@dataclass(frozen=True, slots=True)
class PointFile:
    """Points of a file in its order, their unit in the file, and notes on how it was read."""

    name: str
    points: tuple[NamedPoint, ...]
    unit: LengthUnit
    notes: tuple[str, ...]
    unused: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Texts (N,) of the columns that are not used, by their headings."""


def read_points(path: Path, form: PointFormat) -> PointFile:
    """Read a file; raises `ShotsInvalid`, also if neither file nor user states the unit."""
    remedy = f"give {form.option}encoding {'|'.join(get_args(Encoding))}"
    try:
        text = decoded(read_bounded(path, CSV_BYTES), str(path), form.encoding, remedy)
    except FileRefused as error:
        raise ShotsInvalid(error.problem, remedy=error.remedy) from error
    return parse_points(text, str(path), form)


def parse_points(text: str, name: str, form: PointFormat) -> PointFile:
    """Read the text of a file; raises `ShotsInvalid`."""
    check_lines(text, name, ShotsInvalid)
    return _parse_lines(_filled_lines(text, name, form.option), name, form)


def data_rows(text: str) -> tuple[str, ...]:
    """Return the lines of a growing text that hold points or parts of them.

    A line with fewer than two numbers is a header line, and so is any before one that names X Y Z.
    """
    # Two numbers are enough, because the last line may be written in part when the file is read.
    lines = _filled_lines(text, "the file", "tracker.watch.")
    return tuple(line.text for line in lines[_first_row(lines) :] if _may_be_row(line))


def point_of_row(row: str, text: str, name: str, form: PointFormat) -> Vector3:
    """Return the point, mm, of one row of a file's text; raise `ShotsInvalid`.

    The unit in the text's header is used instead of that of `form`.
    """
    # The header and this row alone are read as a file: of other rows the decimal sign alone counts.
    lines = _filled_lines(text, name, form.option)
    begin = _first_row(lines)
    alone = [*lines[:begin], Line(name, row)]
    layout = find_layout(alone, replace(form, unit=None))
    voters = tuple(line for line in [*lines[begin:], alone[-1]] if _may_be_row(line))
    form = _with_decimal(form, replace(layout, rows=voters))
    (point,) = _parse_lines(alone, name, form, header_first=True).points
    return point.point_mm


def _first_row(lines: Sequence[Line]) -> int:
    """Return the place of the first line that may be a point, behind the header if there is one."""
    header = find_header(lines)
    begin = 0 if header is None else header[0] + 1
    while begin < len(lines) and not _may_be_row(lines[begin]):
        begin += 1
    return begin


def _may_be_row(line: Line) -> bool:
    """Return whether a line has two numbers with any separator."""
    return not line.is_comment and any(
        sum(map(is_number, cells)) >= 2 for _, cells in possible_splits(line.text)
    )


def _filled_lines(text: str, name: str, option: str) -> list[Line]:
    """Return the lines that are not empty, numbered as in the file; raise `ShotsInvalid`."""
    try:  # a growing file is decoded elsewhere
        check_no_nul(text, name, f"give {option}encoding utf-16, or {SAVE_AS_UTF8}")
    except FileRefused as error:
        raise ShotsInvalid(error.problem, remedy=error.remedy) from error
    lines = []
    for number, line in enumerate(StringIO(text, newline=None), start=1):
        if line.strip():
            mark = _COMMENT.match(line.lstrip())
            content = line.lstrip().lstrip("#/;%!") if mark else line
            lines.append(Line(f"{name}:{number}", content.strip(" \r\n"), mark is not None))
    return _without_keys(lines)


def _without_keys(lines: list[Line]) -> list[Line]:
    """Return lines of `KEY=value` as rows of values, with the keys of the first as a header.

    What stands before the first key is the row's name, if each row has another.
    """
    pairs = [[] if line.is_comment else _keys_and_values(line.text) for line in lines]
    keys = [tuple(key for key, _ in of_line) for of_line in pairs]
    header = next((names for names in keys if {*AXES} <= {name.lower() for name in names}), None)
    if header is None:
        return lines
    first, rows = keys.index(header), [row for row, names in enumerate(keys) if names == header]
    before = {row: _KEY_AND_VALUE.split(lines[row].text)[0].strip(" \t:;,=({[") for row in rows}
    is_named = all(before.values()) and len({*before.values()}) == len(rows)
    replaced = [*lines]
    for row in rows:
        cells = [before[row]] * is_named + [value for _, value in pairs[row]]
        replaced[row] = Line(lines[row].where, ";".join(cells))
    heads = Line(lines[first].where, ";".join([*["name"] * is_named, *header]))
    return [*replaced[:first], heads, *replaced[first:]]


def _keys_and_values(text: str) -> list[tuple[str, str]]:
    """Return the words of a line with their values."""
    matches = _KEY_AND_VALUE.finditer(text)
    return [(match["key"] or match["axis"], match["value"] or match["at"]) for match in matches]


def _parse_lines(
    lines: Sequence[Line], name: str, form: PointFormat, *, header_first: bool = False
) -> PointFile:
    """Read lines; if `header_first`, the file's unit is used instead of the user's."""
    # 1. Layout and unit. The layout refuses contradicting units of the file only if the user gives
    #    none, so for `header_first` the user's is taken out of what it sees.
    if all(line.is_comment for line in lines):
        raise ShotsInvalid(f"{name}: holds no points", remedy="check that it is the right file")
    layout = find_layout(lines, replace(form, unit=None) if header_first else form)
    unit = layout.unit or form.unit if header_first else form.unit or layout.unit
    if unit is None:
        raise ShotsInvalid(
            f"{name}: the file does not state its unit of length",
            remedy=f"give it with {form.option}unit {'|'.join(MM_PER_UNIT)}",
            options="--unit mm",  # of nearly all files; shots in a wrong unit are refused
        )
    # 2. Points.
    given, form = form.decimal, _with_decimal(form, layout)
    layout, zeros = _with_half_digit(layout, form)
    points = [_point(line, layout, replace(form, unit=unit)) for line in layout.rows]
    _check_unique(points)
    points, notes = _with_usable_columns(points, layout, name)
    if zeros and points[0].covariance_mm2:
        half = f"{layout.sigma_half_digit:g} {layout.sigma_unit or unit}"
        what = "uncertainty of 0 is" if zeros == 1 else "uncertainties of 0 are"
        notes.append(f"{name}: {zeros} {what} taken as half of a last digit, {half}")
    # 3. Notes, so that a user can see whether columns, header and unit were understood.
    columns = ", ".join(word for word in layout.order if word != "-")
    unused = [
        f"'{shown(text)}'"
        for text, word in zip(layout.headings, layout.order, strict=False)
        if word == "-" and text
    ]
    about = [
        f"{name}: {columns} by {SEPARATORS[layout.separator]}, in {unit}"
        + (", with decimal commas" if form.decimal == "comma" and not given else "")
        + (f"; not used: {', '.join(unused)}" if unused else "")
    ]
    if header := layout.header:
        quoted = ", ".join(f"'{shown(line.text)}'" for line in header[:3])
        count = "1 header line" if len(header) == 1 else f"{len(header)} header lines"
        about.append(f"{name}: {count} skipped: {quoted}{', …' if len(header) > 3 else ''}")
    if form.decimal and not given and (grouped := _first_grouped(layout)):
        read_as = point_text(grouped, form.decimal)
        about.append(f"{name}: thousands are grouped: '{shown(grouped)}' is {read_as}")
    if layout.unit not in {None, unit}:
        about.append(f"{name}: the header states {layout.unit}, {form.option}unit {unit} is used")
    return PointFile(name, tuple(points), unit, (*about, *notes), _unused(layout))


def _unused(layout: Layout) -> dict[str, tuple[str, ...]]:
    """Return the texts of the columns that are not used, by their headings."""
    table = [split_line(line.text, layout.separator) for line in layout.rows]
    return {
        heading: tuple(cells[place] if place < len(cells) else "" for cells in table)
        for place, (heading, role) in enumerate(zip(layout.headings, layout.order, strict=False))
        if role == "-"
    }


def _with_decimal(form: PointFormat, layout: Layout) -> PointFormat:
    """Return the format with the decimal sign of the rows' numbers, unless the user gave one."""
    if form.decimal is not None:
        return form
    return replace(form, decimal=decimal_sign(_numbers(layout)))


def _numbers(layout: Layout) -> Iterator[str]:
    """Yield the texts of coordinates and uncertainties."""
    roles = {*AXES, *SIGMAS, *EXPANDED}
    places = [place for place, role in enumerate(layout.order) if role in roles]
    table = (split_line(line.text, layout.separator) for line in layout.rows)
    yield from (cells[place] for cells in table for place in places if place < len(cells))


def _first_grouped(layout: Layout) -> str | None:
    """Return the first number with both groups of thousands and decimals."""
    matches = (match for text in _numbers(layout) if (match := GROUPED.fullmatch(text)))
    return next((match[0] for match in matches if match["rest"]), None)


def _with_half_digit(layout: Layout, form: PointFormat) -> tuple[Layout, int]:
    """Return the layout with half of the last digit of its uncertainties, and the number of zeros.

    A row of nothing but zeros has no uncertainty.
    """
    # One more decimal in any cell shows that software cuts zeros off: then it counts for all.
    places = [place for place, role in enumerate(layout.order) if role in {*SIGMAS, *EXPANDED}]
    table = [split_line(line.text, layout.separator) for line in layout.rows]
    cells = [[cells[place] for place in places if place < len(cells)] for cells in table]
    texts = [[point_text(cell, form.decimal) or "" for cell in row] for row in cells]
    decimals = max(
        (len(t.partition(".")[2]) for row in texts for t in row if "e" not in t.lower()), default=0
    )
    values = [[float(text or "nan") for text in row] for row in texts]
    zeros = sum(row.count(0.0) for row in values if any(row))
    return replace(layout, sigma_half_digit=0.5 * 10.0**-decimals if decimals else 0.0), zeros


def _point(line: Line, layout: Layout, form: PointFormat) -> NamedPoint:
    """Return the point of a line; raises `ShotsInvalid`."""
    where, cells = line.where, split_line(line.text, layout.separator)
    # 1. A row may lack columns behind the coordinates. More values than the header has columns are
    #    a decimal comma or separator that was taken for a border of cells.
    needed = max(layout.order.index(axis) for axis in AXES) + 1
    if len(cells) < needed:
        raise ShotsInvalid(
            f"{where}: {len(cells)} words for {len(layout.order)} columns {','.join(layout.order)}",
            remedy=f"correct the line, or {form.columns_remedy}",
        )
    width = len(layout.headings)
    if width and any(cells[width:]):
        raise ShotsInvalid(
            f"{where}: {len(cells)} values for {width} columns of the header",
            remedy="export without decimal commas and thousands separators, or "
            f"{form.columns_remedy}",
        )
    # 2. A role that several columns have is a name or time in parts, and these are joined.
    columns = [*zip(layout.order, cells, strict=False)]
    texts = dict(columns)
    x, y, z = (_length_mm(f"{where}: {axis}", texts[axis], form) for axis in AXES)
    return NamedPoint(
        where,
        NAME_JOINT.join(text for role, text in columns if role == "name"),
        (x, y, z),
        _covariance_mm2(texts, layout, form),
        _time_of([text for role, text in columns if role == "time"], form),
    )


def _time_of(texts: Sequence[str], form: PointFormat) -> str | None:
    """Return the time in a line's cells, a number with a decimal point; None: there is none."""
    text = " ".join(texts).strip("' ")
    return point_text(text, form.decimal) or text or None


def _length_mm(cell: str, text: str, form: PointFormat) -> float:
    """Return the coordinate in a cell, mm; raise `ShotsInvalid`, in which `cell` names it."""
    # Three answers to a text: a number in the notation that applies; a number in another notation,
    # which is never guessed, because 2,5 and 2.500 may each mean two things; no number at all.
    unit = form.unit or "mm"
    value = number_value(text, form.decimal)
    if value is None and is_number(text):
        raise ShotsInvalid(
            f"{cell} is '{shown(text)}', with a decimal comma or a thousands separator",
            remedy=f"give {form.option}decimal comma or {form.option}decimal point, or export "
            "the points with decimal points and without thousands separators",
            options=f"--decimal {'point' if number_value(text, 'comma') is None else 'comma'}",
        )
    if value is None:
        raise ShotsInvalid(
            f"{cell} is '{shown(text)}', must be a number",
            remedy=f"correct the line, or {form.columns_remedy}",
        )
    length_mm = value * MM_PER_UNIT[unit]
    if abs(length_mm) > FARTHEST_MM:  # an infinite one, too
        raise ShotsInvalid(
            f"{cell} is {shown(text)} {unit}, farther than {FARTHEST_MM:g} mm",
            remedy=f"check {form.option}unit, and that it is a point of this campaign",
        )
    return length_mm


def _covariance_mm2(texts: Mapping[str, str], layout: Layout, form: PointFormat) -> Matrix3 | None:
    """Return the covariance of a line's σ or U(95), None if it has neither.

    U(95) is an expanded uncertainty with coverage factor 2 (GUM).
    """
    # Files state no correlations, so X, Y and Z count as independent. A printed number is known to
    # half of its last digit: 0 beside others is at most this. A σ of zero would be a weight without
    # bound, and one beyond any coordinate is a mark for a missing value.
    mm = MM_PER_UNIT[layout.sigma_unit or form.unit or "mm"]
    for roles, coverage in ((SIGMAS, 1.0), (EXPANDED, 2.0)):
        values = [number_value(texts.get(role, ""), form.decimal) for role in roles]
        zero = layout.sigma_half_digit if any(values) else 0.0
        x, y, z = ((zero if v == 0.0 else v or 0.0) * mm / coverage for v in values)
        if min(x, y, z) > 0.0 and max(x, y, z) < FARTHEST_MM:
            return ((x * x, 0.0, 0.0), (0.0, y * y, 0.0), (0.0, 0.0, z * z))
    return None


def _with_usable_columns(
    points: list[NamedPoint], layout: Layout, name: str
) -> tuple[list[NamedPoint], list[str]]:
    """Leave out uncertainties and times that not every line has, and return notes on both."""
    # All or none: a fit that weighs some points by the file and others by the instrument's data
    # sheet, or orders only some by time, would depend on which lines lack a value.
    notes = []
    roles = {*layout.order}
    if roles & {*SIGMAS, *EXPANDED}:
        missing = next((point for point in points if point.covariance_mm2 is None), None)
        if missing is None:
            kind = "standard uncertainties" if roles >= {*SIGMAS} else "U(95)"
            notes.append(f"{name}: covariances from the uncertainties of X Y Z, taken as {kind}")
        else:
            points = [replace(point, covariance_mm2=None) for point in points]
            notes.append(f"{missing.where}: an uncertainty is not above zero: none of them is used")
    if "time" in roles:
        times = iso_times([point.time or "" for point in points])
        if None in times:
            unread = points[times.index(None)]
            text = f"time '{shown(unread.time or '')}' cannot be read, or in two ways"
            notes.append(f"{unread.where}: {text}: the order of rows counts")
            times = [None] * len(points)
        points = [replace(p, time=time) for p, time in zip(points, times, strict=True)]
    return points, notes


def _check_unique(points: Sequence[NamedPoint]) -> None:
    """Raise `ShotsInvalid` for the first point with the name of an earlier one."""
    seen: dict[str, str] = {}
    for point in points:
        if point.name and point.name in seen:
            raise ShotsInvalid(
                f"{point.where}: point '{shown(point.name)}' stands already in "
                f"line {seen[point.name].rpartition(':')[2]}",
                remedy="give each point a name of its own",
            )
        seen[point.name] = point.where
