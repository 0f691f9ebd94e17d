"""Shots from two files: points of tracker software, and the joints at which they were measured.

The joints file is a shots.csv without points, but with names: `name,q0_deg,q1_deg,…`. Its rows are
the shots, and each gets its point:

- By name. SpatialAnalyzer's names have parts, `collection::group::point`, of which a user may write
  the last ones alone, as long as they fit one point only.
- By order, if the user says so. Then only the numbers of points and rows are compared.

A point at the wrong joints would be a gross error in the fit. So every row must find exactly one
point, and no point may be left over: either is refused, with the names on both sides.

Last come pairs: as numbered in the joints file, else each two shots of a set in a row.
"""

from collections import Counter, defaultdict
from collections.abc import Sequence, Set
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Literal

from campaigns.errors import ShotsInvalid
from campaigns.files.cells import Notation
from campaigns.files.csv_file import CsvRow
from campaigns.files.wording import listed, shown
from campaigns.kinematics.mechanism import Mechanism
from campaigns.shots.columns import check_pairs
from campaigns.shots.point_files import NAME_JOINT, NamedPoint, PointFile
from campaigns.shots.shot_sets import SHOTS_OF_A_PAIR, ShotSet
from campaigns.shots.shots_csv import (
    PLAIN,
    ShotRow,
    joints_rows,
    names_joints,
    table_text,
    with_iso_times,
)
from campaigns.shots.turn_forms import TurnForm
from drivers.bounded_files import (
    CSV_BYTES,
    Encoding,
    FileRefused,
    check_is_text,
    codec_of,
    read_bounded,
)
from drivers.texts import nearest_word

Join = Literal["name", "order"]
MISSING = "missing"
"""Word of `--skip` for all shots without a point."""
LISTED = 5
"""Number of names that an error line lists."""
JointsRow = tuple[CsvRow, ShotRow]
"""Row of the joints file, and its shot without a point. The pair is None if the file has none."""


def join_shots(
    points: PointFile,
    joints: Path,
    mechanism: Mechanism,
    *,
    join: Join,
    default: ShotSet = ShotSet.IDENTIFICATION,
    turns: TurnForm | None = None,
) -> tuple[tuple[ShotRow, ...], str]:
    """Return the shots in the order of the joints file, and a note on names and pairs.

    `default` is the set of rows that name none, `turns` how the joints file writes three turns.
    Raises `ShotsInvalid`.
    """
    return join_rows(points, read_joints(joints, mechanism, default, turns), join)


def join_rows(
    points: PointFile, rows: Sequence[JointsRow], join: Join, skipped: Set[str] = frozenset()
) -> tuple[tuple[ShotRow, ...], str]:
    """Return the shots in the order of the rows of a joints file, and a note on their pairs.

    `skipped` are the names of shots that are left out, from `skipped_names`. Raise `ShotsInvalid`.
    """
    # Covariance and time of the point file are the tracker's own, so they are used before those
    # that a user may have written beside the joints.
    all_pairs, note = _pairs(rows)
    kept = [place for place, (row, _) in enumerate(rows) if row.text("name") not in skipped]
    rows, pairs = [rows[place] for place in kept], [all_pairs[place] for place in kept]
    if not rows:
        raise ShotsInvalid(f"{points.name}: --skip leaves no shot", remedy="skip fewer")
    named, heading = (points.points, None) if join == "order" else _named(points, rows)
    if heading is not None:
        note = f"names by column '{shown(heading)}', which has those of the joints; {note}"
    present = [point for point in named if skipped.isdisjoint(_names_of(point))]
    matching = _by_order if join == "order" else _by_name
    matched = matching(present, points.name, rows)
    shots = tuple(
        replace(
            shot,
            pair=pair,
            point_in_tracker_mm=point.point_mm,
            covariance_mm2=point.covariance_mm2 or shot.covariance_mm2,
            time=point.time or shot.time,
        )
        for (_, shot), point, pair in zip(rows, matched, pairs, strict=True)
    )
    return shots, note


