"""plan.csv: one row a shot, readable and editable; and whether it is the plan that was measured.

The file is the plan: users may reorder, remove or change rows, and a run takes them as they stand.
Three things follow. Each row states both a pose and its joints, which the plan's check compares.
A plan is identified by the digest of its text as this software writes it, so that columns in
another order or blanks make no other plan. And before a run goes on, each measured shot is compared
with its row: a number that means another shot by now belongs to another series.
"""

import hashlib
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path

import numpy as np

from campaigns.errors import CampaignError, PlanInvalid, WriteFailed
from campaigns.files.csv_file import CsvColumn, CsvForm, CsvRow, parse_csv, whole_column
from campaigns.files.text_file import read_text, replace_text
from campaigns.journal.records import Intent
from campaigns.journal.views import Series
from campaigns.kinematics.mechanism import Mechanism
from campaigns.robots.robot import pose_of
from campaigns.shots import columns
from campaigns.shots.shot_sets import ShotSet
from drivers.bounded_files import CSV_BYTES
from drivers.values import Pose

OPTIONS = "options"
"""Column whose first row names the options of `pkmcal plan` that the plan was made with."""
FORMER_COLUMNS = ("asked", "model")
"""Columns of older plans, which are read without effect."""

REMEDY = "make one with `pkmcal plan DIR`"
SAME_POSE_MM, SAME_POSE_RAD = 1e-3, 1e-5
"""Largest differences of equal poses: rounding in files is far below, an edited pose far above."""
OF_PLAN = frozenset({ShotSet.VALIDATION.value, ShotSet.CHECK.value})
"""Sets of validations and checks whose poses are those of the plan."""


@dataclass(frozen=True, slots=True)
class PlannedShot:
    """Shot to be taken: where the plate shall be, and the joint values that bring it there."""

    shot: int
    purpose: ShotSet
    pair: int | None
    """Number of the pair that the shot belongs to; None for sets without pairs."""
    pose: Pose
    """Pose of the controlled point in the base frame."""
    joints: tuple[float, ...]
    """Joint values (n,), rad or mm."""
    nest: str = ""
    """Fixed place whose reflector is measured while the robot stands; "": the robot's reflector."""
    reflector: str = ""
    """Object of campaign.yaml where the robot's reflector sits; "": where robot.yaml says."""


def plan_form(mechanism: Mechanism) -> CsvForm:
    """Return the columns of a robot's plan: its pose, then its joints."""
    return CsvForm(
        (
            whole_column("shot", required=True),
            CsvColumn("set", required=True),
            whole_column("pair", required=True),
            *columns.columns_of(mechanism.task),
            *columns.columns_of(mechanism.joints),
            *map(CsvColumn, (columns.NEST, columns.REFLECTOR, OPTIONS, *FORMER_COLUMNS)),
        ),
        PlanInvalid,
    )


def read_plan(path: Path, mechanism: Mechanism) -> tuple[PlannedShot, ...]:
    """Read a plan in the order in which it will be run; raise `PlanInvalid`."""
    text = read_text(path, PlanInvalid, if_missing=REMEDY, most_bytes=CSV_BYTES)
    return parse_plan(text, str(path), mechanism)


def read_options(path: Path, mechanism: Mechanism) -> tuple[str, ...]:
    """Return the words of the options that a plan was made with; () where it does not state any."""
    try:
        text = read_text(path, PlanInvalid, if_missing=REMEDY, most_bytes=CSV_BYTES)
        rows = parse_csv(text, str(path), plan_form(mechanism))
        stated = next((row.text(OPTIONS) for row in rows if row.text(OPTIONS)), "")
        return tuple(shlex.split(stated))
    except (CampaignError, ValueError):  # spoilt rows, or quotes that somebody edited
        return ()


def write_plan(
    path: Path, shots: Sequence[PlannedShot], mechanism: Mechanism, options: Sequence[str] = ()
) -> None:
    """Write a plan, in place of an older one; raise `WriteFailed`.

    `options` are the words of the options that it was made with.
    """
    replace_text(path, plan_text(shots, mechanism, options))


def write_beside_older(
    path: Path, shots: Sequence[PlannedShot], mechanism: Mechanism, options: Sequence[str] = ()
) -> Path | None:
    """Write a plan, and keep an older one as `plan-older-N.csv` with the first free number.

    Return the older plan's path; None without one. If writing fails the older plan stays in its
    place. Raise `WriteFailed`.
    """
    older = move_aside(path)
    try:
        write_plan(path, shots, mechanism, options)
    except CampaignError:
        if older is not None:
            older.rename(path)
        raise
    return older


def plan_digest(shots: Sequence[PlannedShot], mechanism: Mechanism) -> str:
    """Return the SHA-256 of the plan's text: equal before writing and after reading."""
    # Of the text as we write it, not of the file's bytes: the layout of a file means nothing.
    return hashlib.sha256(plan_text(shots, mechanism).encode("utf-8")).hexdigest()


