"""Imports into the journal, and exports from it, of shots in files."""

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import number_text
from campaigns.journal import records
from campaigns.journal.journal import Journal
from campaigns.journal.views import AcceptedShot, Series
from campaigns.kinematics.mechanism import Kinematics
from campaigns.robots.robot import pose_of
from campaigns.shots.columns import POINT_COLUMNS
from campaigns.shots.shot_sets import ShotSet, pair_rows
from campaigns.shots.shots_csv import ShotRow, shots_text
from campaigns.version import VERSION
from drivers.bounded_files import CSV_BYTES, FileRefused, read_bounded

IMPORTED = "imported"
FILES = "imported_files"
"""Key in an import's settings: what campaign.yaml does not say of it."""
NOTE = re.compile(
    rf"{IMPORTED}(?:, air (?P<air>[-+.e\d]+) °C)?(?:, measured (?P<time>.*))?", re.DOTALL
)
TOLD_EVERY = 250
DIGITS = 9
"""Decimals of rad and mm that files keep of joints and points."""


def import_note(temperature_degC: float | None, time: str | None) -> str:
    """Note that stands where a tracker's answer would: what no other field of a journal holds."""
    air = "" if temperature_degC is None else f", air {number_text(temperature_degC)} °C"
    return f"{IMPORTED}{air}" + ("" if time is None else f", measured {time}")


def noted(note: str) -> tuple[float | None, str | None]:
    """Temperature in °C and time of a note; None for what it does not say."""
    found = NOTE.fullmatch(note)
    if found is None:
        return None, None
    return None if found["air"] is None else float(found["air"]), found["time"]


@dataclass(frozen=True, slots=True)
class ImportedFile:
    """File that shots were taken from: its name, and the sha256 of its bytes."""

    name: str
    sha256: str

    @classmethod
    def of(cls, path: Path) -> "ImportedFile":
        """File as it is now; raises `ShotsInvalid` when it cannot be read."""
        try:
            return cls(path.name, hashlib.sha256(read_bounded(path, CSV_BYTES)).hexdigest())
        except FileRefused as error:
            raise ShotsInvalid(error.problem, remedy=error.remedy) from error


def imported_files(started: records.SeriesStarted) -> tuple[ImportedFile, ...]:
    """Files of an import; none where older software did not keep them."""
    kept = started.configuration.get(FILES)
    return tuple(
        ImportedFile(str(each.get("name", "")), str(each.get("sha256", "")))
        for each in (kept if isinstance(kept, list) else [])
        if isinstance(each, dict)
    )


def append_import(
    journal: Journal,
    rows: Sequence[ShotRow],
    held: Kinematics,
    robot_digest: str,
    settings: Mapping[str, JsonValue],
    files: Sequence[ImportedFile] = (),
    *,
    stage: records.Stage = "import",
    declared: str = "",
    order: Index | None = None,
    advance: Callable[[int], None] = lambda _: None,
) -> int:
    """Write rows as a finished series, in one commit; gives its number.

    Shots are numbered as the rows, and written in the `order` (N,) in which they were measured;
    `advance` hears now and then how many are written.

    The names and digests of the files go into the series' settings. The commanded pose is not
    known: that of the joints by the set `held` stands for it, the nominal one, or for a validation
    what the controller is `declared` to hold. Raises `ShotsInvalid` for joints that such a robot
    cannot take.
    """
    poses = _poses(held, rows)
    digest = hashlib.sha256(shots_text(rows, held.mechanism).encode()).hexdigest()
    kept: list[JsonValue] = [asdict(each) for each in files]
    known = {**settings, FILES: kept} if kept else settings
    started = records.SeriesStarted(
        stage, digest, known, VERSION, robot_digest, None, None, None, declared
    )
    command: records.Command = "joints" if stage == "import" else "pose"
    with journal.in_one_commit():
        series = journal.start_series(started)
        session = None
        numbers = (np.arange(len(rows)) if order is None else order).tolist()
        for done, number in enumerate(numbers):
            if done % TOLD_EVERY == 0:
                advance(done)
            row, target = rows[number], pose_of(poses[number])
            if row.session != session:
                if session is not None:
                    stopped = records.SessionStopped("finished", "imported")
                    journal.append(stopped, series=series)
                session = row.session
                journal.append(records.SessionStarted(VERSION, None, None, None), series=series)
            set_, pair, nest = row.purpose.value, row.pair, row.nest
            intent = records.Intent(number, 1, set_, target, row.joints, command, pair, nest=nest)
            journal.append(intent, series=series)
            journal.append(_outcome(number, row), series=series)
        journal.append(records.SeriesFinished(), series=series)
        journal.append(records.SessionStopped("finished", "imported"), series=series)
    journal.prove()
    return series


