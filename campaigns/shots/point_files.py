"""Point files of tracker software: one point a line, with a header or without.

How a file is read:

1. A byte-order mark decides how it is decoded, else the encoding given, else it is UTF-8.
2. Empty lines and comments (`//`, `#`, `;`) are left out, but for a header in a comment whose
   columns match those of the first row.
3. A header line that names X, Y and Z determines separator, columns and units, and which columns
   are uncertainties or times. Without one, X Y Z are the first three numbers in a row.
4. Lines before the first point are skipped, and quoted in a note; `Units: mm` there is the unit.
5. Numbers have decimal points and no thousands separators, unless a decimal sign is given.

A heading is cut into words: `X [mm]`, `x_mm`, `Y act`, `U(95) Z [mm]`, `σx`. One axis among them
makes it a coordinate or its uncertainty; the others are its unit and its set, nominal or actual.
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
from typing import Literal, NamedTuple, get_args

from campaigns.arrays import AXES
from campaigns.errors import CoordinatesAmbiguous, ShotsInvalid
from campaigns.files.csv_file import NUMBER, WITH_COMMA, check_lines
from campaigns.files.wording import shown, suggestion
from drivers.bounded_files import CSV_BYTES, Encoding, FileRefused, decoded, read_bounded
from drivers.values import Matrix3, Vector3

LengthUnit = Literal["mm", "m", "inch", "ft", "cm", "um"]
_UNITS: Mapping[LengthUnit, tuple[float, str]] = {
    "mm": (1.0, "mm millimeter millimeters millimetre millimetres"),
    "m": (1000.0, "m meter meters metre metres"),
    "inch": (25.4, "inch inches in zoll"),
    "ft": (304.8, "ft foot feet"),
    "cm": (10.0, "cm centimeter centimeters centimetre centimetres"),
    "um": (1e-3, "um µm μm micron microns micrometer micrometers micrometre micrometres"),
}
"""Each unit in mm, and its words in headers: the two signs of micro are two characters."""
MM_PER_UNIT: Mapping[LengthUnit, float] = {unit: mm for unit, (mm, _) in _UNITS.items()}
Coordinates = Literal["actual", "nominal"]
DecimalSign = Literal["point", "comma"]
_WORD_MEANINGS: Mapping[str, str] = {
    word: meaning
    for meaning, words in {
        **{axis: axis for axis in AXES},
        **{str(unit): words for unit, (_, words) in _UNITS.items()},
        "actual": "actual act measured meas ist",
        "nominal": "nominal nom theoretical soll",
        "sigma": "σ sigma s u std stdev stddev rms",
        "expanded": "U 95",
        "filler": "coordinate coordinates coord position pos value",
    }.items()
    for word in words.split()
}
"""Meanings of the words in headings of coordinates; u is a standard uncertainty, U an expanded."""
_UNIT_WORDS = frozenset(word for word, unit in _WORD_MEANINGS.items() if unit in MM_PER_UNIT)
_GROUP_HEADINGS = ("collection", "group")
_NAME_HEADINGS = (
    *("name", "point name", "pointname", "point id", "pointid", "point", "id", "label"),
    *("punktname", "punktnummer", "punkt", "pt", "target"),
    *("no", "nr", "number", "seq", "index"),
)
"""Headings of a point's name, the most certain first."""
_TIME_WORDS = frozenset({"time", "stamp", "timestamp", "date", "datetime", "utc"})
_COLUMN_WORDS = ("name", "x", "y", "z", "-")
"""Columns that can be given: a name may have several parts, `-` skips a column."""
SIGMAS = ("sx", "sy", "sz")
EXPANDED = ("ux", "uy", "uz")
"""Columns of a header: standard uncertainties, and U(95), which are twice as large."""
_SEPARATORS: Mapping[str, str] = {";": "semicolons", "\t": "tabs", ",": "commas", "": "blanks"}
NAME_JOINT = "::"
"""Separator of the parts of a name, as in SpatialAnalyzer."""
MOST_NAME_PARTS = 3
FARTHEST_MM = 1e8
"""Largest coordinate that is accepted in any unit."""
_COMMENT = re.compile(r"//|#|;(?!(?:[^;]*;){2})")
"""Mark of a comment; a row whose first column is empty begins with a semicolon, too."""
_UNIT_LINE = re.compile(
    r"(?:(?:lengths?|linear|distances?|coordinates?)\W*)?(?:units?|einheit(?:en)?)\b(.*)", re.I
)
_WORD = re.compile(r"[^\W\d_]+|\d+")
_AXIS_WORD = re.compile(r"(σ|sigma|s|u)?([xyz])(.*)", re.I)
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

    @property
    def columns_remedy(self) -> str:
        """Advice to name the columns."""
        return f"name the columns, for example {self.option}columns name,x,y,z"


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