def plan_text(
    shots: Sequence[PlannedShot], mechanism: Mechanism, options: Sequence[str] = ()
) -> str:
    """Return the text of a plan's file, with the words of the options that it was made with."""
    return plan_form(mechanism).text(
        [
            {
                "shot": shot.shot,
                "set": shot.purpose.value,
                "pair": shot.pair,
                columns.NEST: shot.nest,
                columns.REFLECTOR: shot.reflector,
                OPTIONS: "" if row else shlex.join(options),
                **columns.axis_cells(mechanism.task, shot.pose.coordinates),
                **columns.axis_cells(mechanism.joints, shot.joints),
            }
            for row, shot in enumerate(shots)
        ]
    )


def parse_plan(text: str, name: str, mechanism: Mechanism) -> tuple[PlannedShot, ...]:
    """Return the plan of a file's text; raise `PlanInvalid` with the line."""
    rows = list(parse_csv(text, name, plan_form(mechanism)))
    if not rows:
        raise PlanInvalid(f"{name}: holds no shots", remedy="make a plan with `pkmcal plan DIR`")
    shots = tuple(_shot_of(row, mechanism) for row in rows)
    numbers = set[int]()
    for row, shot in zip(rows, shots, strict=True):
        if shot.shot in numbers:
            raise row.wrong(
                f"shot {shot.shot} stands twice", remedy="give each shot a number of its own"
            )
        numbers.add(shot.shot)
    columns.check_pairs(rows, [shot.purpose for shot in shots], [shot.pair for shot in shots])
    return shots


def plan_difference(measured: Iterable[Intent], planned: Sequence[PlannedShot]) -> str:
    """Name the first shot that was measured as another one than the plan has; "" if none was.

    Rows that were taken out since, or added, make no difference, as long as one is left.
    """
    # Users may shorten or extend a plan between runs. Only a number that means another shot than
    # before is a difference, for the journal and the file then contradict each other.
    rows = {shot.shot: shot for shot in planned}
    intents = list(measured)
    common = [intent for intent in intents if intent.shot in rows]
    if intents and not common:
        return "none of its shots is in plan.csv any more"
    for intent in common:
        row = rows[intent.shot]
        measured_for = intent.purpose, intent.pair, intent.nest, intent.reflector
        if measured_for != (row.purpose.value, row.pair, row.nest, row.reflector):
            return (
                f"shot {intent.shot} was measured for another set, pair, nest or reflector than "
                "plan.csv has now"
            )
        if not _is_same_pose(intent, row):
            return f"shot {intent.shot} was measured at another pose than plan.csv has now"
    return ""


def series_by_plan(plan: Sequence[PlannedShot], all_series: Iterable[Series]) -> Series | None:
    """Return the latest series whose shots were, or may have been, measured by a plan; else None.

    Those are a run of the plan, a validation or check at its poses, and any import: its file does
    not say by which plan it was measured.
    """
    by_plan = (each for each in all_series if each.shots and _is_by_plan(each, plan))
    return max(by_plan, key=lambda series: series.number, default=None)


def _is_by_plan(series: Series, plan: Sequence[PlannedShot]) -> bool:
    intents = [shot.intent for shot in series.shots]
    if series.started.imported:
        return True
    if series.started.stage == "run":
        return not plan_difference(intents, plan)
    places = {_place(row.pose) for row in plan}
    return any(_place(i.target) in places for i in intents if i.purpose in OF_PLAN)


def _place(pose: Pose) -> tuple[float, ...]:
    """Return a pose's place to 0.01 mm."""
    return tuple(round(value, 2) for value in pose.coordinates[:3])


def _is_same_pose(intent: Intent, row: PlannedShot) -> bool:
    """Return whether pose and joints of a measured shot are those of a planned row."""
    if len(intent.target_joints) != len(row.joints):
        return False
    # a pose that states no turn counts as unturned
    both = zip_longest(intent.target.coordinates, row.pose.coordinates, fillvalue=0.0)
    away = np.abs([measured - planned for measured, planned in both])
    is_near = away[:3].max() <= SAME_POSE_MM and away[3:].max(initial=0.0) <= SAME_POSE_RAD
    joints_away = np.abs(np.subtract(intent.target_joints, row.joints))
    return bool(is_near and joints_away.max() <= SAME_POSE_RAD)


def older_plans(path: Path) -> list[Path]:
    """Return the older plans that are kept beside a plan."""
    return sorted(path.parent.glob(f"{path.stem}-older-*.csv"))


def move_aside(path: Path) -> Path | None:
    """Rename an existing file to the first free `NAME-older-N`, with its suffix; return that path.

    Return None if there is no file. Raise `WriteFailed`.
    """
    if not path.exists():
        return None
    number = 1
    while (older := path.with_name(f"{path.stem}-older-{number}{path.suffix}")).exists():
        number += 1
    try:
        return path.rename(older)
    except OSError as error:
        raise WriteFailed(
            f"{path}: cannot be renamed to {older.name} ({error.strerror})",
            remedy="check that this user may write the folder",
        ) from error


def _shot_of(row: CsvRow, mechanism: Mechanism) -> PlannedShot:
    purpose = columns.shot_set(row)
    return PlannedShot(
        shot=row.value("shot"),
        purpose=purpose,
        pair=columns.pair_number(row, purpose),
        pose=pose_of(columns.axis_values(row, mechanism.task)),
        joints=row.values(columns.axis_columns(mechanism.joints)),
        nest=columns.nest_name(row, purpose),
        reflector=columns.reflector_name(row, purpose),
    )
