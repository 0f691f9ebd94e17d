"""Layout of a point file: which of its lines hold points, and what each of their columns is.

1. A line that names X, Y and Z is the header. It determines separator, columns and units, and which
   columns are uncertainties or times. A header in a comment counts if its columns match those of
   the first row. Under it may stand a line of units; above it, a line such as `Units: mm`.
2. Without a header the first line with three numbers in a row determines the separator. Words
   before these numbers are the point's name, and every line must have the form of the first.
3. Columns that the user gives are used instead of the file's.

What can be read in two ways is refused with both readings, never guessed: a wrong guess would give
points that look good, and a robot that is calibrated to them.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import NamedTuple

from campaigns.arrays import AXES
from campaigns.errors import CoordinatesAmbiguous, ShotsInvalid
from campaigns.files.cells import GROUPED, Notation, is_number, possible_splits, split_line
from campaigns.files.wording import shown, suggestion
from campaigns.shots.point_words import (
    MM_PER_UNIT,
    UNIT_LINE,
    Coordinates,
    Heading,
    LengthUnit,
    name_places,
    parse_heading,
    parse_headings,
)

SIGMAS = ("sx", "sy", "sz")
EXPANDED = ("ux", "uy", "uz")
"""Columns of a header: standard uncertainties, and U(95), which are twice as large."""
_COLUMN_WORDS = ("name", "x", "y", "z", "-")
"""Words for columns that users give: a name may have several parts, `-` skips a column."""
MOST_NAME_PARTS = 3
_WHOLE = re.compile(r"\d+", re.ASCII)


@dataclass(frozen=True, slots=True, kw_only=True)
class PointFormat(Notation):
    """What a user states of a point file; None in a field: the file has to show it."""

    unit: LengthUnit | None = None
    columns: Sequence[str] | None = None
    coordinates: Coordinates | None = None
    """Set of columns that counts where a file has nominal and actual coordinates."""
    option: str = "--"
    """Text before a field's name where users set it, for remedies: `--`, or a key in a file."""

    @property
    def columns_remedy(self) -> str:
        """Advice to name the columns."""
        return f"name the columns, for example {self.option}columns name,x,y,z"


class Line(NamedTuple):
    """Line of a file that is not empty, without its mark if it is a comment."""

    where: str
    """File and number of the line, for errors."""
    text: str
    is_comment: bool = False


@dataclass(frozen=True, slots=True)
class Layout:
    """Columns of a file's lines."""

    separator: str
    order: tuple[str, ...]
    """Meaning of each column: a word of `_COLUMN_WORDS`, `SIGMAS`, `EXPANDED` or `time`."""
    unit: LengthUnit | None = None
    """Unit that the file states for the coordinates; None: not stated."""
    sigma_unit: LengthUnit | None = None
    """Unit that the file states for uncertainties; None: that of the coordinates."""
    headings: tuple[str, ...] = ()
    """Headings of all columns; () without a header, or if the user gives the columns."""
    header: tuple[Line, ...] = ()
    """Lines before the first point that are no comments, with the header if it is one."""
    rows: tuple[Line, ...] = ()
    """Lines of points."""
    sigma_half_digit: float = 0.0
    """Half of the last digit of uncertainties, in their unit, which is what 0 stands for."""


def find_layout(lines: Sequence[Line], form: PointFormat) -> Layout:
    """Return the layout of a file's lines, with its header lines and its rows."""
    # 1. The header line and its columns; files without one are read by their numbers.
    header_found = find_header(lines)
    if header_found is None:
        return _layout_without_header(lines, form)
    place, separator, headings = header_found
    heading = lines[place]
    layout = _header_layout(separator, headings, form, heading.where)
    # 2. Lines above it are titles. One that reads as a point would be lost without a word.
    above = [line for line in lines[:place] if not line.is_comment]
    for line in above:
        if _has_point(line.text, layout):
            raise ShotsInvalid(
                f"{line.where}: '{shown(line.text)}' reads as a point above the header line "
                f"'{shown(heading.text)}'",
                remedy="put // before the line if it is a title, else before the header line",
            )
    # 3. Lines under it are points, but for a line of units, and for the header repeated, as in
    #    files that were put together.
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
    # 4. The unit: of the headings or the line under them, else of a line above. Contradictions are
    #    refused, unless the user gives the unit.
    stated = _stated_unit(lines[:place])
    if form.unit is None and stated and layout.unit not in {None, stated}:
        raise ShotsInvalid(
            f"{heading.where}: the columns are in {layout.unit}, a line above states {stated}",
            remedy=f"correct the header, or give {form.option}unit",
        )
    unit = layout.unit or stated
    return replace(layout, unit=unit, header=tuple(header), rows=tuple(rows))