class _Line(NamedTuple):
    """Filled line of a file, without the mark if it is a comment."""

    where: str
    text: str
    is_comment: bool = False


@dataclass(frozen=True, slots=True)
class _Heading:
    """Heading of a column, and what its words mean of a coordinate."""

    text: str
    words: tuple[str, ...]
    axis: str
    role: str
    """Meaning as in a layout's `order`."""
    set_: str
    """`actual`, `nominal`, or empty."""
    unit: LengthUnit | None
    unknown: str
    """Word beside the axis that is neither unit nor set, or several units."""


@dataclass(frozen=True, slots=True)
class _Layout:
    """Columns of a file's lines."""

    separator: str
    order: tuple[str, ...]
    """Meaning of each column: a word of `_COLUMN_WORDS`, `SIGMAS`, `EXPANDED` or `time`."""
    unit: LengthUnit | None = None
    """Unit that the file states for the coordinates."""
    sigma_unit: LengthUnit | None = None
    headings: tuple[str, ...] = ()
    """Headings of all columns; none without a header or with columns given."""
    header: tuple[_Line, ...] = ()
    """Lines that hold no points."""
    rows: tuple[_Line, ...] = ()


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
    lines = _filled_lines(text, "the file", "tracker.watch.")
    return tuple(line.text for line in lines[_first_row(lines) :] if _may_be_row(line))


def point_of_row(row: str, text: str, name: str, form: PointFormat) -> Vector3:
    """Return the point, mm, of one row of a file's text; the text's header goes before `form`.

    Raises `ShotsInvalid`.
    """
    lines = _filled_lines(text, name, form.option)
    header = lines[: _first_row(lines)]
    (point,) = _parse_lines([*header, _Line(name, row)], name, form, header_first=True).points
    return point.point_mm


def _first_row(lines: Sequence[_Line]) -> int:
    header = _find_header(lines)
    begin = 0 if header is None else header[0] + 1
    while begin < len(lines) and not _may_be_row(lines[begin]):
        begin += 1
    return begin


def _may_be_row(line: _Line) -> bool:
    return not line.is_comment and any(
        sum(map(_is_number, cells)) >= 2 for _, cells in _possible_splits(line.text)
    )


def _filled_lines(text: str, name: str, option: str) -> list[_Line]:
    if "\0" in text:
        number = text.count("\n", 0, text.index("\0")) + 1
        raise ShotsInvalid(
            f"{name}:{number}: has NUL characters, as UTF-16 without a byte-order mark",
            remedy=f"give {option}encoding utf-16, or save the file as plain text in UTF-8",
        )
    lines = []
    for number, line in enumerate(StringIO(text, newline=None), start=1):
        if line.strip():
            mark = _COMMENT.match(line.lstrip())
            content = line.lstrip().lstrip("#/;") if mark else line
            lines.append(_Line(f"{name}:{number}", content.strip(" \r\n"), mark is not None))
    return lines


