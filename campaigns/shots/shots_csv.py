"""shots.csv: measured shots, from and to other software."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import CsvForm, CsvRow, angle_text, csv_text, number_text, parse_csv
from campaigns.files.text_file import read_text, write_text_unless_there
from campaigns.shots.columns import (
    JOINT_COLUMNS,
    POINT_COLUMNS,
    PairedRow,
    angle_rad,
    check_pairs,
    joints_rad,
    pair_number,
    shot_set,
)
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import is_positive_definite
from drivers.values import Matrix3, Vector3

COVARIANCE_COLUMNS = ("sxx", "sxy", "sxz", "syy", "syz", "szz")

_FORM = CsvForm(
    required=("pair", *JOINT_COLUMNS, *POINT_COLUMNS),
    optional=("set", "theta_deg", *COVARIANCE_COLUMNS, "temperature_degC", "time"),
    invalid=ShotsInvalid,
)


@dataclass(frozen=True, slots=True)
class ShotRow:
    """One measured shot: encoder angles, and the reflector's place in the tracker's frame.

    `pair` is None for sets without pairs. `time` is as the file says it. None: not known.
    """

    pair: int | None
    joints_rad: tuple[float, ...]
    point_in_tracker_mm: Vector3
    purpose: ShotSet = ShotSet.IDENTIFICATION
    theta_rad: float | None = None
    covariance_mm2: Matrix3 | None = None
    temperature_degC: float | None = None
    time: str | None = None


def read_shots(path: Path) -> tuple[ShotRow, ...]:
    """Read measured shots, in the file's order; raises `ShotsInvalid`."""
    text = read_text(path, ShotsInvalid, if_missing="check the file's name")
    return parse_shots(text, str(path))


def write_shots(path: Path, shots: Sequence[ShotRow], *, overwrite: bool = False) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`."""
    write_text_unless_there(path, shots_text(shots), overwrite=overwrite)


def parse_shots(text: str, name: str) -> tuple[ShotRow, ...]:
    """Read shots from a file's text; raises `ShotsInvalid` with the line."""
    rows = list(parse_csv(text, name, _FORM))
    if not rows:
        raise ShotsInvalid(f"{name}: holds no shots", remedy="check that it is the right file")
    shots = tuple(_shot_of(row) for row in rows)
    check_pairs(
        [PairedRow(row, shot.purpose, shot.pair) for row, shot in zip(rows, shots, strict=True)]
    )
    return shots


def shots_text(shots: Sequence[ShotRow]) -> str:
    """Write shots as the text of a file, with the optional columns that any of them fills."""
    texts = [_texts_of(shot) for shot in shots]
    filled = [column for column in _FORM.optional if any(row[column] for row in texts)]
    header = (*_FORM.required, *filled)
    return csv_text(header, [[row[column] for column in header] for row in texts])


def _shot_of(row: CsvRow) -> ShotRow:
    purpose = shot_set(row) if row.text("set") else ShotSet.IDENTIFICATION
    x_mm, y_mm, z_mm = (row.number(column) for column in POINT_COLUMNS)
    return ShotRow(
        pair=pair_number(row, purpose),
        joints_rad=joints_rad(row),
        point_in_tracker_mm=(x_mm, y_mm, z_mm),
        purpose=purpose,
        theta_rad=angle_rad(row, "theta_deg") if row.text("theta_deg") else None,
        covariance_mm2=_covariance_of(row),
        temperature_degC=row.number("temperature_degC") if row.text("temperature_degC") else None,
        time=row.text("time") or None,
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


def _texts_of(shot: ShotRow) -> Mapping[str, str]:
    covariance = shot.covariance_mm2
    upper = (*covariance[0], *covariance[1][1:], covariance[2][2]) if covariance else ()
    temperature = shot.temperature_degC
    values = {
        "pair": "" if shot.pair is None else str(shot.pair),
        "set": shot.purpose.value,
        "theta_deg": "" if shot.theta_rad is None else angle_text(shot.theta_rad),
        "temperature_degC": "" if temperature is None else number_text(temperature),
        "time": shot.time or "",
    }
    values |= zip(JOINT_COLUMNS, map(angle_text, shot.joints_rad), strict=True)
    values |= zip(POINT_COLUMNS, map(number_text, shot.point_in_tracker_mm), strict=True)
    values |= dict(zip_longest(COVARIANCE_COLUMNS, map(number_text, upper), fillvalue=""))
    return values
