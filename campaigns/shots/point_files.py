"""Point files of tracker software: one point a line, with a header or without.

How a file is read:

1. A byte-order mark decides how it is decoded, else the encoding given, else it is UTF-8.
2. Empty lines and comments (`//`, `#`, `;`) are left out.
3. Lines before the first point are header lines: they are skipped, and quoted in a note.
4. A header line that names X, Y and Z determines separator, columns and units, and which columns
   are standard uncertainties or times. Without one, X Y Z are the first three numbers in a row.
5. Numbers have decimal points and no thousands separators, unless a decimal sign is given.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from io import StringIO
from itertools import groupby
from pathlib import Path
from typing import get_args

from campaigns.arrays import AXES
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import NUMBER, WITH_COMMA, check_lines
from campaigns.files.wording import shown
from campaigns.shots.point_header import (
    EXPANDED,
    MM_PER_UNIT,
    SEPARATORS,
    SIGMAS,
    UNIT_WORDS,
    DecimalSign,
    Layout,
    LengthUnit,
    PointFormat,
    common_unit,
    given_order,
    header_cell,
    header_layout,
    names_axes,
    possible_splits,
    split_line,
)
from drivers.bounded_files import CSV_BYTES, Encoding, FileRefused, decoded, read_bounded
from drivers.values import Matrix3, Vector3

NAME_JOINT = "::"
"""Separator of the parts of a name, as in SpatialAnalyzer."""
MOST_NAME_PARTS = 3
COMMENTS = ("//", "#", ";")
FARTHEST_MM = 1e8
"""Largest coordinate that is accepted in any unit."""
_WHOLE = re.compile(r"\d+", re.ASCII)
_GROUPED = re.compile(
    r"[+-]?\d{1,3}(?P<mark>[.,'’ \u00a0\u2009\u202f])\d{3}(?:(?P=mark)\d{3})*(?P<rest>[.,]\d*)?",
    re.ASCII,
)
"""Number with thousands separators."""


@dataclass(frozen=True, slots=True)
class NamedPoint:
    """Point with its name, empty when it has none, and its place in its file."""

    where: str
    name: str
    point_mm: Vector3
    covariance_mm2: Matrix3 | None = None
    time: str | None = None


@dataclass(frozen=True, slots=True)
class PointFile:
    """Points of a file in its order, their unit in the file, and notes on how it was read."""

    name: str
    points: tuple[NamedPoint, ...]
    unit: LengthUnit
    notes: tuple[str, ...]


Line = tuple[str, str]
"""File and number of a line, and its text."""


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
    lines = _filled_lines(text, name)
    if not lines:
        raise ShotsInvalid(f"{name}: holds no points", remedy="check that it is the right file")
    layout, header, data = _divide(lines, form)
    unit = form.unit or layout.unit
    if unit is None:
        raise ShotsInvalid(
            f"{name}: the file does not state its unit of length",
            remedy=f"give it with {form.option}unit {'|'.join(UNIT_WORDS)}",
        )
    points = [_point(line, layout, replace(form, unit=unit)) for line in data]
    _check_unique(points)
    points, notes = _with_usable_columns(points, layout, name)
    columns = ", ".join(word for word in layout.order if word != "-")
    about = [f"{name}: {columns} by {SEPARATORS[layout.separator]}, in {unit}"]
    if header:
        quoted = ", ".join(f"'{shown(line)}'" for _, line in header[:3])
        more = ", …" if len(header) > 3 else ""
        lines_word = "line" if len(header) == 1 else "lines"
        about.append(f"{name}: {len(header)} header {lines_word} skipped: {quoted}{more}")
    if layout.unit not in {None, unit}:
        about.append(f"{name}: the header states {layout.unit}, {form.option}unit {unit} is used")
    return PointFile(name, tuple(points), unit, (*about, *notes))


def data_rows(text: str) -> tuple[str, ...]:
    """Return the lines of a growing text that hold points or parts of them.

    A line with fewer than two numbers is a header line, and so is any before one that names X Y Z.
    """
    lines = _filled_lines(text, "")
    header = _header_line(lines)
    rows = lines if header is None else lines[header + 1 :]
    return tuple(line for _, line in rows if max(map(len, _numbers_of(line)), default=0) >= 2)


def point_of_row(row: str, text: str, name: str, form: PointFormat) -> Vector3:
    """Return the point, mm, of one row of a file's text; the text's header goes before `form`.

    Raises `ShotsInvalid`.
    """
    lines = _filled_lines(text, name)
    header = _header_line(lines)
    if header is None:
        data = row
    else:
        heading = lines[header][1]
        unit = header_layout(heading, form, name).unit
        data, form = f"{heading}\n{row}", replace(form, unit=unit or form.unit)
    (point,) = parse_points(data, name, form).points
    return point.point_mm


def _filled_lines(text: str, name: str) -> list[Line]:
    return [
        (f"{name}:{number}", line.strip(" \r\n"))
        for number, line in enumerate(StringIO(text, newline=None), start=1)
        if line.strip() and not _is_comment(line.lstrip())
    ]


def _is_comment(line: str) -> bool:
    """Whether a line is a comment, and no row of semicolons whose first column is empty."""
    return line.startswith(COMMENTS) and not (line[0] == ";" and line.count(";") >= len(AXES))


def _numbers_of(line: str) -> Iterator[list[str]]:
    """Yield the numbers in a line, for each separator that it may have."""
    for _, cells in possible_splits(line):
        yield [cell for cell in cells if _is_number(cell)]


def _is_number(text: str) -> bool:
    """Whether a text is a number in any notation."""
    return any(form.fullmatch(text) for form in (NUMBER, WITH_COMMA, _GROUPED))


def _value(text: str, decimal: DecimalSign | None) -> float | None:
    """Return a number in the notation given; None for any other text."""
    sign = "," if decimal == "comma" else "."
    if decimal and (grouped := _GROUPED.fullmatch(text)):
        mark, decimals = grouped["mark"], grouped["rest"] or sign
        if mark != sign and decimals[0] == sign:
            text = text.replace(mark, "")
    if decimal == "comma":
        text = text.replace(".", "?").replace(",", ".")
    return float(text) if NUMBER.fullmatch(text) else None


def _divide(lines: Sequence[Line], form: PointFormat) -> tuple[Layout, list[Line], list[Line]]:
    """Return the layout of a file's lines, its header lines, and its lines with points."""
    place = _header_line(lines)
    if place is not None:
        where, heading = lines[place]
        layout = header_layout(heading, form, where)
    else:
        heading, layout = "", _layout_of_data(lines, form)
    begin = 0
    if place is None:
        while begin < len(lines) - 1 and not _has_point(lines[begin][1], layout):
            begin += 1
    else:
        begin = place + 1
        if begin < len(lines) and not any(_numbers_of(lines[begin][1])):  # a line of units
            units = [header_cell(cell) for cell in split_line(lines[begin][1], layout.separator)]
            stated = common_unit(units, layout.order, lines[begin][0])
            layout, begin = replace(layout, unit=layout.unit or stated), begin + 1
    data = [line for line in lines[begin:] if line[1] != heading]
    if not data:
        raise ShotsInvalid(
            f"{lines[0][0]}: no points under the header line '{shown(heading)}'",
            remedy="check that it is the right file",
        )
    if place is None and form.columns is None:
        layout = replace(layout, order=_order_of_runs(data, layout.separator, form))
    return layout, [*lines[:begin]], data