# A comment is a header only if it fits the next row exactly, for titles in comments name axes too:
# `// X, Y, Z in the working frame`.
def find_header(lines: Sequence[Line]) -> tuple[int, str, list[Heading]] | None:
    """Return the place of the first line that names X, Y and Z, its separator and headings.

    Return None if there is none. A comment must have the next row's number of columns, all with
    headings that are understood.
    """
    for place, line in enumerate(lines):
        if not all(axis in line.text.lower() for axis in AXES):
            continue
        next_row = next((other.text for other in lines[place:] if not other.is_comment), "")
        for separator, _ in possible_splits(line.text):
            headings = parse_headings(line.text, separator)
            fits = not line.is_comment or (
                len(headings) == len(split_line(next_row, separator))
                and all(heading.role != "-" for heading in headings)
            )
            if fits and {heading.axis for heading in headings} >= {*AXES}:
                return place, separator, headings
    return None


def _header_layout(
    separator: str, headings: Sequence[Heading], form: PointFormat, where: str
) -> Layout:
    """Return the layout that a header line states; raises `ShotsInvalid`."""
    if form.columns is not None:
        order, texts = [*_order_of_user(form, where)], []
    else:
        texts = [heading.text for heading in headings]
        # Uncertainties and times are as their headings say. Of coordinates one set is chosen, of
        # names one column or one for each part: the others are left unused.
        order = ["-" if head.role in {*AXES, "name"} else head.role for head in headings]
        for axis, column in _coordinate_places(headings, form, where).items():
            order[column] = axis
        for column in name_places(headings):
            order[column] = "name"
    unit = _common_unit(headings, order, form, where)
    sigma_unit = _common_unit(headings, order, form, where, (*SIGMAS, *EXPANDED))
    return Layout(separator, tuple(order), unit, sigma_unit, tuple(texts))


def _order_of_user(form: PointFormat, where: str) -> tuple[str, ...]:
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
    headings: Sequence[Heading], form: PointFormat, where: str
) -> dict[str, int]:
    """Return the column of each axis, of the set that is measured; raises `ShotsInvalid`."""
    choose = f"{form.option}columns, for example name,-,-,-,x,y,z"
    # 1. Sort the columns of coordinates by set, each set with one column an axis at most.
    sets: dict[str, dict[str, int]] = {}
    for place, heading in enumerate(headings):
        if heading.role in AXES:
            places = sets.setdefault(heading.coordinates, {})
            if heading.axis in places:
                raise ShotsInvalid(
                    f"{where}: the header has two columns '{shown(heading.text)}'",
                    remedy=f"choose with {choose}",
                )
            places[heading.axis] = place
    # 2. Only whole sets can be read. If there is none that is understood, headings alike but for
    #    the axis are one.
    readable = {name: places for name, places in sets.items() if len(places) == len(AXES)}
    readable = readable or _alike_places(headings)
    if not readable:
        unknown = next((heading.unknown for heading in headings if heading.axis), "")
        raise ShotsInvalid(
            f"{where}: '{shown(unknown)}' beside X Y Z in the header is no known unit"
            if unknown
            else f"{where}: the header does not name X, Y and Z of one set",
            remedy=f"write one of {', '.join(MM_PER_UNIT)}, or give {form.option}columns and "
            f"{form.option}unit",
        )
    # 3. Beside a named set one without a name is the other of the two.
    if set(readable) == {"", "nominal"}:
        readable["actual"] = readable.pop("")
    if set(readable) == {"", "actual"}:
        readable["nominal"] = readable.pop("")
    # 4. The user's choice, or the only set there is. Nominal coordinates are never taken unasked:
    #    they are what was wanted, not what was measured.
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


