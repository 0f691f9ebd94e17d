"""Measured shots as arrays, for everything that comes after the journal.

Shots come from a journal, a file or a user's arrays, and from here on no one needs to know from
which: all have the columns of `Shots`, with NaN, 0 or "" where the origin states nothing. Rows stay
in the order of their origin; the order of time is a function of its own, because a shot that is
measured again keeps its number but comes later.

What a shot needs beside joints and point is from which side each joint came, for that decides the
sign of backlash. It is found from the joints before and after the last leg, in the order of time.
"""

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from io import StringIO
from typing import Any, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from campaigns.arrays import AXES, Array, Index, batch
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import number_text
from campaigns.files.table import Column, find_pandas, html_table, words
from campaigns.fit.rigid_transforms import distances_mm
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.journal.records import Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import RobotFile
from campaigns.shots.shot_sets import SHOTS_OF_A_PAIR, PairRows, ShotSet, pair_rows
from campaigns.shots.shots_csv import ShotRow, shots_text, steady_times_s, time_order, times_s
from drivers.values import Matrix3, Pose, is_positive_definite, vector

OF_SESSIONS = "--sessions"
"""Option of `identify` for shots from several stations of the tracker."""
IMPORTED = "imported"
"""First word of an import's note, where a tracker's raw answer stands otherwise."""
NOTE = re.compile(
    rf"{IMPORTED}(?:, air (?P<air>[-+.e\d]+) °C)?(?:, measured (?P<time>.*))?", re.DOTALL
)
TAKEN_UP_RAD = float(np.radians(5.0 / 60.0))
"""Way, of a crank or what compares, after which a joint has taken up its gear's lost motion."""
AT_REST_RAD = float(np.radians(0.005))
"""Largest difference between readings of a joint that stands still."""


