"""Point files of tracker software: one point a line, with a header or without.

How a file is read:

1. A byte-order mark decides how it is decoded, else the encoding given, else it is UTF-8.
2. Empty lines and comments (`//`, `#`, `;`) are left out.
3. Lines before the first point are header lines: they are skipped, and quoted in a note.
4. A header line that names X, Y and Z determines separator, columns and units, and which columns
   are standard uncertainties or times. Without one, X Y Z are the first three numbers in a row.
5. Numbers have decimal points and no thousands separators, unless a decimal sign is given.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from io import StringIO
from itertools import groupby
from pathlib import Path
from typing import Literal, get_args

from campaigns.arrays import AXES
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import NUMBER, WITH_COMMA, check_lines
from campaigns.files.wording import shown, suggestion
from drivers.bounded_files import CSV_BYTES, Encoding, FileRefused, decoded, read_bounded
from drivers.values import Matrix3, Vector3

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
_UNITS_IN_HEADERS: Mapping[str, LengthUnit] = {
    **{unit: unit for unit in MM_PER_UNIT},
    **dict.fromkeys(("millimeter", "millimeters", "millimetre", "millimetres"), "mm"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    **dict.fromkeys(("in", "inches"), "inch"),
    **dict.fromkeys(("foot", "feet"), "ft"),
    **dict.fromkeys(("µm", "μm", "micron", "microns"), "um"),
}
Coordinates = Literal["actual", "nominal"]
_SETS: Mapping[str, Coordinates] = {
    **dict.fromkeys(("actual", "act", "measured", "meas", "ist"), "actual"),
    **dict.fromkeys(("nominal", "nom", "theoretical", "soll"), "nominal"),
}
DecimalSign = Literal["point", "comma"]

COLUMN_WORDS = ("name", "x", "y", "z", "-")
"""Columns that can be given: a name may have several parts, `-` skips a column."""
SIGMAS = ("sx", "sy", "sz")
EXPANDED = ("ux", "uy", "uz")
"""Columns of a header: standard uncertainties, and U(95), which are twice as large."""
NAME_JOINT = "::"
"""Separator of the parts of a name, as in SpatialAnalyzer."""
MOST_NAME_PARTS = 3
COMMENTS = ("//", "#", ";")
SEPARATORS: Mapping[str, str] = {";": "semicolons", "\t": "tabs", ",": "commas", "": "blanks"}
FARTHEST_MM = 1e8
"""Largest coordinate that is accepted in any unit."""

_WORD = re.compile(r"[^\W\d_]+|\d+")
_AXIS_WORD = re.compile(r"(σ|sigma|s|u)?([xyz])(.*)")
_SIGMA_WORDS = frozenset({"σ", "sigma", "s", "std", "stdev", "rms", "uncertainty"})
_EXPANDED_WORDS = frozenset({"u", "95"})
_FILLING_WORDS = frozenset({"coordinate", "coord", "position", "pos", "value"})
_NAME_HEADINGS = ("name", "point name", "point id", "point", "id", "label")
_NUMBER_HEADINGS = ("no", "nr", "number", "seq", "index")
_TIME_WORDS = frozenset({"time", "stamp", "timestamp", "date", "datetime", "utc"})
_WHOLE = re.compile(r"\d+", re.ASCII)
_GROUPED = re.compile(
    r"[+-]?\d{1,3}(?P<mark>[.,'’ \u00a0\u2009\u202f])\d{3}(?:(?P=mark)\d{3})*(?P<rest>[.,]\d*)?",
    re.ASCII,
)
"""Number with thousands separators."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointFormat:
    """What is known of a point file beside its text; None: the file has to show it."""

    unit: LengthUnit | None = None
    columns: Sequence[str] | None = None
    coordinates: Coordinates | None = None
    """Which of two sets of columns counts."""
    decimal: DecimalSign | None = None
    """Decimal sign; with one given, thousands separators are read too."""
    encoding: Encoding | None = None
    option: str = "--"
    """Beginning of a field's name where the user sets it, for remedies."""


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


