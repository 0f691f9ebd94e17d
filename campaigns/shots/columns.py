"""Columns that plan.csv and shots.csv have in common: coordinates of axes, sets and pairs.

What is wrong raises the error of the file that the row is from.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence

from campaigns.files.csv_file import CsvRow, angle_text, number_text, numbers_of
from campaigns.files.wording import shown, suggestion
from campaigns.kinematics.axes import Axis
from campaigns.shots.pairs import SHOTS_OF_A_PAIR
from campaigns.shots.shot_sets import ShotSet

POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")
NEST = "nest"
"""Column of the fixed reflector place that was measured."""

ANGLE_LIMIT_DEG = 360.0
SIDES = {"": 0, "0": 0, "1": 1, "+1": 1, "-1": -1}
SETS = {each.value: each for each in ShotSet}


def axis_columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Columns of axes, as `q0_deg`."""
    return tuple(axis.column for axis in axes)


def axis_values(row: CsvRow, axes: Sequence[Axis]) -> tuple[float, ...]:
    """Inner values of a row's columns, rad or mm."""
    return tuple(_axis_value(row, axis) for axis in axes)


def axis_rows(rows: Sequence[CsvRow], axes: Sequence[Axis]) -> Iterator[tuple[float, ...]]:
    """The same of each row in turn, in a fourth of the time where nothing is wrong in any."""
    found = [column for axis in axes if (column := _axis_column(rows, axis))]
    if len(found) == len(axes):
        return zip(*found, strict=True)
    return (axis_values(row, axes) for row in rows)


def joint_values(row: CsvRow, axes: Sequence[Axis], purpose: ShotSet) -> tuple[float, ...]:
    """Joints of a shot; () of one that may be measured without the robot, and was."""
    if not purpose.on_robot and not any(map(row.text, axis_columns(axes))):
        return ()
    return axis_values(row, axes)


def approach_columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Columns of the sides from which joints came, as `q0_approach`."""
    return tuple(f"{axis.name}_approach" for axis in axes)


def side_columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """The same as other software calls them, as `side0`."""
    return tuple(f"side{place}" for place in range(len(axes)))


def approach_values(row: CsvRow, axes: Sequence[Axis]) -> tuple[int, ...]:
    """Sides of a row, +1, -1 or 0; () where it says none."""
    for names in (approach_columns(axes), side_columns(axes)):
        if any(row.text(name) for name in names):
            return tuple(_side(row, name) for name in names)
    return ()


def _side(row: CsvRow, name: str) -> int:
    text = row.text(name)
    if text not in SIDES:
        raise row.wrong(
            f"{name} is {shown(text)}, must be 1, -1 or 0",
            remedy="1: the joint last moved towards larger values; -1: smaller; 0: not known",
        )
    return SIDES[text]


def axis_texts(axes: Sequence[Axis], values: Sequence[float]) -> list[str]:
    """Texts for a row's columns, in the units of files."""
    each = zip(axes, values, strict=True)
    return [angle_text(value) if axis.is_revolute else number_text(value) for axis, value in each]


def axis_text_columns(axes: Sequence[Axis], rows: Sequence[Sequence[float]]) -> list[list[str]]:
    """Texts of many rows by column, those of each row as by `axis_texts`."""
    by_axis = zip(*rows, strict=True) if rows else [()] * len(axes)
    each = zip(axes, by_axis, strict=True)
    return [[*map(angle_text if axis.is_revolute else number_text, own)] for axis, own in each]


def _axis_column(rows: Sequence[CsvRow], axis: Axis) -> list[float]:
    """Inner values of a column; [] where any is wrong."""
    column = axis.column
    values = numbers_of([row.texts.get(column, "") for row in rows])
    most = ANGLE_LIMIT_DEG if axis.is_revolute else math.inf
    return [*map(axis.from_file, values)] if max(map(abs, values), default=0.0) <= most else []


def _axis_value(row: CsvRow, axis: Axis) -> float:
    value = row.number(axis.column)
    if not axis.is_revolute or abs(value) <= ANGLE_LIMIT_DEG:
        return axis.from_file(value)
    raise row.wrong(
        f"{axis.column} is {value:g}, must be within ±{ANGLE_LIMIT_DEG:g}",
        remedy="give the angle in degrees",
    )


def shot_set(row: CsvRow, if_empty: ShotSet | None = None) -> ShotSet:
    """Set of a row, by its column `set`."""
    word = row.text("set")
    if not word and if_empty is not None:
        return if_empty
    if word in SETS:
        return SETS[word]
    raise row.wrong(f"unknown set '{shown(word)}'", remedy=suggestion(word, tuple(SETS)))


def nest_name(row: CsvRow, purpose: ShotSet) -> str:
    """Nest of a row, by its column `nest`: empty for the robot's reflector, and may be of a bar."""
    name = row.text(NEST)
    if name and purpose.on_robot:
        raise row.wrong(
            f"nest is {shown(name)}, but a shot for {purpose.value} is of the robot's reflector",
            remedy="leave it empty, or give the set nest or known-length",
        )
    if not name and purpose is ShotSet.NEST:
        raise row.wrong("nest is empty", remedy="name the nest that was measured")
    return name


def pair_number(row: CsvRow, purpose: ShotSet) -> int | None:
    """Pair of a row, by its column `pair`, which is empty for a set without pairs."""
    if purpose.in_pairs:
        return row.whole_number("pair")
    if not row.text("pair"):
        return None
    raise row.wrong(
        f"pair is {shown(row.text('pair'))}, but a shot for {purpose.value} has no pair",
        remedy="leave it empty",
    )


def check_pairs(
    rows: Sequence[CsvRow], sets: Sequence[ShotSet], pairs: Sequence[int | None]
) -> None:
    """Refuse a pair that has not exactly two shots, both of one set."""
    of_pair: defaultdict[int, list[tuple[CsvRow, ShotSet]]] = defaultdict(list)
    for row, purpose, pair in zip(rows, sets, pairs, strict=True):
        if pair is not None:
            of_pair[pair].append((row, purpose))
    for number, shots in of_pair.items():
        first, last = shots[0][1], shots[-1][1]
        problem = ""
        if len(shots) < SHOTS_OF_A_PAIR:
            problem = f"pair {number} has one shot, must have two"
            remedy = "add the other shot, or take this one out"
        elif len(shots) > SHOTS_OF_A_PAIR:
            problem = f"pair {number} has {len(shots)} shots, must have two"
            remedy = "give each pair a number of its own"
        elif first is not last:
            problem = f"pair {number} is half {first.value}, half {last.value}"
            remedy = "give both shots the same set"
        if problem:
            raise shots[-1][0].wrong(problem, remedy=remedy)