def _parse_lines(
    lines: Sequence[_Line], name: str, form: PointFormat, *, header_first: bool = False
) -> PointFile:
    """Read lines; the unit of the file's header goes before that given if `header_first`."""
    if all(line.is_comment for line in lines):
        raise ShotsInvalid(f"{name}: holds no points", remedy="check that it is the right file")
    layout = _divide(lines, replace(form, unit=None) if header_first else form)
    unit = layout.unit or form.unit if header_first else form.unit or layout.unit
    if unit is None:
        raise ShotsInvalid(
            f"{name}: the file does not state its unit of length",
            remedy=f"give it with {form.option}unit {'|'.join(MM_PER_UNIT)}",
        )
    points = [_point(line, layout, replace(form, unit=unit)) for line in layout.rows]
    _check_unique(points)
    points, notes = _with_usable_columns(points, layout, name)
    columns = ", ".join(word for word in layout.order if word != "-")
    unused = [
        f"'{shown(text)}'"
        for text, word in zip(layout.headings, layout.order, strict=False)
        if word == "-" and text
    ]
    about = [
        f"{name}: {columns} by {_SEPARATORS[layout.separator]}, in {unit}"
        + (f"; not used: {', '.join(unused)}" if unused else "")
    ]
    if header := layout.header:
        quoted = ", ".join(f"'{shown(line.text)}'" for line in header[:3])
        count = "1 header line" if len(header) == 1 else f"{len(header)} header lines"
        about.append(f"{name}: {count} skipped: {quoted}{', …' if len(header) > 3 else ''}")
    if layout.unit not in {None, unit}:
        about.append(f"{name}: the header states {layout.unit}, {form.option}unit {unit} is used")
    return PointFile(name, tuple(points), unit, (*about, *notes))


def _split_line(line: str, separator: str) -> tuple[str, ...]:
    """Cut a line at a separator, or at blanks, as CSV with quotes."""
    text = line if separator else " ".join(line.split())
    with suppress(csv.Error):
        cells = next(csv.reader([text], delimiter=separator or " ", skipinitialspace=True))
        return tuple(cell.strip() for cell in cells)
    return (line,)