class OptionalColumns(TypedDict, total=False):
    """Columns of `Shots.of` that may be left out."""

    sets: Sequence[str] | str
    """Sets of the shots, as in shots.csv: one word for all, or one for each shot. Left out: all are
    for identification."""
    pairs: Sequence[int | None] | None
    """Number of each shot's pair, from 0; None for a single shot."""
    covariance_mm2: ArrayLike | None
    """Covariances of the points, (N, 3, 3), or (3, 3) for all; where they are missing or NaN, the
    instrument's is taken."""
    approach: ArrayLike | None
    """Sign of each joint's last motion (N, n), 0 where unknown."""
    times: Sequence[str] | None
    """Time of each shot, as in shots.csv."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Shots:
    """Measured shots: N rows of joints with the point that the tracker measured there.

    `read_shots` and `Shots.of` make them. `numbers` are the plan's, or those of an imported file's
    rows.
    """

    numbers: tuple[int, ...]
    purposes: tuple[ShotSet, ...]
    pairs: tuple[int | None, ...]
    joints: Array
    """(N, n), rad or mm."""
    points_in_tracker_mm: Array
    """(N, 3)"""
    stated_covariance_mm2: Array
    """Covariance that the tracker stated of each point, (N, 3, 3); NaN where it stated nothing."""
    approach: Array
    """+1 where a joint last moved towards larger values, -1 smaller, 0 where unknown, (N, n)."""
    commanded: Array
    """Poses (N, t) in the base frame; of imported shots the nominal robot's at their joints."""
    measured_utc: tuple[str, ...]
    """Time of each shot; "" if unknown."""
    temperature_degC: Array
    """Temperature of the air, (N,); NaN where it is not known."""
    records: tuple[int, ...] = ()
    """Places in the journal, in the order of time whatever the clock was set to; () outside one."""
    nests: tuple[str, ...] = ()
    """Name of the nest that each shot measured, "" for the robot's reflector; (): no nests."""
    session: Index = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Number of the session in which each shot was measured, (N,); 0 if not stated."""
    part_temperature_degC: Array = field(default_factory=lambda: np.zeros(0))
    """Temperature of the robot's parts, (N,); NaN where it is not known."""
    commanded_points_mm: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Where the reflector is at the commanded poses, (N, 3), in the base frame."""

    def __post_init__(self) -> None:
        """Fill columns left out, and refuse columns of unequal length; raises `ValueError`."""
        # Left out, these columns are empty, for a default cannot know the number of shots. They get
        # one neutral value a shot.
        count, joints = len(self.numbers), self.joints.shape[1]
        neutral = {
            "session": np.zeros(count, dtype=np.intp),
            "part_temperature_degC": np.full(count, np.nan),
            "commanded_points_mm": self.commanded[:, :3],
        }
        for name, column in neutral.items():
            if not len(getattr(self, name)):
                object.__setattr__(self, name, column)
        optional = {name for name in ("records", "nests") if not getattr(self, name)}
        for name in COLUMNS:
            if name not in optional and len(getattr(self, name)) != count:
                raise ValueError(f"{name} has {len(getattr(self, name))} of {count} shots")
        for name, wanted in {
            "points_in_tracker_mm": (count, 3),
            "stated_covariance_mm2": (count, 3, 3),
            "approach": (count, joints),
        }.items():
            if (shape := getattr(self, name).shape) != wanted:
                raise ValueError(f"{name} of {count} shots has shape {shape}, must be {wanted}")

    @classmethod
    def of(
        cls,
        joints: ArrayLike,
        points_in_tracker_mm: ArrayLike,
        robot: RobotFile,
        **columns: Unpack[OptionalColumns],
    ) -> "Shots":
        """Make shots of a robot from arrays.

        Args:
            joints: Encoder readings (N, n), rad or mm.
            points_in_tracker_mm: Measured points (N, 3) in the tracker's frame, mm.
            robot: The nominal robot.
            columns: Any of `sets`, `pairs`, `covariance_mm2`, `approach` and `times`, as
                `OptionalColumns` explains them.

        Returns:
            The shots, for `identify`.

        Raises:
            TypeError: A column has another name.
            ValueError: An array has the wrong shape; the message names it.
            ShotsInvalid: A row has values that no shot can have; the message names the row.

        Example:
            >>> robot = find_robot("delta")
            >>> shots = Shots.of(joints_rad, points_mm, robot, pairs=[0, 0, 1, 1])
        """
        if unknown := columns.keys() - OptionalColumns.__annotations__.keys():
            raise TypeError(f"Shots.of has no columns {', '.join(sorted(unknown))}")
        names = [axis.name for axis in robot.mechanism.joints]
        rows = batch(joints, names, "joints")
        points, count = batch(points_in_tracker_mm, AXES, "points"), len(rows)
        _require_finite(rows, names)
        _require_finite(points, AXES)
        stated = _stated_of_arrays(columns.get("covariance_mm2"), count)
        approach = columns.get("approach")
        sides = np.zeros(rows.shape) if approach is None else batch(approach, names, "approach")
        sets = columns.get("sets", ShotSet.IDENTIFICATION.value)
        purposes = tuple(map(ShotSet, [sets] * count if isinstance(sets, str) else sets))
        pair_of = columns.get("pairs")
        pairs = tuple(
            None if pair is None else int(pair)
            for pair in ([None] * count if pair_of is None else pair_of)
        )
        _require_pairs(purposes, pairs)
        commanded = robot.kinematics.forward(rows).values
        return cls(
            numbers=tuple(range(count)),
            purposes=purposes,
            pairs=pairs,
            joints=rows,
            points_in_tracker_mm=points,
            stated_covariance_mm2=stated,
            approach=sides,
            commanded=commanded,
            commanded_points_mm=robot.kinematics.points(commanded),
            measured_utc=tuple(columns.get("times") or [""] * count),
            temperature_degC=np.full(count, np.nan),
        )

    def __len__(self) -> int:
        return len(self.numbers)

    def __repr__(self) -> str:
        counts = ", ".join(
            f"{n} {purpose}"
            for purpose, n in Counter(purpose.value for purpose in self.purposes).items()
        )
        return f"<Shots: {len(self)} ({counts}) of {self.joints.shape[1]} joints>"

    def to_frame(self, robot: RobotFile) -> Any:
        """Return a DataFrame with the columns of shots.csv; raise `ImportError` without pandas.

        Any: as of `find_pandas`.
        """
        text = shots_text(rows_of_shots(self), robot.mechanism)
        return find_pandas().read_csv(StringIO(text))

    def _repr_html_(self) -> str:
        """Return a table for notebooks: how many shots and pairs of each set there are."""
        sets = Counter(purpose.value for purpose in self.purposes)
        pairs = Counter(
            purpose.value
            for purpose, pair in {*zip(self.purposes, self.pairs, strict=True)}
            if pair is not None
        )
        columns: tuple[Column[tuple[str, int]], ...] = (
            words("set", lambda row: row[0]),
            Column("shots", lambda row: row[1]),
            Column("pairs", lambda row: pairs[row[0]]),
        )
        title = f"{len(self)} shots of {self.joints.shape[1]} joints"
        return html_table(title, columns, sets.items())

    def order_of_time(self) -> Index:
        """Return the rows as they were measured, by the journal's records: clocks may be set back.

        Outside of a journal by time; in their own order unless each has a time.
        """
        if self.records:
            return np.argsort(self.records, kind="stable")
        order, _ = time_order(self.measured_utc)
        return np.arange(len(self)) if order is None else order

    def elapsed_s(self) -> Array | None:
        """Return the time since the earliest shot, (N,); None where not all times are known."""
        seconds, _ = steady_times_s(self.measured_utc)
        return None if seconds is None else seconds - seconds.min()

    def rows(self, rows: Index) -> "Shots":
        """Return the shots of these rows."""
        places = rows.tolist()

        def select(column: Array | Index | tuple[object, ...]) -> object:
            if isinstance(column, np.ndarray):
                return column[rows]
            return tuple(map(column.__getitem__, places)) if column else ()

        # Any: each column becomes another of its own type
        selected: dict[str, Any] = {name: select(getattr(self, name)) for name in COLUMNS}
        return Shots(**selected)

    def of_set(self, *purposes: ShotSet) -> "Shots":
        """Return the shots of these sets."""
        return self.rows(self.rows_of(*purposes))

    def on_robot(self) -> "Shots":
        """Return the shots with the reflector on the robot, none of nests or known lengths."""
        return self.of_set(*(purpose for purpose in ShotSet if purpose.on_robot))

    def rows_of(self, *purposes: ShotSet) -> Index:
        """Return the rows of these sets."""
        return np.flatnonzero([purpose in purposes for purpose in self.purposes])

    def covariance_mm2(self, model: TrackerUncertainty) -> Array:
        """Return the stated covariance of each point, by `model` where none is, (N, 3, 3)."""
        return _completed_mm2(self.stated_covariance_mm2, self.points_in_tracker_mm, model)

    def whole_pairs(self, purpose: ShotSet) -> PairRows:
        """Return the whole pairs of a set, and the rows whose partner is missing."""
        labels = zip(self.purposes, self.pairs, strict=True)
        return pair_rows([pair if kind is purpose else None for kind, pair in labels])

    def measured_distances_mm(self, rows: Index) -> Array:
        """Return the distances between the two shots of each row of (M, 2), (M,)."""
        return distances_mm(self.points_in_tracker_mm, rows[:, 0], rows[:, 1])

    def distance_errors_mm(self, rows: Index, points_mm: Array) -> Array:
        """Return modelled minus measured distances (M,) of pairs (M, 2), by points (N, 3)."""
        modelled_mm = distances_mm(points_mm, rows[:, 0], rows[:, 1])
        return modelled_mm - self.measured_distances_mm(rows)


COLUMNS = tuple(column.name for column in fields(Shots))


def _require_finite(values: Array, columns: Sequence[str]) -> None:
    """Raise `ShotsInvalid` for the first of the values (N, k) that is not finite."""
    for row, column in np.argwhere(~np.isfinite(values)).tolist():
        raise ShotsInvalid(
            f"row {row}: {columns[column]} is {values[row, column]}, must be finite",
            remedy="leave that shot out, or correct it",
        )


def _stated_of_arrays(covariance_mm2: ArrayLike | None, count: int) -> Array:
    """Return covariances (N, 3, 3) of those or of the one given, NaN where none is stated.

    Raises `ValueError` for another shape, and `ShotsInvalid` for the first that no point can have.
    """
    if covariance_mm2 is None:
        return np.full((count, 3, 3), np.nan)
    stated = np.asarray(covariance_mm2, dtype=np.float64)
    if stated.shape not in {(3, 3), (count, 3, 3)}:
        raise ValueError(
            f"covariance_mm2 has shape {stated.shape}, must have ({count}, 3, 3) or (3, 3)"
        )
    stated = np.broadcast_to(stated, (count, 3, 3))
    for row, matrix in enumerate(stated):
        if not np.isnan(matrix).all() and not is_positive_definite(matrix.tolist()):
            raise ShotsInvalid(
                f"row {row}: its covariance is not finite and positive definite",
                remedy="give variances and covariances in mm², or NaN where none is known",
            )
    return stated


def _require_pairs(purposes: Sequence[ShotSet], pairs: Sequence[int | None]) -> None:
    """Raise `ShotsInvalid` for a pair of more than two shots of a set."""
    rows: dict[tuple[ShotSet, int], list[int]] = {}
    for row, (purpose, pair) in enumerate(zip(purposes, pairs, strict=False)):
        if pair is not None:
            rows.setdefault((purpose, pair), []).append(row)
    for (_, pair), of_pair in rows.items():
        if len(of_pair) > SHOTS_OF_A_PAIR:
            *first, last = map(str, of_pair)
            raise ShotsInvalid(
                f"pair {pair} has {len(of_pair)} shots, rows {', '.join(first)} and {last}, must "
                "be two",
                remedy="number the pairs again",
            )


def between(shots: Shots, first: int | None, last: int | None) -> Shots:
    """Leave out the shots for identification whose numbers are outside of a range."""
    # other sets stay: validation and drift shots are of the whole series
    low = -1 if first is None else first
    high = max(shots.numbers, default=0) if last is None else last
    inside = [
        purpose is not ShotSet.IDENTIFICATION or low <= number <= high
        for number, purpose in zip(shots.numbers, shots.purposes, strict=True)
    ]
    return shots if all(inside) else shots.rows(np.flatnonzero(inside))


def held_out(shots: Shots, share: float, rng: np.random.Generator) -> Shots:
    """Turn a share of the identification pairs into validation pairs, spread over the series."""
    # 1. Cut the series of pairs into runs of equal length, one for each pair that is needed, and
    #    draw one pair of each run: so warm-up and drift meet both kinds equally.
    rows = shots.whole_pairs(ShotSet.IDENTIFICATION).rows
    count = round(share * len(rows))
    if not count:
        return shots
    purposes = list(shots.purposes)
    for part in np.array_split(np.arange(len(rows)), count):
        for row in rows[rng.choice(part)].tolist():
            purposes[row] = ShotSet.VALIDATION
    # 2. Number the drawn pairs above all others: identification pair 7 and validation pair 7 may
    #    both exist, and would become one pair of four shots.
    used = {pair for pair in shots.pairs if pair is not None}
    pairs = list(shots.pairs)
    for number, both in enumerate(rows.tolist(), start=max(used, default=0) + 1):
        for row in both:
            if purposes[row] is ShotSet.VALIDATION:
                pairs[row] = number
    return replace(shots, purposes=tuple(purposes), pairs=tuple(pairs))


def with_readings(shots: Shots, readings: Mapping[str, float]) -> Shots:
    """Fill in temperatures of parts from readings at times, °C, where shots have none.

    Raise `ShotsInvalid` for times that cannot be compared with those of the shots.
    """
    # Both kinds of times are read together, so that they count from one beginning. Between two
    # readings the temperature is in proportion to time, outside of them that of the nearest one.
    if not readings:
        return shots
    seconds, lacking = times_s([*shots.measured_utc, *readings])
    if seconds is None:
        raise ShotsInvalid(
            f"part_temperatures in campaign.yaml and the shots do not go together: {lacking}",
            remedy='give times as those of the shots, "2026-11-21T09:00:00Z"',
        )
    shots_s, readings_s = np.split(seconds, [len(shots)])
    order = np.argsort(readings_s, kind="stable")
    readings_degC = np.array([*readings.values()])[order]
    interpolated = np.interp(shots_s, readings_s[order], readings_degC)
    stated = shots.part_temperature_degC
    return replace(shots, part_temperature_degC=np.where(np.isnan(stated), interpolated, stated))


def import_note(temperature_degC: float | None, time: str | None) -> str:
    """Write the note that stands where a tracker's answer would: air and time of an import."""
    air = "" if temperature_degC is None else f", air {number_text(temperature_degC)} °C"
    return f"{IMPORTED}{air}" + ("" if time is None else f", measured {time}")