def _header_line(lines: Sequence[Line]) -> int | None:
    """Return the place of the line that names X Y Z before the first point, None without one."""
    for place, (_, line) in enumerate(lines):
        if any(names_axes(cells) for _, cells in possible_splits(line)):
            return place
        if any(_run(cells) for _, cells in possible_splits(line)):
            return None
    return None


def _has_point(line: str, layout: Layout) -> bool:
    """Whether numbers stand where a layout has coordinates."""
    cells = split_line(line, layout.separator)
    if not layout.order:
        return _run(cells) is not None
    places = [layout.order.index(axis) for axis in AXES]
    return max(places) < len(cells) and all(_is_number(cells[place]) for place in places)


def _layout_of_data(lines: Sequence[Line], form: PointFormat) -> Layout:
    """Return the layout of the first line that has a point, in a file without column names."""
    order = () if form.columns is None else given_order(form, lines[0][0])
    for _, line in lines:
        for separator, _ in possible_splits(line):
            layout = Layout(separator, order)
            if _has_point(line, layout):
                return layout
    where, line = lines[0]
    if not order:
        raise _no_point(where, line)
    return Layout(next(possible_splits(line))[0], order)


def _run(cells: Sequence[str]) -> tuple[int, int] | None:
    """Return the start of the first run of at least three numbers and its length, else None."""
    start = 0
    for is_number, run in groupby(cells, _is_number):
        length = len([*run])
        if is_number and length >= len(AXES):
            return start, length
        start += length
    return None


