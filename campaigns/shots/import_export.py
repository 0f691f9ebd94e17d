"""Imports into the journal, and exports from it, of shots in files.

An import becomes a series like a measured one, so that everything after it needs no second way:
each row is an intent and an outcome, in sessions, finished at once. All of it is one commit: an
import that breaks off leaves nothing. What a file does not state is left empty, but for the
commanded pose, for which the pose at the joints stands. Air temperature and time of measurement,
for which such records have no field, are written as a note in the place of the tracker's answer.
"""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.journal import records
from campaigns.journal.journal import Journal
from campaigns.journal.views import AcceptedShot, Series
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import pose_of
from campaigns.shots.shot_sets import ShotSet, pair_rows
from campaigns.shots.shots import IMPORTED, import_note, read_note, rows_of_shots, shots_of_journal
from campaigns.shots.shots_csv import ShotRow, shots_text
from campaigns.shots.stops import AVERAGED
from campaigns.version import VERSION
from drivers.bounded_files import CSV_BYTES, FileRefused, read_bounded

FILES_KEY = "imported_files"
"""Key in an import's settings, beside those of campaign.yaml, for the files it was read from."""
FILE_DECIMALS = 9
"""Number of decimals of rad and mm that files keep of joints and points."""


@dataclass(frozen=True, slots=True)
class ImportedFile:
    """File that shots were taken from: its name, and the sha256 of its bytes."""

    name: str
    sha256: str

    @classmethod
    def of(cls, path: Path) -> "ImportedFile":
        """Describe a file as it is now; raise `ShotsInvalid` when it cannot be read."""
        try:
            return cls(path.name, hashlib.sha256(read_bounded(path, CSV_BYTES)).hexdigest())
        except FileRefused as error:
            raise ShotsInvalid(error.problem, remedy=error.remedy) from error


@dataclass(frozen=True, slots=True)
class ImportedSeries:
    """Series that an import becomes: whose shots they are, and where they came from."""

    robot_digest: str
    """Digest of the nominal robot's file."""
    settings: Mapping[str, JsonValue]
    """Settings in campaign.yaml."""
    files: Sequence[ImportedFile] = ()
    stage: records.Stage = "import"
    declared: str = ""
    """File of the parameters that the controller is said to hold, or of a check's shots; "" for
    identification shots."""


def imported_files(started: records.SeriesStarted) -> tuple[ImportedFile, ...]:
    """Return the files of an import; none where older software did not keep them."""
    entries = started.configuration.get(FILES_KEY)
    return tuple(
        ImportedFile(str(entry.get("name", "")), str(entry.get("sha256", "")))
        for entry in (entries if isinstance(entries, list) else [])
        if isinstance(entry, dict)
    )