def read_note(note: str) -> tuple[float | None, str | None]:
    """Read temperature in °C and time of an import's note; None for what it lacks."""
    match = NOTE.fullmatch(note)
    if match is None:
        return None, None
    return None if match["air"] is None else float(match["air"]), match["time"]


def shots_of_journal(shots: Sequence[AcceptedShot], mechanism: Mechanism) -> Shots:
    """Return the accepted shots of a series, of the reflector of the robot file alone."""
    shots = [shot for shot in shots if not shot.intent.reflector]
    intents = [shot.intent for shot in shots]
    measured = shots_of_outcomes(
        [shot.outcome for shot in shots],
        mechanism,
        purposes=[ShotSet(intent.purpose) for intent in intents],
        pairs=[intent.pair for intent in intents],
        targets=[intent.target for intent in intents],
        records=[shot.number for shot in shots],
    )
    return replace(
        measured,
        measured_utc=tuple(map(_measured_utc, shots)),
        nests=tuple(intent.nest for intent in intents),
        session=np.array([shot.session for shot in shots], dtype=np.intp),
    )


# The journal's time of an import is when it was imported, milliseconds after the one before. Taken
# as times of shots, slow motions would follow the clock of the import, another one at each import.
def _measured_utc(shot: AcceptedShot) -> str:
    """Return when a shot was measured; of an import what its file said, or else nothing."""
    note = shot.outcome.raw_tracker
    return (read_note(note)[1] or "") if NOTE.fullmatch(note) else shot.measured_utc


