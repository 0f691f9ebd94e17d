"""shots.csv: measured shots, from and to other software.

One row is one shot: its pair, its joints, and the point in the tracker's frame. All other columns
are optional, and are written only if a row fills them. A file without points, whose rows have names
instead, is joined with a point file (`joined_shots`).
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import get_args

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.files.cells import DecimalSign, Notation
from campaigns.files.csv_file import (
    CsvColumn,
    CsvForm,
    CsvRow,
    column_names,
    number_column,
    parse_csv,
    side_column,
    whole_column,
)
from campaigns.files.text_file import read_text, write_text_unless_there
from campaigns.kinematics.mechanism import Mechanism
from campaigns.shots import columns
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.time_texts import is_time, iso_times
from campaigns.shots.turn_forms import TurnForm, foreign_columns, turn_values, turns_of
from drivers.bounded_files import CSV_BYTES, SAVE_AS_UTF8, Encoding
from drivers.values import Matrix3, Vector3, is_positive_definite, vector

COVARIANCE_COLUMNS = ("sxx", "sxy", "sxz", "syy", "syz", "szz")
NOWHERE_MM = (math.nan, math.nan, math.nan)
HOUR_S = 3600.0
LONGEST_PAUSE_S = 1800.0
"""Longest pause between two shots for which times that go back are those of a clock set back."""
SESSION = "session"
"""Column of the session's number: the tracker stands at another place in each."""
PLAIN = Notation()
"""Notation of files of which nothing is stated."""
TEMPERATURES = ("temperature_degC", "part_temperature_degC")


@dataclass(frozen=True, slots=True)
class ShotRow:
    """Measured shot: joint values, and the reflector's place in the tracker's frame."""

    pair: int | None
    """Number of the shot's pair; None for sets without pairs."""
    joints: tuple[float, ...]
    """Joint values (n,), rad or mm; () for a known length or nest, measured without the robot."""
    point_in_tracker_mm: Vector3
    purpose: ShotSet = ShotSet.IDENTIFICATION
    turn: tuple[float, ...] = ()
    """Coordinates of the commanded pose beyond a place, rad; () if it has none or is unknown."""
    covariance_mm2: Matrix3 | None = None
    """Covariance of the point as stated; None: not stated."""
    temperature_degC: float | None = None
    """Temperature of the air; None: unknown."""
    time: str | None = None
    """Time as the file states it; None: unknown."""
    nest: str = ""
    """Name of the nest that was measured; "" for the robot's reflector."""
    approach: tuple[int, ...] = ()
    """+1 where a joint last moved to larger values, -1 smaller, 0 unknown; (): all unknown."""
    part_temperature_degC: float | None = None
    """Temperature of the robot's parts; None: not measured."""
    session: int = 0
    """Number of the session it was measured in; 0 if all are of one."""


def time_order(times: Sequence[str]) -> tuple[Index | None, str]:
    """Return the rows (N,) in the order of their times, ISO 8601 or numbers; None if unknown.

    With the reason in words, empty if known. Equal times keep the order of rows, and so do those
    of a clock that was set back by an hour.
    """
    seconds, lacking = steady_times_s(times)
    return None if seconds is None else np.argsort(seconds, kind="stable"), lacking


def times_s(times: Sequence[str]) -> tuple[Array | None, str]:
    """Return times in seconds (N,) from any beginning; None unless all are ISO 8601 or numbers.

    With the reason in words, empty where they are.
    """
    # Numbers are tried first: `20260301` counts seconds if all others are numbers, else is a date.
    if not any(times):
        return None, "there is no column time"
    if not all(times):
        return None, f"shot {times.index('')} has no time"
    for seconds in (_numbers, _moments):
        with suppress(ValueError, OverflowError):
            values = np.array(seconds(times))
            if np.isfinite(values).all():
                return values, ""
    return None, "times are not all of ISO 8601, all with a zone or all without, nor all numbers"


def steady_times_s(times: Sequence[str]) -> tuple[Array | None, str]:
    """Return times in the order of rows as `times_s` does, as a clock shows that is never set back.

    An hour is added behind the row after which a clock without a zone was an hour behind.
    """
    seconds, lacking = times_s(times)
    if seconds is not None and (row := set_back_before(times)) is not None:
        seconds = seconds + HOUR_S * (np.arange(len(seconds)) >= row)
    return seconds, lacking


