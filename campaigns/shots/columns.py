"""The columns that plan.csv and shots.csv have in common: angles, sets and pairs.

What is wrong raises the error of the file that the row is from.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.files.csv_file import CsvRow
from campaigns.files.wording import shown, suggestion
from campaigns.shots.shot_sets import ShotSet

JOINT_COLUMNS = ("q0_deg", "q1_deg", "q2_deg", "q3_deg")
POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")

ANGLE_LIMIT_DEG = 360.0
SHOTS_OF_A_PAIR = 2
SET_WORDS = tuple(each.value for each in ShotSet)


@dataclass(frozen=True, slots=True)
class PairedRow:
    """A row with its pair, None for a set without pairs."""

    row: CsvRow
    purpose: ShotSet
    pair: int | None


def angle_rad(row: CsvRow, column: str) -> float:
    """Read an angle in deg."""
    angle_deg = row.number(column)
    if abs(angle_deg) <= ANGLE_LIMIT_DEG:
        return math.radians(angle_deg)
    raise row.wrong(
        f"{column} is {angle_deg:g}, must be within ±{ANGLE_LIMIT_DEG:g}",
        remedy="give the angle in degrees",
    )


def joints_rad(row: CsvRow) -> tuple[float, ...]:
    """Read the four encoder angles."""
    return tuple(angle_rad(row, column) for column in JOINT_COLUMNS)


def shot_set(row: CsvRow) -> ShotSet:
    """Read the column `set`."""
    word = row.text("set")
    if word in SET_WORDS:
        return ShotSet(word)
    raise row.wrong(f"unknown set '{shown(word)}'", remedy=suggestion(word, SET_WORDS))


def pair_number(row: CsvRow, purpose: ShotSet) -> int | None:
    """Read the column `pair`, which is empty for a set without pairs."""
    if purpose.in_pairs:
        return row.whole_number("pair")
    if not row.text("pair"):
        return None
    raise row.wrong(
        f"pair is {shown(row.text('pair'))}, but a shot for {purpose.value} has no pair",
        remedy="leave it empty",
    )


def check_pairs(rows: Sequence[PairedRow]) -> None:
    """Refuse a pair that has not exactly two shots, both of one set."""
    pairs: defaultdict[int, list[PairedRow]] = defaultdict(list)
    for each in rows:
        if each.pair is not None:
            pairs[each.pair].append(each)
    for number, shots in pairs.items():
        _check_pair(number, shots)


def _check_pair(number: int, shots: Sequence[PairedRow]) -> None:
    first, last = shots[0], shots[-1]
    if len(shots) < SHOTS_OF_A_PAIR:
        raise last.row.wrong(
            f"pair {number} has one shot, must have two",
            remedy="add the other shot, or take this one out",
        )
    if len(shots) > SHOTS_OF_A_PAIR:
        raise last.row.wrong(
            f"pair {number} has {len(shots)} shots, must have two",
            remedy="give each pair a number of its own",
        )
    if first.purpose is not last.purpose:
        raise last.row.wrong(
            f"pair {number} is half {first.purpose.value}, half {last.purpose.value}",
            remedy="give both shots the same set",
        )
