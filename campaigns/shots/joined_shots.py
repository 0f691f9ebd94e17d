"""Shots from two files: points of tracker software, and the joints at which they were measured.

The joints file is a CSV file `name,q0_deg,q1_deg,…`, optionally with `pair` and `set`; its rows are
the shots. Each gets its point by name or by its place in the file.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Literal, get_args

from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import CsvForm, CsvRow, parse_csv
from campaigns.files.text_file import read_text
from campaigns.files.wording import nearest_word, shown
from campaigns.mechanisms.mechanism import Mechanism
from campaigns.shots.ascii_points import (
    NAME_JOINT,
    LengthUnit,
    NamedPoint,
    PointFile,
    read_points,
)
from campaigns.shots.columns import (
    PairedRow,
    axis_columns,
    axis_values,
    check_pairs,
    pair_number,
    shot_set,
)
from campaigns.shots.pairs import SHOTS_OF_A_PAIR
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow
from drivers.bounded_files import CSV_BYTES

Join = Literal["name", "order"]
JOIN_WORDS = get_args(Join)
LISTED = 5
"""Number of names that an error line lists."""


@dataclass(frozen=True, slots=True)
class PointSource:
    """A file of points, and what its user says about it; see `campaigns.shots.ascii_points`."""

    path: Path
    unit: LengthUnit | None
    columns: tuple[str, ...] | None = None


@dataclass(frozen=True, slots=True)
class JoinedShots:
    """Shots in the order of the joints file, and how the files were understood."""

    rows: tuple[ShotRow, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _JointsRow:
    """Row of the joints file. `pair` is None where the file numbers none."""

    row: CsvRow
    name: str
    joints: tuple[float, ...]
    purpose: ShotSet
    pair: int | None


def read_joined_shots(
    points: PointSource, joints: Path, mechanism: Mechanism, *, join: Join
) -> JoinedShots:
    """Shots of both files; raises `ShotsInvalid`."""
    found = read_points(points.path, unit=points.unit, columns=points.columns)
    remedy = "check the name of the joints file"
    text = read_text(joints, ShotsInvalid, if_missing=remedy, most_bytes=CSV_BYTES)
    return join_shots(found, str(points.path), text, str(joints), mechanism, join=join)


def join_shots(
    points: PointFile,
    points_name: str,
    joints_text: str,
    joints_name: str,
    mechanism: Mechanism,
    *,
    join: Join,
) -> JoinedShots:
    """Shots of points and the text of a joints file; raises `ShotsInvalid`."""
    rows = _joints_rows(joints_text, joints_name, mechanism)
    if join == "order":
        matched = _by_order(points.points, points_name, rows)
    else:
        matched = _by_name(points.points, points_name, rows)
    pairs, pair_note = _pairs(rows)
    shots = tuple(
        ShotRow(pair, row.joints, point.point_mm, row.purpose)
        for row, point, pair in zip(rows, matched, pairs, strict=True)
    )
    return JoinedShots(shots, (f"{points_name}: {points.layout}", pair_note))


def _joints_rows(text: str, name: str, mechanism: Mechanism) -> tuple[_JointsRow, ...]:
    form = CsvForm(
        required=axis_columns(mechanism.joints),
        optional=("name", "pair", "set"),
        invalid=ShotsInvalid,
    )
    rows = tuple(_joints_row(row, mechanism) for row in parse_csv(text, name, form))
    if not rows:
        raise ShotsInvalid(f"{name}: holds no joints", remedy="check that it is the right file")
    return rows


def _joints_row(row: CsvRow, mechanism: Mechanism) -> _JointsRow:
    purpose = shot_set(row) if row.text("set") else ShotSet.IDENTIFICATION
    numbered = "pair" in row.texts
    pair = pair_number(row, purpose) if numbered else None
    joints = axis_values(row, mechanism.joints)
    return _JointsRow(row, row.text("name"), joints, purpose, pair)


def _by_order(
    points: Sequence[NamedPoint], points_name: str, rows: Sequence[_JointsRow]
) -> Sequence[NamedPoint]:
    if len(points) == len(rows):
        return points
    raise rows[-1].row.wrong(
        f"the last of {len(rows)} joints, but {points_name} holds {len(points)} points",
        remedy="join by name, or give both files one line a shot, in the same order",
    )


def _by_name(
    points: Sequence[NamedPoint], points_name: str, rows: Sequence[_JointsRow]
) -> Sequence[NamedPoint]:
    _check_named(points, points_name, rows)
    index = _names(points)
    missing = [row for row in rows if row.name not in index]
    _check_told_apart(index, rows)
    wanted = [index[row.name][0] for row in rows if row.name in index]
    taken = {point.name for point in wanted}
    spare = [point for point in points if point.name not in taken]
    if missing or spare:
        raise _unmatched(missing, spare, points_name, list(index))
    return wanted


def _check_named(
    points: Sequence[NamedPoint], points_name: str, rows: Sequence[_JointsRow]
) -> None:
    remedy = "name them, or use --join order when both files have the same order"
    seen: set[str] = set()
    if not points[0].name:
        raise ShotsInvalid(f"{points_name}: the points have no names", remedy=remedy)
    for each in rows:
        if not each.name:
            raise each.row.wrong("name is empty or missing", remedy=remedy)
        if each.name in seen:
            raise each.row.wrong(
                f"name '{shown(each.name)}' stands twice", remedy="give each shot its own point"
            )
        seen.add(each.name)


def _names(points: Sequence[NamedPoint]) -> dict[str, list[NamedPoint]]:
    """Points by their whole name and by what is left without its first parts."""
    index: defaultdict[str, list[NamedPoint]] = defaultdict(list)
    for point in points:
        parts = point.name.split(NAME_JOINT)
        for start in range(len(parts)):
            index[NAME_JOINT.join(parts[start:])].append(point)
    return index


def _check_told_apart(index: dict[str, list[NamedPoint]], rows: Sequence[_JointsRow]) -> None:
    for each in rows:
        named = index.get(each.name, [])
        if len(named) > 1:
            raise each.row.wrong(
                f"name '{shown(each.name)}' fits {len(named)} points: "
                f"{_listed([point.name for point in named])}",
                remedy="write the whole name, its parts joined by ::",
            )


def _unmatched(
    missing: Sequence[_JointsRow],
    spare: Sequence[NamedPoint],
    points_name: str,
    known: Sequence[str],
) -> ShotsInvalid:
    problems, remedy = [], "take them out, or add what belongs to them"
    if missing:
        names = _listed([each.name for each in missing])
        problems.append(f"{len(missing)} joints without a point in {points_name} ({names})")
        if nearest := nearest_word(missing[0].name, known):
            remedy = f"did you mean {nearest}? Else {remedy}"
    if spare:
        names = _listed([point.name for point in spare])
        problems.append(f"{len(spare)} points without joints ({names})")
    where = missing[0].row.where if missing else spare[0].where
    return ShotsInvalid(f"{where}: {'; '.join(problems)}", remedy=remedy)


def _listed(names: Sequence[str]) -> str:
    text = ", ".join(map(shown, names[:LISTED]))
    return f"{text} and {len(names) - LISTED} more" if len(names) > LISTED else text


def _pairs(rows: Sequence[_JointsRow]) -> tuple[Sequence[int | None], str]:
    """The pairs as numbered, or else each two shots of a set that follow one another."""
    if "pair" in rows[0].row.texts:
        check_pairs([PairedRow(each.row, each.purpose, each.pair) for each in rows])
        return [each.pair for each in rows], "pairs as numbered"
    numbers = count()
    last: dict[ShotSet, int] = {}
    pairs = [_next_pair(each.purpose, last, numbers) for each in rows]
    check_pairs(
        [PairedRow(each.row, each.purpose, pair) for each, pair in zip(rows, pairs, strict=True)]
    )
    return pairs, f"no column pair: each {SHOTS_OF_A_PAIR} shots of a set in a row are a pair"


def _next_pair(purpose: ShotSet, half: dict[ShotSet, int], numbers: "count[int]") -> int | None:
    if not purpose.in_pairs:
        return None
    if purpose in half:
        return half.pop(purpose)
    half[purpose] = next(numbers)
    return half[purpose]