def skipped_names(
    points: PointFile, rows: Sequence[JointsRow], asked: Sequence[str]
) -> tuple[str, ...]:
    """Return the names of the shots to leave out, the other one of each pair too, in their order.

    `asked` are names of the joints file, the numbers of `shotN`, or `missing`: all without a point.
    Raise `ShotsInvalid` for a name that the joints file does not have.
    """
    names, (pairs, _) = [row.text("name") for row, _ in rows], _pairs(rows)
    wanted = set[str]()
    if MISSING in asked:
        present = {name for point in points.points for name in _names_of(point)}
        wanted |= {name for name in names if name not in present}
    for word in asked:
        fitting = {name for name in (word, f"shot{word}") if name in names}
        if word != MISSING and not fitting:
            raise ShotsInvalid(
                f"--skip {shown(word)}: the joints file has no such shot",
                remedy=f"give a name of its column name, or {MISSING} for all without a point",
            )
        wanted |= fitting
    halved = {pair for pair, name in zip(pairs, names, strict=True) if name in wanted} - {None}
    return tuple(
        name for pair, name in zip(pairs, names, strict=True) if name in wanted or pair in halved
    )


def read_joints(
    joints: Path,
    mechanism: Mechanism,
    default: ShotSet,
    turns: TurnForm | None = None,
    notation: Notation = PLAIN,
) -> list[JointsRow]:
    """Return the rows of a joints file; raise `ShotsInvalid`, also for a file without any."""
    text = table_text(joints, notation, "check the name of the joints file")
    rows = [*joints_rows(text, str(joints), mechanism, default, turns, notation.decimal)]
    if not rows:
        raise ShotsInvalid(f"{joints}: holds no joints", remedy="check that it is the right file")
    shots = with_iso_times([shot for _, shot in rows])
    return [(row, shot) for (row, _), shot in zip(rows, shots, strict=True)]


def holds_joints(path: Path, mechanism: Mechanism, encoding: Encoding | None = None) -> bool:
    """Return whether the first line of a file names columns that only shots.csv has.

    Raise `ShotsInvalid` for a file that is no text.
    """
    try:
        data = read_bounded(path, CSV_BYTES)
    except FileRefused:
        return True  # the reader of shots.csv then reports why the file cannot be read
    try:
        check_is_text(data, str(path))
    except FileRefused as error:
        raise ShotsInvalid(error.problem, remedy=error.remedy) from error
    with suppress(ShotsInvalid):
        return names_joints(data.decode(codec_of(data, encoding), errors="replace"), mechanism)
    return False


def _by_order(
    points: Sequence[NamedPoint], points_name: str, rows: Sequence[JointsRow]
) -> Sequence[NamedPoint]:
    """Return the points in their order if there is one for each row; raise `ShotsInvalid`."""
    if len(points) == len(rows):
        return points
    raise rows[-1][0].wrong(
        f"the last of {len(rows)} joints, but {points_name} holds {len(points)} points",
        remedy="join by name, or give both files one line a shot, in the same order",
    )


def _named(points: PointFile, rows: Sequence[JointsRow]) -> tuple[Sequence[NamedPoint], str | None]:
    """Return points with the names of the joints, and the heading of the column that has them.

    The heading is None if the file's names are the joints', or no column has them.
    """
    # Whatever its heading, the one column that holds each name of the joints once is the name.
    names = [row.text("name") for row, _ in rows]
    index = _index_by_name(points.points)
    fitting = [
        heading
        for heading, texts in points.unused.items()
        if all(texts.count(name) == 1 for name in names)
    ]
    if len(fitting) != 1 or all(name in index for name in names):
        return points.points, None
    texts = points.unused[fitting[0]]
    renamed = [replace(p, name=text) for p, text in zip(points.points, texts, strict=True)]
    return renamed, fitting[0]


def _by_name(
    points: Sequence[NamedPoint], points_name: str, rows: Sequence[JointsRow]
) -> Sequence[NamedPoint]:
    """Return the point of each row by its name; raise `ShotsInvalid`."""
    _check_named(points, points_name, rows)
    index, named = _index_by_name(points), [(row, row.text("name")) for row, _ in rows]
    missing = [(row, name) for row, name in named if name not in index]
    # 1. A name that fits several points decides nothing.
    for row, name in named:
        if len(fitting := index.get(name, [])) > 1:
            raise row.wrong(
                f"name '{shown(name)}' fits {len(fitting)} points: "
                f"{_listed([point.name for point in fitting])}",
                remedy="write the whole name, its parts joined by ::",
            )
    # 2. Rows without a point and points without a row are reported together: most often they are
    #    one misspelt name, seen from both sides.
    matched = [index[name][0] for _, name in named if name in index]
    matched_names = {point.name for point in matched}
    spare = [point for point in points if point.name not in matched_names]
    if missing or spare:
        raise _unmatched(missing, spare, points_name, list(index))
    return matched


