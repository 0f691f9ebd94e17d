"""Words of point files: the meanings of headings.

Software names the columns of points in many ways, so a heading is not looked up whole but cut into
words: `X [mm]`, `x_mm`, `Y act`, `U(95) Z [mm]`, `σx`. Each word has one meaning (an axis, a unit,
nominal or actual, an uncertainty) or none. A heading with exactly one axis and no word without a
meaning is a coordinate, or its uncertainty; a word that is not understood may change what a column
is (`dX`), so its column is never taken for one beside others that are understood. Where none are,
three headings alike but for the letters x, y and z are coordinates in any language: `X-Koordinate`,
`point.x`. All other headings are names, times or unused.
"""

import re
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import Literal, get_args

from campaigns.arrays import AXES
from campaigns.files.cells import split_line

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
"""Headings of the first parts of a name, as SpatialAnalyzer has them."""
_NAME_HEADINGS = (
    *("name", "point name", "pointname", "point id", "pointid", "point", "id", "label"),
    *("punktname", "punktnummer", "punkt", "pt", "target"),
    *("no", "nr", "number", "seq", "index"),
)
"""Headings of a point's name, the most certain first."""
_TIME_WORDS = frozenset({"time", "stamp", "timestamp", "date", "datetime", "utc"})
UNIT_LINE = re.compile(
    r"(?:(?:lengths?|linear|distances?|coordinates?)\W*)?(?:units?|einheit(?:en)?)\b(.*)", re.I
)
_BRACKETS = re.compile(r"[\[(]")
_WORD = re.compile(r"[^\W\d_]+|\d+")
_AXIS_WORD = re.compile(r"(σ|sigma|s|u)?([xyz])(.*)", re.I)


@dataclass(frozen=True, slots=True)
class Heading:
    """Heading of a column, and what its words mean of a coordinate."""

    text: str
    words: tuple[str, ...]
    axis: str
    role: str
    """Meaning as in a layout's `order`."""
    coordinates: str
    """Set of coordinates: `actual`, `nominal`, or empty if none is named."""
    unit: LengthUnit | None
    """Unit in the heading; None for none, or for several."""
    unknown: str
    """Word beside the axis that is neither unit nor set, or several units; "" for none."""
    alike: str = ""
    """Text with `*` for the axis, where two others differ from it by the axis alone; else ""."""


def parse_heading(text: str) -> Heading:
    """Return what a heading means: `X`, `x_mm`, `"X  [mm]"`, `Y act`, `U(95) Z [mm]`, `σx`."""
    words = _heading_words(text)
    meanings = {_WORD_MEANINGS[word] for word in words if word in _WORD_MEANINGS}
    axes = [axis for axis in AXES if axis in meanings]
    units: list[LengthUnit] = [unit for unit in MM_PER_UNIT if unit in meanings]
    unknown = [word for word in words if word not in _WORD_MEANINGS]
    if len(units) > 1:
        unknown.append(" ".join(units))
    axis = axes[0] if len(axes) == 1 else ""
    is_coordinate = bool(axis) and not unknown
    return Heading(
        text=text,
        words=words,
        axis=axis,
        role=_uncertainty_prefix(meanings) + axis if is_coordinate else _role_of_words(words),
        coordinates=next((word for word in get_args(Coordinates) if word in meanings), ""),
        unit=units[0] if len(units) == 1 else None,
        unknown=unknown[0] if unknown else "",
    )


def _heading_words(text: str) -> tuple[str, ...]:
    """Cut a heading into words: runs of letters or of digits, an axis glued to others cut off."""
    words: list[str] = []
    for word in _WORD.findall(re.sub(r"(?<=[a-z])(?=[XYZ]\b)", " ", text)):  # coordX, dX
        glued = _AXIS_WORD.fullmatch(word)  # Xmm, σx
        if glued and (not glued[3] or glued[3].lower() in _WORD_MEANINGS):
            words += [part for part in glued.groups() if part]
        else:
            words.append(word)
    # Case matters for one word alone: U is an expanded uncertainty, u a standard one.
    words = [word if word == "U" else word.lower() for word in words]
    if "in" in words and len(_UNIT_WORDS.intersection(words)) > 1:
        words.remove("in")  # inch, unless another unit stands beside it: `X in mm`
    return tuple(words)


def _uncertainty_prefix(meanings: Set[str]) -> str:
    """Return the letter before the axis in the role of an uncertainty; "" for a coordinate."""
    if "expanded" in meanings:  # also `U(95)`, of which both words have this meaning
        return "u"
    return "s" if "sigma" in meanings else ""


def _role_of_words(words: Sequence[str]) -> str:
    """Return the role of a column that is no coordinate: `time`, `name`, or `-` for unused."""
    if words and _TIME_WORDS.issuperset(words):
        return "time"
    return "name" if " ".join(words) in (*_GROUP_HEADINGS, *_NAME_HEADINGS) else "-"


def parse_headings(line: str, separator: str) -> list[Heading]:
    """Return the headings of a header line; a unit may stand in a cell of its own: `X, in`."""
    headings: list[Heading] = []
    for cell in split_line(line, separator):
        heading = parse_heading(cell)
        is_unit = bool(heading.words) and _UNIT_WORDS.issuperset(heading.words)
        if is_unit and headings and headings[-1].axis and not headings[-1].unit:
            headings[-1] = parse_heading(f"{headings[-1].text} {cell}")
        else:
            headings.append(heading)
    return _with_alike(headings)


def _with_alike(headings: Sequence[Heading]) -> list[Heading]:
    """Return headings with what those have in common that are alike but for x, y and z."""
    # A letter before the axis makes another quantity of it (dX, RotX), whatever the language, and a
    # unit in brackets must be a known one.
    texts = [
        heading.text.casefold() if heading.unit or not _BRACKETS.search(heading.text) else ""
        for heading in headings
    ]
    common: dict[str, tuple[str, str]] = {}
    for text in texts:
        for place, letter in enumerate(text):
            if letter != "x" or text[:place][-1:].isalpha():
                continue
            alike = [f"{text[:place]}{axis}{text[place + 1 :]}" for axis in AXES]
            if all(texts.count(other) == 1 for other in alike):
                pattern = f"{text[:place]}*{text[place + 1 :]}"
                common |= {other: (axis, pattern) for other, axis in zip(alike, AXES, strict=True)}
    return [
        replace(heading, axis=common[text][0], alike=common[text][1]) if text in common else heading
        for heading, text in zip(headings, texts, strict=True)
    ]


def name_places(headings: Sequence[Heading]) -> list[int]:
    """Return the columns of a point's name: collection, group and name, else a running number."""
    texts = [" ".join(heading.words) for heading in headings]
    groups = [place for place, text in enumerate(texts) if text in _GROUP_HEADINGS]
    # Beside a collection or group a target is a point; alone it is the kind of reflector.
    usable = [name for name in _NAME_HEADINGS if groups or name != "target"]
    names = [texts.index(name) for name in usable if name in texts][:1]
    # groups without a name would give all points of a group the same name
    return [*groups, *names] if names else []
