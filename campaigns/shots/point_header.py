"""Columns of point files: the user's options, and what a header line states.

A heading is cut into words: `X [mm]`, `x_mm`, `Y act`, `U(95) Z [mm]`, `σx`. One axis among them
makes it a coordinate or its uncertainty; the others are its unit and its set, nominal or actual.
"""

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, get_args

from campaigns.arrays import AXES
from campaigns.errors import ShotsInvalid
from campaigns.files.wording import shown, suggestion
from drivers.bounded_files import Encoding

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
Kind = Literal["point", "sigma", "expanded"]
DecimalSign = Literal["point", "comma"]
COLUMN_WORDS = ("name", "x", "y", "z", "-")
"""Columns that can be given: a name may have several parts, `-` skips a column."""
SIGMAS = ("sx", "sy", "sz")
EXPANDED = ("ux", "uy", "uz")
"""Columns of a header: standard uncertainties, and U(95), which are twice as large."""
SEPARATORS: Mapping[str, str] = {";": "semicolons", "\t": "tabs", ",": "commas", "": "blanks"}
_WORD = re.compile(r"[^\W\d_]+|\d+")
_AXIS_WORD = re.compile(r"(σ|sigma|s|u)?([xyz])(.*)")
_SIGMA_WORDS = frozenset({"σ", "sigma", "s", "std", "stdev", "rms", "uncertainty"})
_EXPANDED_WORDS = frozenset({"u", "95"})
_FILLING_WORDS = frozenset({"coordinate", "coord", "position", "pos", "value"})
_UNDERSTOOD = frozenset(
    {*AXES, *_UNITS_IN_HEADERS, *_SETS, *_SIGMA_WORDS, *_EXPANDED_WORDS, *_FILLING_WORDS}
)
_NAME_HEADINGS = ("name", "point name", "point id", "point", "id", "label")
_NUMBER_HEADINGS = ("no", "nr", "number", "seq", "index")
_TIME_WORDS = frozenset({"time", "stamp", "timestamp", "date", "datetime", "utc"})


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
class HeaderCell:
    """Heading of a column: its words, and what they mean of a coordinate."""

    words: tuple[str, ...]
    axis: str
    kind: Kind
    set_: Coordinates | Literal[""]
    unit: LengthUnit | None
    unknown: str
    """Word beside the axis that is neither unit nor set."""


@dataclass(frozen=True, slots=True)
class Layout:
    """Columns of a file's lines."""

    separator: str
    order: tuple[str, ...]
    """Meaning of each column: a word of `COLUMN_WORDS`, `SIGMAS`, `EXPANDED` or `time`."""
    unit: LengthUnit | None = None
    """Unit that the header states for the coordinates."""
    sigma_unit: LengthUnit | None = None
    width: int = 0
    """Number of the header's columns; 0 without a header."""


def split_line(line: str, separator: str) -> tuple[str, ...]:
    """Cut a line at a separator, or at blanks, as CSV with quotes."""
    text = line if separator else " ".join(line.split())
    with suppress(csv.Error):
        cells = next(csv.reader([text], delimiter=separator or " ", skipinitialspace=True))
        return tuple(cell.strip() for cell in cells)
    return (line,)


def possible_splits(line: str) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield each separator that a line may have, with the line cut there."""
    for separator in SEPARATORS:
        if separator in line:
            yield separator, split_line(line, separator)


def given_order(form: PointFormat, where: str) -> tuple[str, ...]:
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


def header_cell(text: str) -> HeaderCell:
    """Return what a heading means: `X`, `x_mm`, `"X  [mm]"`, `Y act`, `U(95) Z [mm]`, `σx`."""
    words: list[str] = []
    for word in _WORD.findall(text.lower()):
        glued = _AXIS_WORD.fullmatch(word)
        if glued and glued[3] in {"", *_UNITS_IN_HEADERS, *_SETS}:
            words += [part for part in glued.groups() if part]
        else:
            words.append(word)
    axes = [word for word in words if word in AXES]
    kind: Kind = "point"
    if _EXPANDED_WORDS.intersection(words):
        kind = "expanded"
    elif _SIGMA_WORDS.intersection(words):
        kind = "sigma"
    return HeaderCell(
        words=tuple(words),
        axis=axes[0] if len(axes) == 1 else "",
        kind=kind,
        set_=next((_SETS[word] for word in words if word in _SETS), ""),
        unit=next((_UNITS_IN_HEADERS[word] for word in words if word in _UNITS_IN_HEADERS), None),
        unknown=next((word for word in words if word not in _UNDERSTOOD), ""),
    )


def names_axes(cells: Sequence[str]) -> bool:
    """Whether headings name X, Y and Z."""
    return {cell.axis for cell in map(header_cell, cells) if cell.kind == "point"} >= {*AXES}


def header_layout(heading: str, form: PointFormat, where: str) -> Layout:
    """Return the layout that a header line states; raises `ShotsInvalid`."""
    separator, texts = next(each for each in possible_splits(heading) if names_axes(each[1]))
    cells = [*map(header_cell, texts)]
    if not separator:  # `X [mm] Y [mm]`: the blank before a bracket separates no columns
        cells = [*map(header_cell, split_line(re.sub(r"\s+(?=[\[(])", "", heading), ""))]
    if form.columns is not None:
        order = [*given_order(form, where), *["-"] * len(cells)][: len(cells)]
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
    unit = common_unit(cells, order, where)
    sigma_unit = common_unit(cells, order, where, (*SIGMAS, *EXPANDED))
    return Layout(separator, tuple(order), unit, sigma_unit, width=len(cells))


def _coordinate_places(
    cells: Sequence[HeaderCell], texts: Sequence[str], form: PointFormat, where: str
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


def _name_places(cells: Sequence[HeaderCell]) -> list[int]:
    """Return the columns of a point's name: collection, group and name, else a running number."""
    headings = [" ".join(cell.words) for cell in cells]
    groups = [place for place, text in enumerate(headings) if text in {"collection", "group"}]
    for names in (_NAME_HEADINGS, ("target",) if groups else (), _NUMBER_HEADINGS):
        for name in names:
            if name in headings:
                return [*groups, headings.index(name)]
    return []


def common_unit(
    cells: Sequence[HeaderCell], order: Sequence[str], where: str, roles: Sequence[str] = AXES
) -> LengthUnit | None:
    """Return the unit of the columns with these roles, None if none is stated."""
    units = [cell.unit for cell, role in zip(cells, order, strict=False) if role in roles]
    if len(set(units)) > 1:
        stated = ", ".join(str(unit or "none") for unit in units)
        raise ShotsInvalid(
            f"{where}: the header has several units: {stated}",
            remedy="export all coordinates in one unit",
        )
    return units[0] if units else None