def _check_named(points: Sequence[NamedPoint], points_name: str, rows: Sequence[JointsRow]) -> None:
    """Raise `ShotsInvalid` if points or rows lack names, or two rows have one name."""
    remedy = "name them, or use --join order when both files have the same order"
    seen: set[str] = set()
    if not points[0].name:
        raise ShotsInvalid(f"{points_name}: the points have no names", remedy=remedy)
    for row, _ in rows:
        name = row.text("name")
        if not name:
            raise row.wrong("name is empty or missing", remedy=remedy)
        if name in seen:
            raise row.wrong(
                f"name '{shown(name)}' stands twice", remedy="give each shot its own point"
            )
        seen.add(name)


def _index_by_name(points: Sequence[NamedPoint]) -> dict[str, list[NamedPoint]]:
    """Index points by their whole name and by its last parts."""
    index: defaultdict[str, list[NamedPoint]] = defaultdict(list)
    for point in points:
        for name in _names_of(point):
            index[name].append(point)
    return index


def _names_of(point: NamedPoint) -> list[str]:
    """Return the names that a user may write for a point: its whole name, and its last parts."""
    parts = point.name.split(NAME_JOINT)
    return [NAME_JOINT.join(parts[start:]) for start in range(len(parts))]


def _unmatched(
    missing: Sequence[tuple[CsvRow, str]],
    spare: Sequence[NamedPoint],
    points_name: str,
    point_names: Sequence[str],
) -> ShotsInvalid:
    """Return the error that names rows without points and points without rows."""
    problems, remedy = [], "take them out, or add what belongs to them"
    if missing and len(missing) == len(spare):
        remedy = f"if both files have the same order, give --join order; else {remedy}"
    if missing:
        names = _listed([name for _, name in missing])
        problems.append(f"{len(missing)} joints without a point in {points_name} ({names})")
        if not spare:
            remedy = (
                f"--skip {MISSING} imports what is there, without the other shots of their pairs; "
                "or add the points"
            )
        elif nearest := nearest_word(missing[0][1], point_names):
            remedy = f"did you mean {nearest}? Else {remedy}"
    if spare:
        names = _listed([point.name for point in spare])
        problems.append(f"{len(spare)} points without joints ({names})")
    where = missing[0][0].where if missing else spare[0].where
    return ShotsInvalid(f"{where}: {'; '.join(problems)}", remedy=remedy)


def _listed(names: Sequence[str]) -> str:
    """List the first names for an error."""
    return listed([*map(shown, names)], LISTED)


def _pairs(rows: Sequence[JointsRow]) -> tuple[Sequence[int | None], str]:
    """Return the pairs as numbered, or else each two shots of a set that follow one another.

    With a note on which it was. Raise `ShotsInvalid` for half a pair.
    """
    # Without numbers: the n-th shot of a set is in the set's pair n // 2, whatever other sets stand
    # between; each new pair gets the next number over all sets.
    lines, sets = [row for row, _ in rows], [shot.purpose for _, shot in rows]
    pairs, note = [shot.pair for _, shot in rows], "pairs as numbered"
    if "pair" not in lines[0].texts:
        numbers, counts = dict[tuple[ShotSet, int], int](), Counter[ShotSet]()
        for row, purpose in enumerate(sets):
            key = (purpose, counts[purpose] // SHOTS_OF_A_PAIR)
            counts[purpose] += 1
            if purpose.in_pairs:
                pairs[row] = numbers.setdefault(key, len(numbers))
        note = f"no column pair: each {SHOTS_OF_A_PAIR} shots of a set in a row are a pair"
    check_pairs(lines, sets, pairs)
    return pairs, note