def shots_of_outcomes(
    outcomes: Sequence[Outcome],
    mechanism: Mechanism,
    *,
    purposes: Sequence[ShotSet],
    pairs: Sequence[int | None],
    targets: Sequence[Pose],
    records: Sequence[int] = (),
) -> Shots:
    """Return the shots that were measured for these sets, pairs and poses.

    `records` are places in the journal; without them outcomes stand in the order of time.
    """
    # Shots that were not read from a journal have the record 0, so all or none count.
    count, joints = len(outcomes), len(mechanism.joints)
    in_journal = tuple(records) if all(records) else ()
    order = sorted(range(count), key=in_journal.__getitem__) if in_journal else range(count)
    poses = [pose.coordinates for pose in targets]
    commanded = np.array(poses).reshape(count, len(mechanism.task))
    return Shots(
        numbers=tuple(outcome.shot for outcome in outcomes),
        purposes=tuple(purposes),
        pairs=tuple(pairs),
        joints=_with_gaps([outcome.joints for outcome in outcomes], joints),
        points_in_tracker_mm=_points_mm(outcomes),
        stated_covariance_mm2=_stated_covariance_mm2(outcomes),
        approach=approach_directions(outcomes, order, mechanism.joints),
        commanded=commanded,
        commanded_points_mm=mechanism.points(commanded),
        measured_utc=("",) * count,
        temperature_degC=_or_nan(
            outcome.weather.temperature_degC if outcome.weather else None for outcome in outcomes
        ),
        records=in_journal,
        part_temperature_degC=_or_nan(outcome.part_temperature_degC for outcome in outcomes),
    )


