"""shots.csv: measured shots, from and to other software."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import zip_longest
from pathlib import Path

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import CsvForm, CsvRow, csv_text, number_text, parse_csv
from campaigns.files.text_file import read_text, write_text_unless_there
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.shots import columns
from campaigns.shots.shot_sets import ShotSet
from drivers.bounded_files import CSV_BYTES
from drivers.values import Matrix3, Vector3, is_positive_definite, vector

COVARIANCE_COLUMNS = ("sxx", "sxy", "sxz", "syy", "syz", "szz")
TEMPERATURES = ("temperature_degC", "part_temperature_degC")


@dataclass(frozen=True, slots=True)
class ShotRow:
    """Measured shot: joint values, and the reflector's place in the tracker's frame.

    `joints` are () of a known length or nest, measured without the robot. `pair` is None for sets
    without pairs. `turn` is that of the commanded pose: what it has beyond
    a place, rad; empty where that is nothing or not known. `time` is as the file says it. None: not
    known.
    """

    pair: int | None
    joints: tuple[float, ...]
    point_in_tracker_mm: Vector3
    purpose: ShotSet = ShotSet.IDENTIFICATION
    turn: tuple[float, ...] = ()
    covariance_mm2: Matrix3 | None = None
    temperature_degC: float | None = None
    """Of the air."""
    time: str | None = None
    nest: str = ""
    approach: tuple[int, ...] = ()
    """+1 where a joint last moved towards larger values, -1 smaller, 0 unknown; (): of none."""
    part_temperature_degC: float | None = None
    """Of the robot's parts."""


def time_order(times: Sequence[str]) -> tuple[Index | None, str]:
    """Rows (N,) in the order of their times, ISO 8601 or numbers; None where these do not tell it.

    With the reason in words, empty where they do. Equal times keep the order of rows.
    """
    seconds, lacking = times_s(times)
    return None if seconds is None else np.argsort(seconds, kind="stable"), lacking


def times_s(times: Sequence[str]) -> tuple[Array | None, str]:
    """Seconds (N,) from any beginning of times, ISO 8601 or numbers; None where they are not all.

    With the reason in words, empty where they are.
    """
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


def _numbers(times: Sequence[str]) -> list[float]:
    return [float(text) for text in times]


def _moments(times: Sequence[str]) -> list[float]:
    """Seconds of dates and times; raises `ValueError` for others, and where some have no zone."""
    read = [datetime.fromisoformat(text) for text in times]
    if len({each.tzinfo is None for each in read}) > 1:
        raise ValueError("some times have a zone")
    return [(each if each.tzinfo else each.replace(tzinfo=UTC)).timestamp() for each in read]


def in_unit(rows: Sequence[ShotRow], mm: float) -> Iterator[ShotRow]:
    """Rows whose lengths were written in a unit of so many mm."""
    for row in rows:
        covariance = row.covariance_mm2
        if covariance is not None:
            x, y, z = (vector(mm**2 * each for each in line) for line in covariance)
            covariance = (x, y, z)
        point_mm = vector(mm * each for each in row.point_in_tracker_mm)
        yield replace(row, point_in_tracker_mm=point_mm, covariance_mm2=covariance)


def read_shots(
    path: Path, mechanism: ClosedChain, default: ShotSet = ShotSet.IDENTIFICATION
) -> tuple[ShotRow, ...]:
    """Measured shots of a robot, in the file's order; raises `ShotsInvalid`.

    `default` is the set of rows that name none.
    """
    text = read_text(path, ShotsInvalid, if_missing="check the file's name", most_bytes=CSV_BYTES)
    return parse_shots(text, str(path), mechanism, default)