def refuse_copies(rows: Sequence[ShotRow], journal: Iterable[Series], name: str) -> None:
    """Raise `ShotsInvalid` for a row of a pair that is a copy of another or of a journal's shot."""
    seen = {
        _digits(shot.outcome.joints, shot.outcome.point_in_tracker_mm): (shot.intent.shot, series)
        for series in journal
        for shot in series.shots
    }
    own: dict[tuple[float, ...], int] = {}
    for place, row in enumerate(rows):
        key = _digits(row.joints, row.point_in_tracker_mm)
        shot, series = seen.get(key, (own.setdefault(key, place), None))
        if row.purpose.in_pairs and (series or shot != place):
            of = f" of series {series.number} ({series.started.stage})" if series else ""
            raise ShotsInvalid(
                f"{name}: shot {place} is a copy of shot {shot}{of}: its joints and its point are "
                "equal to the last digit",
                remedy="leave it out: what was measured once counts once, and proves nothing of "
                "itself" + ("; --anyway lets this file replace an earlier import" if of else ""),
            )


def _digits(joints: Iterable[float], point_mm: Iterable[float]) -> tuple[float, ...]:
    """Digits that files have of both."""
    return tuple(round(value, DIGITS) for value in (*joints, *point_mm))


def _poses(held: Kinematics, rows: Sequence[ShotRow]) -> Array:
    """Poses (N, t); zeros of shots without the robot."""
    poses = np.zeros((len(rows), len(held.mechanism.task)))
    own = [place for place, row in enumerate(rows) if row.joints]
    if not own:
        return poses
    solution = held.forward(np.array([rows[place].joints for place in own]))
    if not solution.found.all():
        row = own[int(solution.found.argmin())]
        raise ShotsInvalid(
            f"shot {row + 1} of the file: the nominal robot cannot be assembled at its joints",
            remedy="check the order and signs of the joints, and that it is this robot's file",
        )
    poses[own] = solution.values
    return poses


def _outcome(number: int, row: ShotRow) -> records.Outcome:
    return records.Outcome(
        number,
        1,
        row.joints,
        row.point_in_tracker_mm,
        row.covariance_mm2,
        None,  # a file gives the temperature alone: a pressure would be invented
        IMPORTED,
        import_note(row.temperature_degC, row.time),
        None,
        approach=row.approach or None,
        part_temperature_degC=row.part_temperature_degC,
    )


def exported_shots(
    series: Series, shots: Sequence[AcceptedShot], approach: Array | None = None
) -> tuple[tuple[ShotRow, ...], tuple[int, ...]]:
    """A series' accepted shots as rows of a file, and the numbers of those that were left out.

    These are shots whose pair has no second one: the file's readers refuse half a pair. A turn is
    that of the commanded pose; an import knows none. `approach` (N, n): sides of the joints.
    """
    halves = pair_rows([shot.intent.pair for shot in shots]).halves
    whole = [shot for row, shot in enumerate(shots) if row not in halves]
    is_import = series.started.stage == "import"
    rows = tuple(_row(shot, is_import=is_import) for shot in whole)
    if series.sessions > 1:
        sessions = [shot.session for shot in whole]
        rows = tuple(replace(row, session=n) for row, n in zip(rows, sessions, strict=True))
    if approach is not None and approach.any():
        sides = [tuple(map(int, each)) for each in np.delete(approach, halves, axis=0).tolist()]
        rows = tuple(replace(row, approach=own) for row, own in zip(rows, sides, strict=True))
    return rows, tuple(shots[row].intent.shot for row in halves)


def _row(shot: AcceptedShot, *, is_import: bool) -> ShotRow:
    intent, outcome = shot.intent, shot.outcome
    air = None if outcome.weather is None else outcome.weather.temperature_degC
    time: str | None = shot.measured_utc
    if is_import:  # the journal's own time is that of the import
        air, time = noted(outcome.raw_tracker)
    return ShotRow(
        pair=intent.pair,
        joints=outcome.joints if ShotSet(intent.purpose).on_robot else (),
        point_in_tracker_mm=outcome.point_in_tracker_mm,
        purpose=ShotSet(intent.purpose),
        turn=() if is_import else intent.target.coordinates[len(POINT_COLUMNS) :],
        covariance_mm2=outcome.covariance_mm2,
        temperature_degC=air,
        time=time,
        nest=intent.nest,
        part_temperature_degC=outcome.part_temperature_degC,
    )