def rows_of_shots(shots: Shots) -> tuple[ShotRow, ...]:
    """Return the rows of a file of shots."""

    def or_none(value: float) -> float | None:
        return value if np.isfinite(value) else None

    # Columns that hold nothing for any shot are left out of the file: zeros of sides mean unknown,
    # and a single session needs no number.
    has_sides, has_sessions = bool(shots.approach.any()), len({*shots.session.tolist()}) > 1
    return tuple(
        ShotRow(
            shots.pairs[row],
            tuple(joints.tolist()) if purpose.on_robot and np.isfinite(joints).all() else (),
            vector(shots.points_in_tracker_mm[row]),
            purpose,
            turn=tuple(shots.commanded[row, 3:].tolist()),
            covariance_mm2=_matrix(shots.stated_covariance_mm2[row]),
            temperature_degC=or_none(shots.temperature_degC[row]),
            time=shots.measured_utc[row] or None,
            nest=shots.nests[row] if shots.nests else "",
            approach=tuple(shots.approach[row].astype(int).tolist()) if has_sides else (),
            part_temperature_degC=or_none(shots.part_temperature_degC[row]),
            session=int(shots.session[row]) if has_sessions else 0,
        )
        for row, (purpose, joints) in enumerate(zip(shots.purposes, shots.joints, strict=True))
    )