def write_shots(
    path: Path, shots: Sequence[ShotRow], mechanism: ClosedChain, *, overwrite: bool = False
) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`."""
    write_text_unless_there(path, shots_text(shots, mechanism), overwrite=overwrite)


def parse_shots(
    text: str, name: str, mechanism: ClosedChain, default: ShotSet = ShotSet.IDENTIFICATION
) -> tuple[ShotRow, ...]:
    """Shots of a file's text; raises `ShotsInvalid` with the line."""
    rows = list(parse_csv(text, name, _form(mechanism)))
    if not rows:
        raise ShotsInvalid(f"{name}: holds no shots", remedy="check that it is the right file")
    shots = tuple(_shot_of(row, mechanism, default) for row in rows)
    columns.check_pairs(rows, [shot.purpose for shot in shots], [shot.pair for shot in shots])
    return shots


def shots_text(shots: Sequence[ShotRow], mechanism: ClosedChain) -> str:
    """Text of a file of shots, with the optional columns that any of them fills."""
    form = _form(mechanism)
    texts = [_texts_of(shot, mechanism) for shot in shots]
    filled = [column for column in form.optional if any(row.get(column) for row in texts)]
    header = (*form.required, *filled)
    return csv_text(header, [[row.get(column, "") for column in header] for row in texts])


def _form(mechanism: ClosedChain) -> CsvForm:
    turns = columns.axis_columns(_turns(mechanism))
    return CsvForm(
        required=("pair", *columns.axis_columns(mechanism.joints), *columns.POINT_COLUMNS),
        optional=(
            "set",
            *turns,
            *columns.approach_columns(mechanism.joints),
            *columns.side_columns(mechanism.joints),
            *COVARIANCE_COLUMNS,
            *TEMPERATURES,
            "time",
            columns.NEST,
        ),
        invalid=ShotsInvalid,
    )


def _turns(mechanism: ClosedChain) -> tuple[Axis, ...]:
    """Task axes that a tracker does not see."""
    return mechanism.task[len(columns.POINT_COLUMNS) :]


def _shot_of(row: CsvRow, mechanism: ClosedChain, default: ShotSet) -> ShotRow:
    purpose = columns.shot_set(row, default)
    x_mm, y_mm, z_mm = (row.number(column) for column in columns.POINT_COLUMNS)
    turns = _turns(mechanism)
    turned = any(row.text(column) for column in columns.axis_columns(turns))
    return ShotRow(
        pair=columns.pair_number(row, purpose),
        joints=columns.joint_values(row, mechanism.joints, purpose),
        point_in_tracker_mm=(x_mm, y_mm, z_mm),
        purpose=purpose,
        turn=columns.axis_values(row, turns) if turned else (),
        covariance_mm2=_covariance_of(row),
        time=row.text("time") or None,
        nest=columns.nest_name(row, purpose),
        approach=columns.approach_values(row, mechanism.joints),
        **{name: row.number(name) for name in TEMPERATURES if row.text(name)},
    )


def _covariance_of(row: CsvRow) -> Matrix3 | None:
    empty = [column for column in COVARIANCE_COLUMNS if not row.text(column)]
    if len(empty) == len(COVARIANCE_COLUMNS):
        return None
    if empty:
        raise row.wrong(
            f"covariance without {', '.join(empty)}",
            remedy=f"give all of {','.join(COVARIANCE_COLUMNS)}, in mm², or none",
        )
    xx, xy, xz, yy, yz, zz = (row.number(column) for column in COVARIANCE_COLUMNS)
    covariance = ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    if not is_positive_definite(covariance):
        raise row.wrong(
            "the covariance sxx … szz is not positive definite",
            remedy="check that these are variances and covariances in mm²",
        )
    return covariance


def _texts_of(shot: ShotRow, mechanism: ClosedChain) -> Mapping[str, str]:
    covariance = shot.covariance_mm2
    upper = (*covariance[0], *covariance[1][1:], covariance[2][2]) if covariance else ()
    axes = (mechanism.joints if shot.joints else ()) + (_turns(mechanism) if shot.turn else ())
    values = {
        "pair": "" if shot.pair is None else str(shot.pair),
        "set": shot.purpose.value,
        "time": shot.time or "",
        columns.NEST: shot.nest,
    }
    sides = map(str, shot.approach)
    values |= zip(columns.approach_columns(mechanism.joints), sides, strict=False)
    known = {name: getattr(shot, name) for name in TEMPERATURES}
    values |= {name: number_text(degC) for name, degC in known.items() if degC is not None}
    values |= zip(
        columns.axis_columns(axes), columns.axis_texts(axes, shot.joints + shot.turn), strict=True
    )
    values |= zip(columns.POINT_COLUMNS, map(number_text, shot.point_in_tracker_mm), strict=True)
    values |= dict(zip_longest(COVARIANCE_COLUMNS, map(number_text, upper), fillvalue=""))
    return values