def _no_point(where: str, line: str) -> ShotsInvalid:
    return ShotsInvalid(
        f"{where}: no X Y Z: '{shown(line)}' has no three numbers in a row",
        remedy="take the line out, or put // before it; if it is the header, put // before the "
        "lines above it",
    )


def _order_of_runs(lines: Sequence[Line], separator: str, form: PointFormat) -> tuple[str, ...]:
    """Return name and X Y Z: the first run of three numbers, the same in every line.

    Of four numbers the first is a name if it is a whole number in every line.
    """
    remedy = f"say what they are, for example {form.option}columns name,x,y,z"
    table = [(where, line, split_line(line, separator)) for where, line in lines]
    where, first, _ = table[0]
    runs = [_run(cells) for _, _, cells in table]
    for run, (place, line, _) in zip(runs, table, strict=True):
        if run is None:
            raise _no_point(place, line)
        if run != runs[0]:
            raise ShotsInvalid(
                f"{place}: '{shown(line)}' has other columns than line "
                f"{where.rpartition(':')[2]}, '{shown(first)}'",
                remedy="correct the line, export with commas if names hold blanks, or name all "
                f"columns, for example {form.option}columns name,x,y,z",
            )
    start, numbers = runs[0] or (0, 0)
    names_are_numbers = numbers == len(AXES) + 1 and all(
        _WHOLE.fullmatch(cells[start]) for _, _, cells in table
    )
    if names_are_numbers and separator == "," and start:
        joined = [f"{cells[start]},{cells[start + 1]}" for _, _, cells in table]
        if all(map(_GROUPED.fullmatch, joined)):
            raise ShotsInvalid(
                f"{where}: '{joined[0]}' may be a number with a thousands separator",
                remedy=f"export without thousands separators; else {remedy}",
            )
    names = start + 1 if names_are_numbers else start
    if numbers > len(AXES) and not names_are_numbers:
        raise ShotsInvalid(f"{where}: {numbers} numbers in a row, X Y Z are three", remedy=remedy)
    if names > MOST_NAME_PARTS:
        raise ShotsInvalid(
            f"{where}: {names} words before X Y Z, a name has at most {MOST_NAME_PARTS}",
            remedy=remedy,
        )
    return (*["name"] * names, *AXES)