def _matrix(covariance: Array) -> Matrix3 | None:
    """Return a covariance (3, 3) as rows; None for one that is not stated, which is NaN."""
    if np.isnan(covariance).any():
        return None
    x, y, z = map(vector, covariance)
    return x, y, z


def shots_of_rows(rows: Sequence[ShotRow], nominal: Kinematics) -> Shots:
    """Return the shots of a file's rows, numbered from 0.

    The nominal robot's poses stand for the commanded ones; NaN where it has none.
    """
    joints = _with_gaps([row.joints for row in rows], len(nominal.mechanism.joints))
    poses = np.full((len(rows), len(nominal.mechanism.task)), np.nan)
    by_robot = np.array([bool(row.joints) for row in rows])
    poses[by_robot] = nominal.forward(joints[by_robot]).values
    sides = [row.approach or (0,) * joints.shape[1] for row in rows]
    return Shots(
        numbers=tuple(range(len(rows))),
        purposes=tuple(row.purpose for row in rows),
        pairs=tuple(row.pair for row in rows),
        joints=joints,
        points_in_tracker_mm=np.array([row.point_in_tracker_mm for row in rows]),
        stated_covariance_mm2=_stated_covariance_mm2(rows),
        approach=np.array(sides, dtype=np.float64).reshape(joints.shape),
        commanded=poses,
        commanded_points_mm=nominal.points(poses),
        measured_utc=tuple(row.time or "" for row in rows),
        nests=tuple(row.nest for row in rows),
        temperature_degC=_or_nan(row.temperature_degC for row in rows),
        part_temperature_degC=_or_nan(row.part_temperature_degC for row in rows),
        session=np.array([row.session for row in rows], dtype=np.intp),
    )