def _alike_places(headings: Sequence[Heading]) -> dict[str, dict[str, int]]:
    """Return the columns of headings alike but for the axis, by set; {} if a set has several."""
    sets: dict[str, dict[str, dict[str, int]]] = {}
    for place, heading in enumerate(headings):
        if heading.alike and heading.role == "-":
            alike = sets.setdefault(heading.coordinates, {}).setdefault(heading.alike, {})
            alike[heading.axis] = place
    if any(len(alike) > 1 for alike in sets.values()):
        return {}
    return {name: places for name, alike in sets.items() for places in alike.values()}


def _common_unit(
    headings: Sequence[Heading],
    order: Sequence[str],
    form: PointFormat,
    where: str,
    roles: Sequence[str] = AXES,
) -> LengthUnit | None:
    """Return the unit of the columns with these roles, None if none is stated, or several are.

    Several units are refused, unless they are of coordinates and the user gives the unit: raise
    `ShotsInvalid`.
    """
    units = [head.unit for head, role in zip(headings, order, strict=False) if role in roles]
    if len(set(units)) > 1 and (form.unit is None or roles != AXES):
        stated = ", ".join(str(unit or "none") for unit in units)
        raise ShotsInvalid(
            f"{where}: the header has several units: {stated}",
            remedy=f"correct the header, or give {form.option}unit if all are in one unit",
        )
    return units[0] if len(set(units)) == 1 else None


def _stated_unit(lines: Sequence[Line]) -> LengthUnit | None:
    """Return the unit of a line such as `Units: Millimeters`, None if it is not one unit."""
    matches = [UNIT_LINE.match(line.text.lstrip(' "%!')) for line in lines]
    units = {parse_heading(match[1]).unit for match in matches if match}
    return units.pop() if len(units) == 1 else None


def _unit_row(row: Line, layout: Layout) -> list[Heading] | None:
    """Return the cells of a line of units, or of dashes, under the headings; None for others."""
    # Such a line has no digit, and under each coordinate a unit or nothing that is a word.
    cells = [*map(parse_heading, split_line(row.text, layout.separator))]
    coordinates = [cell for cell, role in zip(cells, layout.order, strict=False) if role in AXES]
    has_digit = any(map(str.isdigit, row.text))
    return None if has_digit or any(c.words and not c.unit for c in coordinates) else cells


def _layout_without_header(lines: Sequence[Line], form: PointFormat) -> Layout:
    """Return the layout of a file whose columns have no names."""
    # 1. The separator by the first line that has a point; lines before that are titles.
    data = [line for line in lines if not line.is_comment]
    layout = _layout_of_data(data, form)
    begin = next((place for place, line in enumerate(data) if _has_point(line.text, layout)), 0)
    rows = data[begin:]
    # 2. The unit by a line above; the order of columns by the user, or else by the numbers. The
    #    last title may be a header with other axes, whose numbers must not be taken for X Y Z.
    layout = replace(layout, unit=_stated_unit(lines[: lines.index(rows[0])]))
    if form.columns is None:
        layout = replace(layout, order=_order_by_runs(rows, layout.separator, form))
        if begin:
            _check_other_headings(data[begin - 1], rows[0], layout, form)
    return replace(layout, header=tuple(data[:begin]), rows=tuple(rows))


def _layout_of_data(lines: Sequence[Line], form: PointFormat) -> Layout:
    """Return the layout of the first line that has a point, in a file without column names."""
    first = lines[0]
    order = () if form.columns is None else _order_of_user(form, first.where)
    # Separators are tried from the least ambiguous one: blanks last, which stand in names as well.
    # Where commas would leave blanks in numbers, `510,112 135,487`, the blanks are the borders.
    for line in lines:
        fitting = {
            separator: any(is_number(cell) and " " in cell for cell in cells)
            for separator, cells in possible_splits(line.text)
            if _has_point(line.text, Layout(separator, order))
        }
        if fitting:
            separator, has_blanks = next(iter(fitting.items()))
            by_blanks = separator == "," and has_blanks and "" in fitting
            return Layout("" if by_blanks else separator, order)
    if not order:
        raise _no_point(first)
    return Layout(next(possible_splits(first.text))[0], order)


