"""plan.csv: one row a shot, readable and editable."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import PlanInvalid
from campaigns.files.csv_file import CsvForm, CsvRow, angle_text, csv_text, number_text, parse_csv
from campaigns.files.text_file import read_text, replace_text
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
from drivers.values import Pose

COLUMNS = ("shot", "set", "pair", *POINT_COLUMNS, "theta_deg", *JOINT_COLUMNS)

_FORM = CsvForm(required=COLUMNS, optional=(), invalid=PlanInvalid)


@dataclass(frozen=True, slots=True)
class PlannedShot:
    """One shot to be taken: where the plate shall be, and the encoder angles that bring it there.

    The pose is the controlled point in the base frame. `pair` is None for sets without pairs.
    """

    shot: int
    purpose: ShotSet
    pair: int | None
    pose: Pose
    joints_rad: tuple[float, ...]


def read_plan(path: Path) -> tuple[PlannedShot, ...]:
    """Read a plan, in the order in which it will be run; raises `PlanInvalid`."""
    text = read_text(path, PlanInvalid, if_missing="make one with `pkmcal plan`")
    return parse_plan(text, str(path))


def write_plan(path: Path, shots: Sequence[PlannedShot]) -> None:
    """Write a plan, in place of an older one; raises `WriteFailed`."""
    replace_text(path, plan_text(shots))


def plan_digest(shots: Sequence[PlannedShot]) -> str:
    """Return the sha256 of the plan's text: the same before writing and after reading."""
    return hashlib.sha256(plan_text(shots).encode("utf-8")).hexdigest()


def plan_text(shots: Sequence[PlannedShot]) -> str:
    """Write a plan as the text of its file."""
    return csv_text(COLUMNS, [_row_of(shot) for shot in shots])


def parse_plan(text: str, name: str) -> tuple[PlannedShot, ...]:
    """Read a plan from its text; raises `PlanInvalid` with the line."""
    rows = list(parse_csv(text, name, _FORM))
    if not rows:
        raise PlanInvalid(f"{name}: holds no shots", remedy="make a plan with `pkmcal plan`")
    shots = tuple(_shot_of(row) for row in rows)
    _check_numbers(rows, shots)
    check_pairs(
        [PairedRow(row, shot.purpose, shot.pair) for row, shot in zip(rows, shots, strict=True)]
    )
    return shots


def _check_numbers(rows: Sequence[CsvRow], shots: Sequence[PlannedShot]) -> None:
    seen: set[int] = set()
    for row, shot in zip(rows, shots, strict=True):
        if shot.shot in seen:
            raise row.wrong(
                f"shot {shot.shot} stands twice", remedy="give each shot a number of its own"
            )
        seen.add(shot.shot)


def _shot_of(row: CsvRow) -> PlannedShot:
    purpose = shot_set(row)
    x_mm, y_mm, z_mm = (row.number(column) for column in POINT_COLUMNS)
    return PlannedShot(
        shot=row.whole_number("shot"),
        purpose=purpose,
        pair=pair_number(row, purpose),
        pose=Pose(x_mm, y_mm, z_mm, angle_rad(row, "theta_deg")),
        joints_rad=joints_rad(row),
    )


def _row_of(shot: PlannedShot) -> list[str]:
    pose = shot.pose
    return [
        str(shot.shot),
        shot.purpose.value,
        "" if shot.pair is None else str(shot.pair),
        *(number_text(value) for value in (pose.x_mm, pose.y_mm, pose.z_mm)),
        *(angle_text(value) for value in (pose.theta_rad, *shot.joints_rad)),
    ]