def append_import(
    journal: Journal,
    rows: Sequence[ShotRow],
    held: Kinematics,
    imported: ImportedSeries,
    order: Index | None = None,
) -> int:
    """Write rows as a finished series, in one commit; return its number.

    Shots are numbered as the rows, and written in the `order` (N,) in which they were measured.

    Names and digests of files go into the series' settings. The commanded pose is not known: the
    pose at the joints stands for it, by the parameters that the controller `held`, the nominal ones
    or, for a validation, those that it is declared to hold. Raises `ShotsInvalid` for joints that
    such a robot cannot take.
    """
    poses = _poses(held, rows)
    digest = hashlib.sha256(shots_text(rows, held.mechanism).encode()).hexdigest()
    # 1. Everything that can be wrong with the rows comes before the first record.
    entries: list[JsonValue] = [asdict(file) for file in imported.files]
    config = {**imported.settings, FILES_KEY: entries} if entries else imported.settings
    digest_of_robot, declared = imported.robot_digest, imported.declared
    started = records.SeriesStarted(
        imported.stage, digest, config, VERSION, digest_of_robot, None, None, None, declared
    )
    by_joints = imported.stage in {"import", "check"}
    command: records.Command = "joints" if by_joints else "pose"
    # 2. All records in one commit. A row of another session ends the session before.
    with journal.in_one_commit():
        series = journal.start_series(started)
        session = None
        numbers = (np.arange(len(rows)) if order is None else order).tolist()
        for number in numbers:
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
            outcome = records.Outcome(
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
            journal.append(outcome, series=series)
        journal.append(records.SeriesFinished(), series=series)
        journal.append(records.SessionStopped("finished", "imported"), series=series)
    # 3. Read the journal again, as after any write that must not be lost.
    journal.prove()
    return series


def refuse_copies(rows: Sequence[ShotRow], journal: Iterable[Series], name: str) -> None:
    """Raise `ShotsInvalid` for a row of a pair that is a copy of another or of a journal's shot."""
    # Measurements of two stops never agree to the last digit in all joints and coordinates. A copy
    # would count twice in the fit, and a hold-out pair that was fitted would confirm any model.
    # Samples of one stop may agree: they count once. Sets without pairs may repeat: they are visits
    # of one place, and simulated ones may be equal.
    seen = {
        _as_in_files(shot.outcome.joints, shot.outcome.point_in_tracker_mm): (
            shot.intent.shot,
            series,
        )
        for series in journal
        for shot in series.shots
    }
    places: dict[tuple[float, ...], int] = {}
    for place, row in enumerate(rows):
        key = _as_in_files(row.joints, row.point_in_tracker_mm)
        shot, series = seen.get(key, (places.setdefault(key, place), None))
        is_copy = bool(series) or not _are_samples(rows[shot : place + 1])
        if (row.purpose.in_pairs or row.purpose is ShotSet.CHECK) and is_copy:
            of = f" of series {series.number} ({series.started.stage})" if series else ""
            raise ShotsInvalid(
                f"{name}: shot {place} is a copy of shot {shot}{of}: its joints and its point are "
                "equal to the last digit",
                remedy="leave it out: what was measured once counts once, and proves nothing of "
                "itself" + ("; --force lets this file replace an earlier import" if of else ""),
            )


def _are_samples(rows: Sequence[ShotRow]) -> bool:
    """Return whether consecutive rows are samples of one stop, or a single row."""
    stops = {(row.purpose, row.session, _as_in_files(row.joints, ())) for row in rows}
    return len(rows) == 1 or (len(stops) == 1 and rows[0].purpose in AVERAGED)


def _as_in_files(joints: Iterable[float], point_mm: Iterable[float]) -> tuple[float, ...]:
    """Round joints and point to the digits that files have."""
    return tuple(round(value, FILE_DECIMALS) for value in (*joints, *point_mm))


def _poses(held: Kinematics, rows: Sequence[ShotRow]) -> Array:
    """Return the poses (N, t) of rows at their joints, zeros for rows without the robot.

    Raise `ShotsInvalid` for joints that the robot cannot take.
    """
    poses = np.zeros((len(rows), len(held.mechanism.task)))
    by_robot = [place for place, row in enumerate(rows) if row.joints]
    if not by_robot:
        return poses
    solution = held.forward(np.array([rows[place].joints for place in by_robot]))
    if not solution.is_solved.all():
        row = by_robot[int(solution.is_solved.argmin())]
        raise ShotsInvalid(
            f"shot {row + 1} of the file: the nominal robot cannot be assembled at its joints",
            remedy="check the order and signs of the joints, and that it is this robot's file",
        )
    poses[by_robot] = solution.values
    return poses


def exported_shots(
    series: Series, shots: Sequence[AcceptedShot], mechanism: Mechanism
) -> tuple[tuple[ShotRow, ...], tuple[int, ...]]:
    """Return a series' accepted shots as rows of a file, and the numbers of those left out.

    These are shots whose pair has no second one: the file's readers refuse half a pair.
    """
    shots = [shot for shot in shots if not shot.intent.reflector]
    halves = pair_rows([shot.intent.pair for shot in shots]).halves
    whole = np.delete(np.arange(len(shots)), halves)
    rows = rows_of_shots(shots_of_journal(shots, mechanism).rows(whole))
    # Of an import the journal has its own time and a computed pose: neither was in the file that it
    # came from, whose air temperature and time are in the notes.
    if series.started.stage == "import":
        notes = [read_note(shots[row].outcome.raw_tracker) for row in whole.tolist()]
        rows = tuple(
            replace(row, turn=(), temperature_degC=air, time=time)
            for row, (air, time) in zip(rows, notes, strict=True)
        )
    return rows, tuple(shots[row].intent.shot for row in halves)