def _has_point(line: str, layout: Layout) -> bool:
    """Return whether numbers stand where a layout has coordinates."""
    cells = split_line(line, layout.separator)
    if not layout.order:
        return _run_of_numbers(cells) is not None
    places = [layout.order.index(axis) for axis in AXES]
    return max(places) < len(cells) and all(is_number(cells[place]) for place in places)


def _run_of_numbers(cells: Sequence[str]) -> tuple[int, int] | None:
    """Return the start of the first run of at least three numbers and its length, else None."""
    start = 0
    for are_numbers, run in groupby(cells, is_number):
        length = len([*run])
        if are_numbers and length >= len(AXES):
            return start, length
        start += length
    return None


def _no_point(line: Line) -> ShotsInvalid:
    return ShotsInvalid(
        f"{line.where}: no X Y Z: '{shown(line.text)}' has no three numbers in a row",
        remedy="take the line out, or put // before it; if it is the header, put // before the "
        "lines above it",
    )


def _order_by_runs(lines: Sequence[Line], separator: str, form: PointFormat) -> tuple[str, ...]:
    """Return name and X Y Z: the first run of three numbers, the same in every line.

    Of four numbers the first is a name if it is a whole number in every line.
    """
    table = [split_line(line.text, separator) for line in lines]
    where = lines[0].where
    names, numbers = _common_run(lines, table, form)
    if numbers == len(AXES) + 1 and all(_WHOLE.fullmatch(cells[names]) for cells in table):
        _check_split_numbers(table, names, separator, where, form)
        names += 1
    elif numbers > len(AXES):
        raise ShotsInvalid(
            f"{where}: {numbers} numbers in a row, X Y Z are three", remedy=form.columns_remedy
        )
    if names > MOST_NAME_PARTS:
        raise ShotsInvalid(
            f"{where}: {names} words before X Y Z, a name has at most {MOST_NAME_PARTS}",
            remedy=form.columns_remedy,
        )
    return (*["name"] * names, *AXES)


def _common_run(
    lines: Sequence[Line], table: Sequence[Sequence[str]], form: PointFormat
) -> tuple[int, int]:
    """Return start and length of the run of numbers that all lines, cut into cells, have.

    Raise `ShotsInvalid` for a line without one, or with its numbers in other columns.
    """
    first = lines[0]
    common = _run_of_numbers(table[0])
    if common is None:
        raise _no_point(first)
    for line, cells in zip(lines, table, strict=True):
        run = _run_of_numbers(cells)
        if run is None:
            raise _no_point(line)
        if run != common:
            raise ShotsInvalid(
                f"{line.where}: '{shown(line.text)}' has other columns than line "
                f"{first.where.rpartition(':')[2]}, '{shown(first.text)}'",
                remedy="correct the line, export with commas if names hold blanks, or "
                f"{form.columns_remedy}",
            )
    return common


def _check_split_numbers(
    table: Sequence[Sequence[str]], names: int, separator: str, where: str, form: PointFormat
) -> None:
    """Raise `ShotsInvalid` if, in every line, a name and X may be halves of one number."""
    # Where commas or blanks separate, `p1,2,927.032,…` is point p1::2, or 2927.032 in p1.
    if separator not in {",", ""} or not names:
        return
    joined = [(separator or " ").join(cells[names : names + 2]) for cells in table]
    if all(map(GROUPED.fullmatch, joined)):
        raise ShotsInvalid(
            f"{where}: '{joined[0]}' may be a number with a thousands separator",
            remedy=f"export without thousands separators; else {form.columns_remedy}",
        )


def _check_other_headings(header: Line, row: Line, layout: Layout, form: PointFormat) -> None:
    """Refuse headings above the numbers that do not name X, Y and Z: `R;Hz;V`, `dX;dY;dZ`."""
    headings = parse_headings(header.text.rstrip(layout.separator or None), layout.separator)
    cells = split_line(row.text.rstrip(layout.separator or None), layout.separator)
    places = [layout.order.index(axis) for axis in AXES]
    if len(headings) == len(cells) and all(
        any(map(str.isalpha, headings[place].words)) for place in places
    ):
        raise ShotsInvalid(
            f"{header.where}: the header '{shown(header.text)}' does not name X, Y and Z",
            remedy=f"{form.columns_remedy}, or put // before the line if it is a title",
        )