def _with_gaps(joints: Sequence[tuple[float, ...]], count: int) -> Array:
    """Return joints (N, count); NaN of shots without the robot, which have ()."""
    return np.array([row or (np.nan,) * count for row in joints]).reshape(-1, count)


# Lost motion of a gear makes a joint stand on one side of its play or the other, by the direction
# in which it was last turned far enough. For each shot, in the order of time:
#
# 1. A leg longer than TAKEN_UP_RAD decides by itself.
# 2. A shorter leg that goes on in the direction of the shot before, or no leg at all, keeps it.
# 3. A short leg against it leaves the joint somewhere within its play: unknown, 0.
#
# "The shot before" counts only if the robot still stood there when the leg began: what it did in
# between, as a detour or a motion by hand, is not in the journal's shots.
def approach_directions(
    outcomes: Sequence[Outcome], order: Iterable[int], axes: Sequence[Axis]
) -> Array:
    """Return +1 where a joint last moved to larger values, -1 smaller, 0 if unknown, (N, n).

    `order` are the rows in the order of time: a shot measured again comes after others of higher
    numbers.
    """
    scale = np.array([axis.scale for axis in axes])
    signs = np.zeros((len(outcomes), len(axes)))
    signs_before, joints_before = np.zeros(len(axes)), (np.nan,) * len(axes)
    for row in order:
        outcome = outcomes[row]
        if not outcome.joints:
            continue  # a nest or known length, measured without moving the robot
        if outcome.approach is not None:  # of an import: as its file states
            signs[row] = outcome.approach
        if outcome.came_from is not None:
            came_from = np.array(outcome.came_from)
            # the first shot compares with NaN, which is never equal
            still_there = bool((np.abs(came_from - joints_before) < AT_REST_RAD * scale).all())
            moved_rad = (outcome.joints - came_from) / scale
            signs[row] = _direction(moved_rad, signs_before * still_there)
        signs_before, joints_before = signs[row], outcome.joints
    return signs


def _direction(moved_rad: Array, before: Array) -> Array:
    """Return each joint's direction after a leg, (n,), by its length and the direction before."""
    sign = np.sign(moved_rad)
    is_kept = (np.abs(moved_rad) < AT_REST_RAD) | (sign == before)
    return np.where(np.abs(moved_rad) > TAKEN_UP_RAD, sign, np.where(is_kept, before, 0.0))


def outcomes_covariance_mm2(outcomes: Sequence[Outcome], model: TrackerUncertainty) -> Array:
    """Return the stated covariance of each point, by `model` where none is, (N, 3, 3)."""
    return _completed_mm2(_stated_covariance_mm2(outcomes), _points_mm(outcomes), model)


def _points_mm(outcomes: Sequence[Outcome]) -> Array:
    """Return the points of outcomes in the tracker's frame, (N, 3)."""
    return np.array([outcome.point_in_tracker_mm for outcome in outcomes]).reshape(-1, 3)


def _or_nan(values: Iterable[float | None]) -> Array:
    """Return values (N,), NaN for unknown ones."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _stated_covariance_mm2(shots: Sequence[Outcome] | Sequence[ShotRow]) -> Array:
    """Return the covariance that the tracker stated of each point, (N, 3, 3); NaN for none."""
    unknown = np.full((3, 3), np.nan)
    stated = [unknown if shot.covariance_mm2 is None else shot.covariance_mm2 for shot in shots]
    return np.array(stated, dtype=np.float64).reshape(-1, 3, 3)


def _completed_mm2(
    stated_mm2: Array, points_in_tracker_mm: Array, model: TrackerUncertainty
) -> Array:
    """Return stated covariances, and those of `model` where they are NaN, (N, 3, 3)."""
    unstated = np.flatnonzero(np.isnan(stated_mm2).all(axis=(1, 2)))
    completed = stated_mm2.copy()
    completed[unstated] = point_covariance_mm2(points_in_tracker_mm[unstated], model)
    return completed
