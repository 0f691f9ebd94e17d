"""Imports into the journal, and exports from it, of shots in files."""

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
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.mechanism import Kinematics
from campaigns.robots.robot import pose_of
from campaigns.shots.shot_sets import pair_rows
from campaigns.shots.shots import IMPORTED, import_note, noted, rows_of_shots, shots_of_journal
from campaigns.shots.shots_csv import ShotRow, shots_text
from campaigns.version import VERSION
from drivers.bounded_files import CSV_BYTES, FileRefused, read_bounded

FILES = "imported_files"
"""Key in an import's settings: what campaign.yaml does not say of it."""
DIGITS = 9
"""Decimals of rad and mm that files keep of joints and points."""


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


def imported_files(started: records.SeriesStarted) -> tuple[ImportedFile, ...]:
    """Return the files of an import; none where older software did not keep them."""
    kept = started.configuration.get(FILES)
    return tuple(
        ImportedFile(str(entry.get("name", "")), str(entry.get("sha256", "")))
        for entry in (kept if isinstance(kept, list) else [])
        if isinstance(entry, dict)
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
) -> int:
    """Write rows as a finished series, in one commit; gives its number.

    Shots are numbered as the rows, and written in the `order` (N,) in which they were measured.

    The names and digests of the files go into the series' settings. The commanded pose is not
    known: that of the joints by the set `held` stands for it, the nominal one, or for a validation
    what the controller is `declared` to hold. Raises `ShotsInvalid` for joints that such a robot
    cannot take.
    """
    poses = _poses(held, rows)
    digest = hashlib.sha256(shots_text(rows, held.mechanism).encode()).hexdigest()
    kept: list[JsonValue] = [asdict(each) for each in files]
    config = {**settings, FILES: kept} if kept else settings
    started = records.SeriesStarted(
        stage, digest, config, VERSION, robot_digest, None, None, None, declared
    )
    command: records.Command = "joints" if stage == "import" else "pose"
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
    journal.prove()
    return series


def refuse_copies(rows: Sequence[ShotRow], journal: Iterable[Series], name: str) -> None:
    """Raise `ShotsInvalid` for a row of a pair that is a copy of another or of a journal's shot."""
    seen = {
        _digits(shot.outcome.joints, shot.outcome.point_in_tracker_mm): (shot.intent.shot, series)
        for series in journal
        for shot in series.shots
    }
    places: dict[tuple[float, ...], int] = {}
    for place, row in enumerate(rows):
        key = _digits(row.joints, row.point_in_tracker_mm)
        shot, series = seen.get(key, (places.setdefault(key, place), None))
        if row.purpose.in_pairs and (series or shot != place):
            of = f" of series {series.number} ({series.started.stage})" if series else ""
            raise ShotsInvalid(
                f"{name}: shot {place} is a copy of shot {shot}{of}: its joints and its point are "
                "equal to the last digit",
                remedy="leave it out: what was measured once counts once, and proves nothing of "
                "itself" + ("; --force lets this file replace an earlier import" if of else ""),
            )


def _digits(joints: Iterable[float], point_mm: Iterable[float]) -> tuple[float, ...]:
    """Round both to the digits that files have."""
    return tuple(round(value, DIGITS) for value in (*joints, *point_mm))


def _poses(held: Kinematics, rows: Sequence[ShotRow]) -> Array:
    """Return poses (N, t); zeros of shots without the robot."""
    poses = np.zeros((len(rows), len(held.mechanism.task)))
    placed = [place for place, row in enumerate(rows) if row.joints]
    if not placed:
        return poses
    solution = held.forward(np.array([rows[place].joints for place in placed]))
    if not solution.is_solved.all():
        row = placed[int(solution.is_solved.argmin())]
        raise ShotsInvalid(
            f"shot {row + 1} of the file: the nominal robot cannot be assembled at its joints",
            remedy="check the order and signs of the joints, and that it is this robot's file",
        )
    poses[placed] = solution.values
    return poses


def exported_shots(
    series: Series, shots: Sequence[AcceptedShot], mechanism: ClosedChain
) -> tuple[tuple[ShotRow, ...], tuple[int, ...]]:
    """Return a series' accepted shots as rows of a file, and the numbers of those left out.

    These are shots whose pair has no second one: the file's readers refuse half a pair.
    """
    halves = pair_rows([shot.intent.pair for shot in shots]).halves
    whole = np.delete(np.arange(len(shots)), halves)
    rows = rows_of_shots(shots_of_journal(shots, mechanism).rows(whole))
    if series.started.stage == "import":  # the journal has its own time, and a computed pose
        notes = [noted(shots[row].outcome.raw_tracker) for row in whole.tolist()]
        rows = tuple(
            replace(row, turn=(), temperature_degC=air, time=time)
            for row, (air, time) in zip(rows, notes, strict=True)
        )
    return rows, tuple(shots[row].intent.shot for row in halves)
