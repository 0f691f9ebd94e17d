"""Columns that plan.csv and shots.csv have in common: coordinates of axes, sets and pairs.

Errors are those of the file that a row is from: `row.wrong` makes them, with file and line.
"""

from collections import defaultdict
from collections.abc import Sequence

from campaigns.files.csv_file import CsvColumn, CsvRow, angle_column, number_column
from campaigns.files.wording import shown, suggestion
from campaigns.kinematics.axes import Axis
from campaigns.shots.shot_sets import SHOTS_OF_A_PAIR, ShotSet

POINT_COLUMNS = ("x_mm", "y_mm", "z_mm")
NEST = "nest"
"""Column of the fixed reflector place that was measured."""
REFLECTOR = "reflector"
"""Column of the object where the robot's reflector sits, if not where robot.yaml says."""

SETS = {purpose.value: purpose for purpose in ShotSet}
"""Sets by their words in files."""


def axis_columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Return the names of the columns of axes, as `q0_deg`; fixed axes have none."""
    return tuple(axis.column for axis in axes if not axis.is_fixed)


def columns_of(axes: Sequence[Axis], *, required: bool = True) -> tuple[CsvColumn, ...]:
    """Return the columns of axes, with values in rad or mm."""
    return tuple(
        (angle_column if axis.is_revolute else number_column)(axis.column, required=required)
        for axis in axes
        if not axis.is_fixed
    )


def axis_values(row: CsvRow, axes: Sequence[Axis]) -> tuple[float, ...]:
    """Read the values of axes from their columns, rad or mm; 0 of a fixed axis."""
    return tuple(0.0 if axis.is_fixed else float(row.value(axis.column)) for axis in axes)


def axis_cells(axes: Sequence[Axis], values: Sequence[float]) -> dict[str, float]:
    """Return values of axes, rad or mm, by their columns."""
    pairs = zip(axes, values, strict=True)
    return {axis.column: value for axis, value in pairs if not axis.is_fixed}


def in_files(axes: Sequence[Axis], values: Sequence[float]) -> list[float]:
    """Return values of axes, rad or mm, in the units of files: those that files hold."""
    pairs = zip(axes, values, strict=True)
    return [axis.to_file(value) for axis, value in pairs if not axis.is_fixed]


def axis_texts(axes: Sequence[Axis], values: Sequence[float]) -> list[str]:
    """Write values of axes, rad or mm, in the units of files."""
    cells = axis_cells(axes, values).values()
    return [column.write(value) for column, value in zip(columns_of(axes), cells, strict=True)]


def joint_values(row: CsvRow, axes: Sequence[Axis], purpose: ShotSet) -> tuple[float, ...]:
    """Read the joints of a shot; () for a shot that was measured without the robot."""
    # Nests and known lengths may state joints even so; half of them is an error in any set.
    names = axis_columns(axes)
    if not purpose.on_robot and not any(map(row.text, names)):
        return ()
    return row.values(names)


def approach_columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Return the columns of the sides from which joints came, as `q0_approach`."""
    return tuple(f"{axis.name}_approach" for axis in axes)


def side_columns(axes: Sequence[Axis]) -> tuple[str, ...]:
    """Return the names that other software gives these columns, as `side0`."""
    return tuple(f"side{place}" for place in range(len(axes)))


def approach_values(row: CsvRow, axes: Sequence[Axis]) -> tuple[int, ...]:
    """Read the sides of a row, +1, -1 or 0, 0 for an empty cell; () if all cells are empty."""
    # our own columns go before those of other software
    for names in (approach_columns(axes), side_columns(axes)):
        if any(row.text(name) for name in names):
            return tuple(row.value(name) if row.text(name) else 0 for name in names)
    return ()


def shot_set(row: CsvRow, if_empty: ShotSet | None = None) -> ShotSet:
    """Read the set of a row, by its column `set`."""
    word = row.text("set")
    if not word and if_empty is not None:
        return if_empty
    if word in SETS:
        return SETS[word]
    raise row.wrong(f"unknown set '{shown(word)}'", remedy=suggestion(word, tuple(SETS)))


def nest_name(row: CsvRow, purpose: ShotSet) -> str:
    """Read the nest of a row, by its column `nest`: empty for the robot's reflector."""
    name = row.text(NEST)
    if name and purpose.on_robot:
        raise row.wrong(
            f"nest is {shown(name)}, but a shot for {purpose.value} is of the robot's reflector",
            remedy="leave it empty, or give the set nest or known-length",
        )
    if not name and purpose is ShotSet.NEST:
        raise row.wrong("nest is empty", remedy="name the nest that was measured")
    return name


def reflector_name(row: CsvRow, purpose: ShotSet) -> str:
    """Read where a row's reflector sits, by its column `reflector`: "" is as robot.yaml says."""
    name = row.text(REFLECTOR)
    if name and not purpose.on_robot:
        raise row.wrong(
            f"reflector is {shown(name)}, but a shot for {purpose.value} is of no reflector on the "
            "robot",
            remedy="leave it empty",
        )
    return name


def pair_number(row: CsvRow, purpose: ShotSet) -> int | None:
    """Read the pair of a row, by its column `pair`, which is empty for a set without pairs."""
    if purpose.in_pairs:
        pair: int = row.value("pair")
        return pair
    if not row.text("pair"):
        return None
    raise row.wrong(
        f"pair is {shown(row.text('pair'))}, but a shot for {purpose.value} has no pair",
        remedy="leave it empty",
    )


def check_pairs(
    rows: Sequence[CsvRow], sets: Sequence[ShotSet], pairs: Sequence[int | None]
) -> None:
    """Raise an error for a pair that has not exactly two shots, both of one set."""
    # The error is at the pair's last line, where the count is known to be wrong.
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
