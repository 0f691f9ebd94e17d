"""Takes shots measured with other software into the journal."""

import hashlib
from collections.abc import Mapping, Sequence

import numpy as np
from pydantic import JsonValue

from campaigns.errors import ShotsInvalid
from campaigns.journal.journal import Journal
from campaigns.journal.records import (
    Intent,
    Outcome,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    SessionStopped,
)
from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import Array, Geometry
from campaigns.robots.arrays import pose_of
from campaigns.shots.exchange import ShotRow, shots_text
from campaigns.shots.import_note import IMPORTED, import_note
from campaigns.version import VERSION


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