def _possible_splits(line: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each separator that a line may have, with the line cut there."""
    for separator in _SEPARATORS:
        if separator in line:
            yield separator, _split_line(line, separator)


def _heading(text: str) -> _Heading:
    """Return what a heading means: `X`, `x_mm`, `"X  [mm]"`, `Y act`, `U(95) Z [mm]`, `σx`."""
    words: list[str] = []
    for word in _WORD.findall(re.sub(r"(?<=[a-z])(?=[XYZ]\b)", " ", text)):  # coordX, dX
        glued = _AXIS_WORD.fullmatch(word)
        if glued and (not glued[3] or glued[3].lower() in _WORD_MEANINGS):
            words += [part for part in glued.groups() if part]
        else:
            words.append(word)
    words = [word if word == "U" else word.lower() for word in words]
    if "in" in words and len(_UNIT_WORDS.intersection(words)) > 1:
        words.remove("in")  # `X in mm`
    meanings = {_WORD_MEANINGS[word]: word for word in words if word in _WORD_MEANINGS}
    axes = [axis for axis in AXES if axis in meanings]
    units: list[LengthUnit] = [unit for unit in MM_PER_UNIT if unit in meanings]
    sets = [set_ for set_ in get_args(Coordinates) if set_ in meanings]
    unknown = [word for word in words if word not in _WORD_MEANINGS]
    if len(units) > 1:
        unknown.append(" ".join(units))
    role = "-"
    if len(axes) == 1 and not unknown:
        role = f"{'u' if 'expanded' in meanings else 's' if 'sigma' in meanings else ''}{axes[0]}"
    elif words and _TIME_WORDS.issuperset(words):
        role = "time"
    elif " ".join(words) in (*_GROUP_HEADINGS, *_NAME_HEADINGS):
        role = "name"
    return _Heading(
        text=text,
        words=tuple(words),
        axis=axes[0] if len(axes) == 1 else "",
        role=role,
        set_=sets[0] if sets else "",
        unit=units[0] if len(units) == 1 else None,
        unknown=unknown[0] if unknown else "",
    )


def _headings(line: str, separator: str) -> list[_Heading]:
    """Return the headings of a header line; a unit may stand in a cell of its own: `X, in`."""
    headings: list[_Heading] = []
    for cell in _split_line(line, separator):
        heading = _heading(cell)
        is_unit = bool(heading.words) and _UNIT_WORDS.issuperset(heading.words)
        if is_unit and headings and headings[-1].axis and not headings[-1].unit:
            headings[-1] = _heading(f"{headings[-1].text} {cell}")
        else:
            headings.append(heading)
    return headings


def _find_header(lines: Sequence[_Line]) -> tuple[int, str, list[_Heading]] | None:
    """Return the place of the first line that names X, Y and Z, its separator and headings.

    A comment must have the next row's number of columns, all with headings that are understood.
    """
    for place, line in enumerate(lines):
        if not all(axis in line.text.lower() for axis in AXES):
            continue
        next_row = next((other.text for other in lines[place:] if not other.is_comment), "")
        for separator, _ in _possible_splits(line.text):
            headings = _headings(line.text, separator)
            fits = not line.is_comment or (
                len(headings) == len(_split_line(next_row, separator))
                and all(heading.role != "-" for heading in headings)
            )
            if fits and {heading.axis for heading in headings} >= {*AXES}:
                return place, separator, headings
    return None


def _divide(lines: Sequence[_Line], form: PointFormat) -> _Layout:
    """Return the layout of a file's lines, with its header lines and its rows."""
    split = _find_header(lines)
    if split is None:
        return _divide_without_header(lines, form)
    place, separator, headings = split
    heading = lines[place]
    layout = _header_layout(separator, headings, form, heading.where)
    above = [line for line in lines[:place] if not line.is_comment]
    for line in above:
        if _has_point(line.text, layout):
            raise ShotsInvalid(
                f"{line.where}: '{shown(line.text)}' reads as a point above the header line "
                f"'{shown(heading.text)}'",
                remedy="put // before the line if it is a title, else before the header line",
            )
    rows = [
        line for line in lines[place + 1 :] if not line.is_comment and line.text != heading.text
    ]
    header = [*above, heading]
    if rows and (units := _unit_row(rows[0], layout)) is not None:
        stated = _common_unit(units, layout.order, form, rows[0].where)
        layout = replace(layout, unit=layout.unit or stated)
        header.append(rows.pop(0))
    if not rows:
        raise ShotsInvalid(
            f"{heading.where}: no points under the header line '{shown(heading.text)}'",
            remedy="check that it is the right file",
        )
    stated = _stated_unit(lines[:place])
    if form.unit is None and stated and layout.unit not in {None, stated}:
        raise ShotsInvalid(
            f"{heading.where}: the columns are in {layout.unit}, a line above states {stated}",
            remedy=f"correct the header, or give {form.option}unit",
        )
    unit = layout.unit or stated
    return replace(layout, unit=unit, header=tuple(header), rows=tuple(rows))


def _divide_without_header(lines: Sequence[_Line], form: PointFormat) -> _Layout:
    """Return the layout of a file whose columns have no names."""
    data = [line for line in lines if not line.is_comment]
    layout = _layout_of_data(data, form)
    begin = next((place for place, line in enumerate(data) if _has_point(line.text, layout)), 0)
    rows = data[begin:]
    layout = replace(layout, unit=_stated_unit(lines[: lines.index(rows[0])]))
    if form.columns is None:
        layout = replace(layout, order=_order_of_runs(rows, layout.separator, form))
        if begin:
            _check_other_headings(data[begin - 1], rows[0], layout, form)
    return replace(layout, header=tuple(data[:begin]), rows=tuple(rows))


def _check_other_headings(header: _Line, row: _Line, layout: _Layout, form: PointFormat) -> None:
    """Refuse headings above the numbers that do not name X, Y and Z: `R;Hz;V`, `dX;dY;dZ`."""
    headings = _headings(header.text.rstrip(layout.separator or None), layout.separator)
    cells = _split_line(row.text.rstrip(layout.separator or None), layout.separator)
    places = [layout.order.index(axis) for axis in AXES]
    if len(headings) == len(cells) and all(
        any(map(str.isalpha, headings[place].words)) for place in places
    ):
        raise ShotsInvalid(
            f"{header.where}: the header '{shown(header.text)}' does not name X, Y and Z",
            remedy=f"{form.columns_remedy}, or put // before the line if it is a title",
        )


def _stated_unit(lines: Sequence[_Line]) -> LengthUnit | None:
    """Return the unit of a line such as `Units: Millimeters`, None if it is not one unit."""
    matches = [_UNIT_LINE.match(line.text.lstrip(' "%!')) for line in lines]
    units = {_heading(match[1]).unit for match in matches if match}
    return units.pop() if len(units) == 1 else None


def _unit_row(row: _Line, layout: _Layout) -> list[_Heading] | None:
    """Return the cells of a line of units, or of dashes, under the headings; None for others."""
    cells = [*map(_heading, _split_line(row.text, layout.separator))]
    coordinates = [cell for cell, role in zip(cells, layout.order, strict=False) if role in AXES]
    has_digit = any(map(str.isdigit, row.text))
    return None if has_digit or any(c.words and not c.unit for c in coordinates) else cells


def _header_layout(
    separator: str, headings: Sequence[_Heading], form: PointFormat, where: str
) -> _Layout:
    """Return the layout that a header line states; raises `ShotsInvalid`."""
    if form.columns is not None:
        order, texts = [*_given_order(form, where)], []
    else:
        texts = [heading.text for heading in headings]
        order = ["-" if head.role in {*AXES, "name"} else head.role for head in headings]
        for axis, column in _coordinate_places(headings, form, where).items():
            order[column] = axis
        for column in _name_places(headings):
            order[column] = "name"
    unit = _common_unit(headings, order, form, where)
    sigma_unit = _common_unit(headings, order, form, where, (*SIGMAS, *EXPANDED))
    return _Layout(separator, tuple(order), unit, sigma_unit, tuple(texts))


def _given_order(form: PointFormat, where: str) -> tuple[str, ...]:
    """Return the columns that the user gives; raises `ShotsInvalid`."""
    columns = form.columns or ()
    name = where.rpartition(":")[0]
    for word in columns:
        if word not in _COLUMN_WORDS:
            raise ShotsInvalid(
                f"{name}: unknown column '{shown(word)}'", remedy=suggestion(word, _COLUMN_WORDS)
            )
    for axis in AXES:
        if columns.count(axis) != 1:
            raise ShotsInvalid(
                f"{name}: {form.option}columns {','.join(columns)} has {columns.count(axis)} "
                f"{axis}",
                remedy="give each of x, y and z once",
            )
    return tuple(columns)


def _coordinate_places(
    headings: Sequence[_Heading], form: PointFormat, where: str
) -> dict[str, int]:
    """Return the column of each axis, of the set that is measured; raises `ShotsInvalid`."""
    choose = f"{form.option}columns, for example name,-,-,-,x,y,z"
    sets: dict[str, dict[str, int]] = {}
    for place, heading in enumerate(headings):
        if heading.role in AXES:
            places = sets.setdefault(heading.set_, {})
            if heading.axis in places:
                raise ShotsInvalid(
                    f"{where}: the header has two columns '{shown(heading.text)}'",
                    remedy=f"choose with {choose}",
                )
            places[heading.axis] = place
    readable = {set_: places for set_, places in sets.items() if len(places) == len(AXES)}
    if not readable:
        unknown = next((heading.unknown for heading in headings if heading.axis), "")
        raise ShotsInvalid(
            f"{where}: '{shown(unknown)}' beside X Y Z in the header is no known unit"
            if unknown
            else f"{where}: the header does not name X, Y and Z of one set",
            remedy=f"write one of {', '.join(MM_PER_UNIT)}, or give {form.option}columns and "
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
    names = " and ".join(f"'{shown(headings[places['x']].text)}'" for places in readable.values())
    raise CoordinatesAmbiguous(
        f"{where}: the header has {len(readable)} sets of X Y Z, {names}"
        if len(readable) > 1
        else f"{where}: the header names nominal coordinates only, {names}",
        remedy=f"choose with {form.option}coordinates actual or nominal, or name the columns "
        f"with {choose}",
    )


def _name_places(headings: Sequence[_Heading]) -> list[int]:
    """Return the columns of a point's name: collection, group and name, else a running number."""
    texts = [" ".join(heading.words) for heading in headings]
    groups = [place for place, text in enumerate(texts) if text in _GROUP_HEADINGS]
    wanted = [name for name in _NAME_HEADINGS if groups or name != "target"]  # else a reflector
    names = [texts.index(name) for name in wanted if name in texts][:1]
    return [*groups, *names] if names else []


def _common_unit(
    headings: Sequence[_Heading],
    order: Sequence[str],
    form: PointFormat,
    where: str,
    roles: Sequence[str] = AXES,
) -> LengthUnit | None:
    """Return the unit of the columns with these roles, None if none is stated, or one is given."""
    units = [head.unit for head, role in zip(headings, order, strict=False) if role in roles]
    if len(set(units)) > 1 and (form.unit is None or roles != AXES):
        stated = ", ".join(str(unit or "none") for unit in units)
        raise ShotsInvalid(
            f"{where}: the header has several units: {stated}",
            remedy=f"correct the header, or give {form.option}unit if all are in one unit",
        )
    return units[0] if len(set(units)) == 1 else None


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


def _has_point(line: str, layout: _Layout) -> bool:
    """Whether numbers stand where a layout has coordinates."""
    cells = _split_line(line, layout.separator)
    if not layout.order:
        return _run(cells) is not None
    places = [layout.order.index(axis) for axis in AXES]
    return max(places) < len(cells) and all(_is_number(cells[place]) for place in places)


def _layout_of_data(lines: Sequence[_Line], form: PointFormat) -> _Layout:
    """Return the layout of the first line that has a point, in a file without column names."""
    first = lines[0]
    order = () if form.columns is None else _given_order(form, first.where)
    for line in lines:
        for separator, _ in _possible_splits(line.text):
            layout = _Layout(separator, order)
            if _has_point(line.text, layout):
                return layout
    if not order:
        raise _no_point(first)
    return _Layout(next(_possible_splits(first.text))[0], order)


def _run(cells: Sequence[str]) -> tuple[int, int] | None:
    """Return the start of the first run of at least three numbers and its length, else None."""
    start = 0
    for is_number, run in groupby(cells, _is_number):
        length = len([*run])
        if is_number and length >= len(AXES):
            return start, length
        start += length
    return None


def _no_point(line: _Line) -> ShotsInvalid:
    return ShotsInvalid(
        f"{line.where}: no X Y Z: '{shown(line.text)}' has no three numbers in a row",
        remedy="take the line out, or put // before it; if it is the header, put // before the "
        "lines above it",
    )


def _order_of_runs(lines: Sequence[_Line], separator: str, form: PointFormat) -> tuple[str, ...]:
    """Return name and X Y Z: the first run of three numbers, the same in every line.

    Of four numbers the first is a name if it is a whole number in every line.
    """
    table = [_split_line(line.text, separator) for line in lines]
    runs = [_run(cells) for cells in table]
    first = lines[0]
    for run, line in zip(runs, lines, strict=True):
        if run is None:
            raise _no_point(line)
        if run != runs[0]:
            raise ShotsInvalid(
                f"{line.where}: '{shown(line.text)}' has other columns than line "
                f"{first.where.rpartition(':')[2]}, '{shown(first.text)}'",
                remedy="correct the line, export with commas if names hold blanks, or "
                f"{form.columns_remedy}",
            )
    start, numbers = runs[0] or (0, 0)
    names_are_numbers = numbers == len(AXES) + 1 and all(
        _WHOLE.fullmatch(cells[start]) for cells in table
    )
    if names_are_numbers and separator in {",", ""} and start:
        joined = [(separator or " ").join(cells[start : start + 2]) for cells in table]
        if all(map(_GROUPED.fullmatch, joined)):
            raise ShotsInvalid(
                f"{first.where}: '{joined[0]}' may be a number with a thousands separator",
                remedy=f"export without thousands separators; else {form.columns_remedy}",
            )
    names = start + 1 if names_are_numbers else start
    if numbers > len(AXES) and not names_are_numbers:
        raise ShotsInvalid(
            f"{first.where}: {numbers} numbers in a row, X Y Z are three",
            remedy=form.columns_remedy,
        )
    if names > MOST_NAME_PARTS:
        raise ShotsInvalid(
            f"{first.where}: {names} words before X Y Z, a name has at most {MOST_NAME_PARTS}",
            remedy=form.columns_remedy,
        )
    return (*["name"] * names, *AXES)


def _point(line: _Line, layout: _Layout, form: PointFormat) -> NamedPoint:
    """Return the point of a line; raises `ShotsInvalid`."""
    where, cells = line.where, _split_line(line.text, layout.separator)
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
    columns = [*zip(layout.order, cells, strict=False)]
    texts = dict(columns)
    x, y, z = (_length_mm(f"{where}: {axis}", texts[axis], form) for axis in AXES)
    return NamedPoint(
        where,
        NAME_JOINT.join(text for role, text in columns if role == "name"),
        (x, y, z),
        _covariance_mm2(texts, layout, form),
        " ".join(text for role, text in columns if role == "time").strip("' ") or None,
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
            remedy=f"correct the line, or {form.columns_remedy}",
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
            return datetime.strptime(text.replace(",", "."), form).isoformat()  # noqa: DTZ007 - without a zone
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