def set_back_before(times: Sequence[str]) -> int | None:
    """Return the first row that a clock timed after it was set back by an hour; None for no such.

    Such times have no zone, and go back once in the order of rows, by an hour but for a pause.
    """
    # At the end of summer time local clocks show the same hour twice. The order of rows is evidence
    # too: rows in another order go back more often, or by any time. Numbers are no local times.
    with suppress(ValueError, OverflowError):
        if not all(times) or any(datetime.fromisoformat(text).tzinfo for text in times):
            return None
        steps_s = np.diff(_moments(times))
        back = np.flatnonzero(steps_s < 0.0)
        if len(back) == 1 and -HOUR_S <= steps_s[back[0]] <= LONGEST_PAUSE_S - HOUR_S:
            return int(back[0]) + 1
    return None


def _numbers(times: Sequence[str]) -> list[float]:
    """Return times that are numbers of seconds; raise `ValueError` for others."""
    return [float(text) for text in times]


def _moments(times: Sequence[str]) -> list[float]:
    """Return seconds of dates and times; raise `ValueError` for others, and for mixed zones."""
    moments = [datetime.fromisoformat(text) for text in times]
    if len({moment.tzinfo is None for moment in moments}) > 1:
        raise ValueError("some times have a zone")
    # Only differences count, so times without a zone may all be taken as UTC.
    return [
        (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp() for moment in moments
    ]


def in_unit(rows: Sequence[ShotRow], mm: float) -> Iterator[ShotRow]:
    """Convert points and covariances of rows that were written in a unit of `mm` millimetres."""
    for row in rows:
        covariance = row.covariance_mm2
        if covariance is not None:
            x, y, z = (vector(mm**2 * value for value in line) for line in covariance)
            covariance = (x, y, z)
        point_mm = vector(mm * value for value in row.point_in_tracker_mm)
        yield replace(row, point_in_tracker_mm=point_mm, covariance_mm2=covariance)


def read_shots(
    path: Path,
    mechanism: Mechanism,
    default: ShotSet = ShotSet.IDENTIFICATION,
    turns: TurnForm | None = None,
    notation: Notation = PLAIN,
) -> tuple[ShotRow, ...]:
    """Read measured shots of a robot, in the file's order; raise `ShotsInvalid`.

    `default` is the set of rows that name none, `turns` how three turns are written; None: by their
    columns.
    """
    text = table_text(path, notation, "check the file's name")
    return parse_shots(text, str(path), mechanism, default, turns, notation.decimal)


def table_text(path: Path, notation: Notation, if_missing: str) -> str:
    """Return the text of a file of shots or joints; raise `ShotsInvalid`."""
    return read_text(
        path,
        ShotsInvalid,
        if_missing=if_missing,
        most_bytes=CSV_BYTES,
        encoding=notation.encoding,
        if_undecoded=f"{SAVE_AS_UTF8}, or give --encoding {'|'.join(get_args(Encoding))}",
    )


def write_shots(
    path: Path, shots: Sequence[ShotRow], mechanism: Mechanism, *, overwrite: bool = False
) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`."""
    write_text_unless_there(path, shots_text(shots, mechanism), overwrite=overwrite)


def parse_shots(
    text: str,
    name: str,
    mechanism: Mechanism,
    default: ShotSet = ShotSet.IDENTIFICATION,
    turns: TurnForm | None = None,
    decimal: DecimalSign | None = None,
) -> tuple[ShotRow, ...]:
    """Read the shots of a file's text; raise `ShotsInvalid` with the line."""
    rows = list(parse_csv(text, name, _form(mechanism), decimal))
    if not rows:
        raise ShotsInvalid(f"{name}: holds no shots", remedy="check that it is the right file")
    shots = with_iso_times([_shot_of(row, mechanism, default, turns) for row in rows])
    columns.check_pairs(rows, [shot.purpose for shot in shots], [shot.pair for shot in shots])
    return shots


def with_iso_times(shots: Sequence[ShotRow]) -> tuple[ShotRow, ...]:
    """Return shots with the times of other software as ISO 8601; others stay as they are."""
    texts = [shot.time or "" for shot in shots]
    return tuple(
        replace(shot, time=time) if time is not None and not is_time(text) else shot
        for shot, text, time in zip(shots, texts, iso_times(texts), strict=True)
    )


def names_joints(text: str, mechanism: Mechanism) -> bool:
    """Return whether the first line of a text names pairs or joints, as only shots.csv does."""
    names = column_names(text, _form(mechanism))
    return not {"pair", *columns.axis_columns(mechanism.joints)}.isdisjoint(names)


def joints_rows(
    text: str,
    name: str,
    mechanism: Mechanism,
    default: ShotSet,
    turns: TurnForm | None = None,
    decimal: DecimalSign | None = None,
) -> Iterator[tuple[CsvRow, ShotRow]]:
    """Yield each row of a joints file, and its shot; the points are in another file.

    A shot's pair is None if the file has no column `pair`, or its set has no pairs. Raise
    `ShotsInvalid` with the line.
    """
    for row in parse_csv(text, name, _form(mechanism, with_points=False), decimal):
        yield row, _shot_of(row, mechanism, default, turns)


def shots_text(shots: Sequence[ShotRow], mechanism: Mechanism) -> str:
    """Write the text of a file of shots, with the optional columns that any of them fills."""
    return _form(mechanism).text([_values_of(shot, mechanism) for shot in shots])


def _form(mechanism: Mechanism, *, with_points: bool = True) -> CsvForm:
    """Return the columns of shots.csv, or of a file of named joints."""
    points = [number_column(name, required=True) for name in columns.POINT_COLUMNS]
    # Other software writes the sides of joints as side0, side1, …: both names are read, ours is
    # written, because rows fill only the columns with our names.
    return CsvForm(
        (
            *(() if with_points else (CsvColumn("name"),)),
            whole_column("pair", required=with_points),
            *columns.columns_of(mechanism.joints),
            *(points if with_points else ()),
            CsvColumn("set"),
            *columns.columns_of(turns_of(mechanism.task), required=False),
            *foreign_columns(mechanism.task),
            *map(side_column, columns.approach_columns(mechanism.joints)),
            *map(side_column, columns.side_columns(mechanism.joints)),
            *map(number_column, (*COVARIANCE_COLUMNS, *TEMPERATURES)),
            CsvColumn("time"),
            CsvColumn(columns.NEST),
            whole_column(SESSION),
        ),
        ShotsInvalid,
        columns.axis_columns(mechanism.joints),
        "give --decimal comma or --decimal point, or write decimal points",
    )


def _shot_of(
    row: CsvRow, mechanism: Mechanism, default: ShotSet, turns: TurnForm | None
) -> ShotRow:
    """Return the shot of a row; raise `ShotsInvalid` with its line."""
    # The set comes first: it decides whether pair, joints and nest must be filled or empty.
    purpose = columns.shot_set(row, default)
    has_point = columns.POINT_COLUMNS[0] in row.texts
    x_mm, y_mm, z_mm = row.values(columns.POINT_COLUMNS) if has_point else NOWHERE_MM
    return ShotRow(
        pair=columns.pair_number(row, purpose) if "pair" in row.texts else None,
        joints=columns.joint_values(row, mechanism.joints, purpose),
        point_in_tracker_mm=(x_mm, y_mm, z_mm),
        purpose=purpose,
        turn=turn_values(row, mechanism.task, turns),
        covariance_mm2=_covariance_of(row),
        time=row.notation("time") or None,
        nest=columns.nest_name(row, purpose),
        approach=columns.approach_values(row, mechanism.joints),
        session=row.value(SESSION) if row.text(SESSION) else 0,
        **{name: row.value(name) for name in TEMPERATURES if row.text(name)},
    )


def _covariance_of(row: CsvRow) -> Matrix3 | None:
    """Return the covariance of a row, None if it has none; raise `ShotsInvalid` for half of one."""
    empty = [column for column in COVARIANCE_COLUMNS if not row.text(column)]
    if len(empty) == len(COVARIANCE_COLUMNS):
        return None
    if empty:
        raise row.wrong(
            f"covariance without {', '.join(empty)}",
            remedy=f"give all of {','.join(COVARIANCE_COLUMNS)}, in mm², or none",
        )
    xx, xy, xz, yy, yz, zz = row.values(COVARIANCE_COLUMNS)
    covariance = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    if not is_positive_definite(covariance):
        raise row.wrong(
            "the covariance sxx … szz is not positive definite",
            remedy="check that these are variances and covariances in mm²",
        )
    return covariance


def _values_of(shot: ShotRow, mechanism: Mechanism) -> dict[str, object]:
    """Return the values of a shot by column."""
    covariance = shot.covariance_mm2
    upper = (*covariance[0], *covariance[1][1:], covariance[2][2]) if covariance else ()
    values: dict[str, object] = {
        "pair": shot.pair,
        "set": shot.purpose.value,
        "time": shot.time,
        columns.NEST: shot.nest,
        SESSION: shot.session or None,
        **{name: getattr(shot, name) for name in TEMPERATURES},
    }
    for names, cells in (
        (columns.axis_columns(mechanism.joints), shot.joints),
        (columns.axis_columns(turns_of(mechanism.task)), shot.turn),
        (columns.approach_columns(mechanism.joints), shot.approach),
        (columns.POINT_COLUMNS, shot.point_in_tracker_mm),
        (COVARIANCE_COLUMNS, upper),
    ):
        values |= zip(names, cells, strict=False)  # () leaves all of these columns empty
    return values