@dataclass(frozen=True, slots=True)
class _HeaderCell:
    """Heading of a column: its words, and what they mean of a coordinate."""

    words: tuple[str, ...]
    axis: str = ""
    kind: Literal["point", "sigma", "expanded"] = "point"
    set_: Coordinates | Literal[""] = ""
    unit: LengthUnit | None = None
    unknown: str = ""
    """Word beside the axis that is neither unit nor set."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """Columns of a file's lines."""

    separator: str
    order: tuple[str, ...]
    """Meaning of each column: a word of `COLUMN_WORDS`, `SIGMAS`, `EXPANDED` or `time`."""
    unit: LengthUnit | None = None
    """Unit that the header states for the coordinates."""
    sigma_unit: LengthUnit | None = None
    width: int = 0
    """Number of the header's columns; 0 without a header."""


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
        unit = _header_layout(heading, form, name).unit
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


def _split(line: str, separator: str) -> tuple[str, ...]:
    """Cut a line at a separator, or at blanks, as CSV with quotes."""
    text = line if separator else " ".join(line.split())
    with suppress(csv.Error):
        cells = next(csv.reader([text], delimiter=separator or " ", skipinitialspace=True))
        return tuple(cell.strip() for cell in cells)
    return (line,)


def _splits(line: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each separator that a line may have, with the line cut there."""
    for separator in SEPARATORS:
        if separator in line:
            yield separator, _split(line, separator)


def _numbers_of(line: str) -> Iterator[list[str]]:
    """Yield the numbers in a line, for each separator that it may have."""
    for _, cells in _splits(line):
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


# The file's lines: header and data


def _divide(lines: Sequence[Line], form: PointFormat) -> tuple[_Layout, list[Line], list[Line]]:
    """Return the layout of a file's lines, its header lines, and its lines with points."""
    place = _header_line(lines)
    if place is not None:
        where, heading = lines[place]
        layout = _header_layout(heading, form, where)
    else:
        heading, layout = "", _layout_of_data(lines, form)
    begin = 0
    if place is None:
        while begin < len(lines) - 1 and not _has_point(lines[begin][1], layout):
            begin += 1
    else:
        begin = place + 1
        if begin < len(lines) and not any(_numbers_of(lines[begin][1])):  # a line of units
            units = [_header_cell(cell) for cell in _split(lines[begin][1], layout.separator)]
            stated = _one_unit(units, layout.order, lines[begin][0])
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
        if any(_names_axes(cells) for _, cells in _splits(line)):
            return place
        if any(_run(cells) for _, cells in _splits(line)):
            return None
    return None


def _names_axes(cells: Sequence[str]) -> bool:
    return {cell.axis for cell in map(_header_cell, cells) if cell.kind == "point"} >= {*AXES}


def _has_point(line: str, layout: _Layout) -> bool:
    """Whether numbers stand where a layout has coordinates."""
    cells = _split(line, layout.separator)
    if not layout.order:
        return _run(cells) is not None
    places = [layout.order.index(axis) for axis in AXES]
    return max(places) < len(cells) and all(_is_number(cells[place]) for place in places)


def _layout_of_data(lines: Sequence[Line], form: PointFormat) -> _Layout:
    """Return the layout of the first line that has a point, in a file without column names."""
    order = () if form.columns is None else _given_order(form, lines[0][0])
    for _, line in lines:
        for separator, _ in _splits(line):
            layout = _Layout(separator, order)
            if _has_point(line, layout):
                return layout
    where, line = lines[0]
    if not order:
        raise _no_point(where, line)
    return _Layout(next(_splits(line))[0], order)


def _given_order(form: PointFormat, where: str) -> tuple[str, ...]:
    """Return the columns that the user gives; raises `ShotsInvalid`."""
    columns = form.columns or ()
    name = where.rpartition(":")[0]
    for word in columns:
        if word not in COLUMN_WORDS:
            raise ShotsInvalid(
                f"{name}: unknown column '{shown(word)}'", remedy=suggestion(word, COLUMN_WORDS)
            )
    for axis in AXES:
        if columns.count(axis) != 1:
            raise ShotsInvalid(
                f"{name}: {form.option}columns {','.join(columns)} has {columns.count(axis)} "
                f"{axis}",
                remedy="give each of x, y and z once",
            )
    return tuple(columns)


# The header


def _header_cell(text: str) -> _HeaderCell:
    """Return what a heading means: `X`, `x_mm`, `"X  [mm]"`, `Y act`, `U(95) Z [mm]`, `σx`."""
    words: list[str] = []
    for word in _WORD.findall(text.lower()):
        glued = _AXIS_WORD.fullmatch(word)
        if glued and glued[3] in {"", *_UNITS_IN_HEADERS, *_SETS}:
            words += [part for part in glued.groups() if part]
        else:
            words.append(word)
    axes = [word for word in words if word in AXES]
    if len(axes) != 1:
        return _HeaderCell(tuple(words))
    cell = _HeaderCell(tuple(words), axes[0])
    for word in words:
        if word in _UNITS_IN_HEADERS:
            cell = replace(cell, unit=_UNITS_IN_HEADERS[word])
        elif word in _SETS:
            cell = replace(cell, set_=_SETS[word])
        elif word in _EXPANDED_WORDS:
            cell = replace(cell, kind="expanded")
        elif word in _SIGMA_WORDS and cell.kind == "point":
            cell = replace(cell, kind="sigma")
        elif word not in AXES and word not in _FILLING_WORDS:
            cell = replace(cell, unknown=word)
    return cell


def _header_layout(heading: str, form: PointFormat, where: str) -> _Layout:
    """Return the layout that a header line states; raises `ShotsInvalid`."""
    separator, texts = next(each for each in _splits(heading) if _names_axes(each[1]))
    cells = [*map(_header_cell, texts)]
    if not separator:  # `X [mm] Y [mm]`: the blank before a bracket separates no columns
        cells = [*map(_header_cell, _split(re.sub(r"\s+(?=[\[(])", "", heading), ""))]
    if form.columns is not None:
        order = [*_given_order(form, where), *["-"] * len(cells)][: len(cells)]
    else:
        order = ["-"] * len(cells)
        for axis, place in _coordinate_places(cells, texts, form, where).items():
            order[place] = axis
        for place in _name_places(cells):
            order[place] = "name"
        for kind, roles in (("sigma", SIGMAS), ("expanded", EXPANDED)):
            for place, cell in enumerate(cells):
                if cell.axis and cell.kind == kind and not cell.unknown:
                    order[place] = roles[AXES.index(cell.axis)]
        for place, cell in enumerate(cells):
            if cell.words and _TIME_WORDS.issuperset(cell.words):
                order[place] = "time"
    unit = _one_unit(cells, order, where)
    sigma_unit = _one_unit(cells, order, where, (*SIGMAS, *EXPANDED))
    return _Layout(separator, tuple(order), unit, sigma_unit, width=len(cells))


def _coordinate_places(
    cells: Sequence[_HeaderCell], texts: Sequence[str], form: PointFormat, where: str
) -> dict[str, int]:
    """Return the column of each axis, of the set that is measured; raises `ShotsInvalid`."""
    sets: dict[tuple[str, str], dict[str, int]] = {}
    for place, cell in enumerate(cells):
        if cell.axis and cell.kind == "point":
            places = sets.setdefault((cell.set_, cell.unknown), {})
            if cell.axis in places and not cell.unknown:
                raise ShotsInvalid(
                    f"{where}: the header has two columns '{shown(texts[place])}'",
                    remedy=f"choose with {form.option}columns, for example name,-,-,-,x,y,z",
                )
            places[cell.axis] = place
    whole = {key: places for key, places in sets.items() if len(places) == len(AXES)}
    readable = {set_: places for (set_, unknown), places in whole.items() if not unknown}
    if not readable:
        unknown = next((word for _, word in sets if word), "")
        raise ShotsInvalid(
            f"{where}: '{shown(unknown)}' beside X Y Z in the header is no known unit"
            if unknown
            else f"{where}: the header does not name X, Y and Z of one set",
            remedy=f"write one of {', '.join(UNIT_WORDS)}, or give {form.option}columns and "
            f"{form.option}unit",
        )
    if set(readable) == {"", "nominal"}:
        readable["actual"] = readable.pop("")
    if set(readable) == {"", "actual"}:
        readable["nominal"] = readable.pop("")
    if form.coordinates in readable:
        return readable[form.coordinates]
    if len(readable) == 1 and "nominal" not in readable:
        return next(iter(readable.values()))
    names = " and ".join(f"'{shown(texts[places['x']])}'" for places in readable.values())
    raise ShotsInvalid(
        f"{where}: the header has {len(readable)} sets of X Y Z, {names}"
        if len(readable) > 1
        else f"{where}: the header names nominal coordinates only, {names}",
        remedy=f"choose with {form.option}coordinates actual or nominal, or name the columns "
        f"with {form.option}columns, for example name,-,-,-,x,y,z",
    )


def _name_places(cells: Sequence[_HeaderCell]) -> list[int]:
    """Return the columns of a point's name: collection, group and name, else a running number."""
    headings = [" ".join(cell.words) for cell in cells]
    groups = [place for place, text in enumerate(headings) if text in {"collection", "group"}]
    for names in (_NAME_HEADINGS, ("target",) if groups else (), _NUMBER_HEADINGS):
        for name in names:
            if name in headings:
                return [*groups, headings.index(name)]
    return []


def _one_unit(
    cells: "Iterator[_HeaderCell] | Sequence[_HeaderCell]",
    order: Sequence[str],
    where: str = "",
    roles: Sequence[str] = AXES,
) -> LengthUnit | None:
    """Return the unit of the columns with these roles, None if none is stated."""
    units = [
        cell.unit
        or next((_UNITS_IN_HEADERS[w] for w in cell.words if w in _UNITS_IN_HEADERS), None)
        for cell, role in zip(cells, order, strict=False)
        if role in roles
    ]
    if len(set(units)) > 1:
        stated = ", ".join(str(unit or "none") for unit in units)
        raise ShotsInvalid(
            f"{where}: the header has several units: {stated}",
            remedy="export all coordinates in one unit",
        )
    return units[0] if units else None


# Lines with points


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
    table = [(where, line, _split(line, separator)) for where, line in lines]
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


def _point(line: Line, layout: _Layout, form: PointFormat) -> NamedPoint:
    """Return the point of a line; raises `ShotsInvalid`."""
    where, cells = line[0], _split(line[1], layout.separator)
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


def _covariance_mm2(texts: Mapping[str, str], layout: _Layout, form: PointFormat) -> Matrix3 | None:
    """Return the covariance of a line's σ or U(95), the latter with coverage factor 2."""
    mm = MM_PER_UNIT[layout.sigma_unit or form.unit or "mm"]
    for roles, coverage in ((SIGMAS, 1.0), (EXPANDED, 2.0)):
        values = [_value(texts.get(role, ""), form.decimal) for role in roles]
        x, y, z = ((value or 0.0) * mm / coverage for value in values)
        if min(x, y, z) > 0.0 and max(x, y, z) < FARTHEST_MM:
            return ((x * x, 0.0, 0.0), (0.0, y * y, 0.0), (0.0, 0.0, z * z))
    return None


def _with_usable_columns(
    points: list[NamedPoint], layout: _Layout, name: str
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
