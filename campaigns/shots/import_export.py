"""What an imported shot came with that no other field of a journal holds: its air and its time."""

import hashlib
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import number_text
from campaigns.journal.journal import Journal
from campaigns.journal.records import (
    Intent,
    Outcome,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    SessionStopped,
)
from campaigns.journal.views import AcceptedShot, Series
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import Geometry
from campaigns.robots.robot import pose_of
from campaigns.shots.columns import SHOTS_OF_A_PAIR
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow, shots_text
from campaigns.version import VERSION

IMPORTED = "imported"
NOTE = re.compile(
    rf"{IMPORTED}(?:, air (?P<air>[-+.e\d]+) °C)?(?:, measured (?P<time>.*))?", re.DOTALL
)


def import_note(temperature_degC: float | None, time: str | None) -> str:
    """The note that stands where a tracker's answer would."""
    air = "" if temperature_degC is None else f", air {number_text(temperature_degC)} °C"
    return f"{IMPORTED}{air}" + ("" if time is None else f", measured {time}")


def noted(note: str) -> tuple[float | None, str | None]:
    """The temperature in °C and the time of a note; None for what it does not say."""
    found = NOTE.fullmatch(note)
    if found is None:
        return None, None
    return None if found["air"] is None else float(found["air"]), found["time"]


def append_import(
    journal: Journal,
    rows: Sequence[ShotRow],
    nominal: Geometry,
    robot_digest: str,
    settings: Mapping[str, JsonValue],
) -> int:
    """Write rows as a finished series of stage `import`; gives its number.

    The commanded pose is not known: the nominal model's pose of the joints stands for it. Raises
    `ShotsInvalid` for joints that the nominal robot cannot take.
    """
    poses = _nominal_poses(nominal, rows)
    digest = hashlib.sha256(shots_text(rows).encode()).hexdigest()
    started = SeriesStarted("import", digest, settings, VERSION, robot_digest, None, None, None)
    series = journal.start_series(started)
    journal.append(SessionStarted(VERSION, None, None, None), series=series)
    for number, (row, pose) in enumerate(zip(rows, poses, strict=True)):
        target = pose_of(pose)
        journal.append(
            Intent(number, 1, row.purpose.value, target, row.joints_rad, "joints", row.pair),
            series=series,
        )
        journal.append(_outcome(number, row), series=series)
    journal.append(SeriesFinished(), series=series)
    journal.append(SessionStopped("finished", "imported"), series=series)
    return series


def _nominal_poses(nominal: Geometry, rows: Sequence[ShotRow]) -> Array:
    solution = forward(nominal, np.array([row.joints_rad for row in rows]))
    if not solution.found.all():
        row = int(solution.found.argmin())
        raise ShotsInvalid(
            f"shot {row + 1} of the file: the nominal robot cannot be assembled at its joints",
            remedy="check the order and signs of the joints, and that it is this robot's file",
        )
    return solution.values


def _outcome(number: int, row: ShotRow) -> Outcome:
    return Outcome(
        number,
        1,
        row.joints_rad,
        row.point_in_tracker_mm,
        row.covariance_mm2,
        None,  # a file gives the temperature alone: a pressure would be invented
        IMPORTED,
        import_note(row.temperature_degC, row.time),
        None,
    )


@dataclass(frozen=True, slots=True)
class ExportedShots:
    """Rows by shot number, and the numbers of what was left out."""

    rows: tuple[ShotRow, ...]
    halves: tuple[int, ...]
    """Shots whose pair has no second one: the file's readers refuse half a pair."""


def exported_shots(series: Series, shots: Sequence[AcceptedShot]) -> ExportedShots:
    """Turn a series' accepted shots into rows, whole pairs only.

    θ is that of the commanded pose; an import knows none.
    """
    sizes = Counter(shot.intent.pair for shot in shots)
    lone = {pair for pair, size in sizes.items() if pair is not None and size < SHOTS_OF_A_PAIR}
    whole = [shot for shot in shots if shot.intent.pair not in lone]
    halves = tuple(shot.intent.shot for shot in shots if shot.intent.pair in lone)
    is_import = series.started.stage == "import"
    return ExportedShots(tuple(_row(shot, is_import=is_import) for shot in whole), halves)


def _row(shot: AcceptedShot, *, is_import: bool) -> ShotRow:
    intent, outcome = shot.intent, shot.outcome
    air = None if outcome.weather is None else outcome.weather.temperature_degC
    time: str | None = shot.measured_utc
    if is_import:  # the journal's own time is that of the import
        air, time = noted(outcome.raw_tracker)
    return ShotRow(
        pair=intent.pair,
        joints_rad=outcome.joints_rad,
        point_in_tracker_mm=outcome.point_in_tracker_mm,
        purpose=ShotSet(intent.purpose),
        theta_rad=None if is_import else intent.target.theta_rad,
        covariance_mm2=outcome.covariance_mm2,
        temperature_degC=air,
        time=time,
    )