def _point(line: Line, layout: Layout, form: PointFormat) -> NamedPoint:
    """Return the point of a line; raises `ShotsInvalid`."""
    where, cells = line[0], split_line(line[1], layout.separator)
    needed = max(layout.order.index(axis) for axis in AXES) + 1
    if len(cells) < needed:
        raise ShotsInvalid(
            f"{where}: {len(cells)} words for {len(layout.order)} columns {','.join(layout.order)}",
            remedy=f"correct the line, or {form.option}columns",
        )
    if layout.width and len(cells) > layout.width and any(cells[layout.width :]):
        raise ShotsInvalid(
            f"{where}: {len(cells)} values for {layout.width} columns of the header",
            remedy="export without decimal commas and thousands separators, or name all columns, "
            f"for example {form.option}columns name,x,y,z",
        )
    texts = dict(zip(layout.order, cells, strict=False))
    parts = [cell for cell, role in zip(cells, layout.order, strict=False) if role == "name"]
    dates = [cell for cell, role in zip(cells, layout.order, strict=False) if role == "time"]
    x, y, z = (_length_mm(f"{where}: {axis}", texts[axis], form) for axis in AXES)
    return NamedPoint(
        where,
        NAME_JOINT.join(parts),
        (x, y, z),
        _covariance_mm2(texts, layout, form),
        " ".join(dates).strip("' ") or None,
    )


def _length_mm(what: str, text: str, form: PointFormat) -> float:
    unit = form.unit or "mm"
    value = _value(text, form.decimal)
    if value is None and _is_number(text):
        raise ShotsInvalid(
            f"{what} is '{shown(text)}', with a decimal comma or a thousands separator",
            remedy=f"give {form.option}decimal comma or {form.option}decimal point, or export "
            "the points with decimal points and without thousands separators",
        )
    if value is None:
        raise ShotsInvalid(
            f"{what} is '{shown(text)}', must be a number",
            remedy=f"correct the line, or {form.option}columns",
        )
    length_mm = value * MM_PER_UNIT[unit]
    if abs(length_mm) > FARTHEST_MM:  # an infinite one, too
        raise ShotsInvalid(
            f"{what} is {shown(text)} {unit}, farther than {FARTHEST_MM:g} mm",
            remedy=f"check {form.option}unit, and that it is a point of this campaign",
        )
    return length_mm


def _covariance_mm2(texts: Mapping[str, str], layout: Layout, form: PointFormat) -> Matrix3 | None:
    """Return the covariance of a line's σ or U(95), the latter with coverage factor 2."""
    mm = MM_PER_UNIT[layout.sigma_unit or form.unit or "mm"]
    for roles, coverage in ((SIGMAS, 1.0), (EXPANDED, 2.0)):
        values = [_value(texts.get(role, ""), form.decimal) for role in roles]
        x, y, z = ((value or 0.0) * mm / coverage for value in values)
        if min(x, y, z) > 0.0 and max(x, y, z) < FARTHEST_MM:
            return ((x * x, 0.0, 0.0), (0.0, y * y, 0.0), (0.0, 0.0, z * z))
    return None


def _with_usable_columns(
    points: list[NamedPoint], layout: Layout, name: str
) -> tuple[list[NamedPoint], list[str]]:
    """Leave out uncertainties and times that not every line has, and note it."""
    notes = []
    if {*layout.order} & {*SIGMAS, *EXPANDED}:
        missing = next((point for point in points if point.covariance_mm2 is None), None)
        if missing is None:
            notes.append(f"{name}: covariances from the uncertainties of X Y Z")
        else:
            points = [replace(point, covariance_mm2=None) for point in points]
            notes.append(f"{missing.where}: an uncertainty is not above zero: none of them is used")
    if "time" in layout.order:
        times = [_iso_time(point.time or "") for point in points]
        if None in times:
            unread = points[times.index(None)]
            notes.append(f"{unread.where}: time '{shown(unread.time or '')}' cannot be read")
            times = [None] * len(points)
        points = [replace(p, time=time) for p, time in zip(points, times, strict=True)]
    return points, notes


def _iso_time(text: str) -> str | None:
    """Return a time as ISO 8601 or a number: also of `11.10.2022 15:06:00.043`; None if neither."""
    if NUMBER.fullmatch(text):
        return text
    with suppress(ValueError):
        return datetime.fromisoformat(text).isoformat()
    for form in ("%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S"):
        with suppress(ValueError):
            return datetime.strptime(text, form).isoformat()  # noqa: DTZ007 - without a zone
    return None


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
