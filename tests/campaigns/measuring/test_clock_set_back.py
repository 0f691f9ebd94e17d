"""What came first is said by the journal's numbers: a computer's clock may be set back."""

from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
from fake_cell import ROBOT
from journal_story import SESSION, beginning, intent, outcome

from campaigns.evaluation.time_series import time_series
from campaigns.journal.journal import open_journal, read_journal
from campaigns.journal.records import Record
from campaigns.measuring.resume import ResumeState
from campaigns.shots.shots import shots_of_journal

FIRST_MM, SECOND_MM = 1000.0, 1000.4


def backwards() -> Callable[[], str]:
    """A clock that is a second earlier each time it is read."""
    seconds = count()
    return lambda: f"2026-03-02T08:00:{59 - next(seconds):02d}.000+00:00"


def written(folder: Path, *records: Record) -> Path:
    path = folder / "campaign.db"
    with open_journal(path, now_utc=backwards()) as journal:
        series = journal.start_series(beginning())
        for record in records:
            journal.append(record, series=series)
    return path


def test_the_first_drift_shot_and_the_drift_since_it_follow_the_records(tmp_path: Path) -> None:
    first, second = (replace(intent(shot), purpose="drift") for shot in (5, 1))
    path = written(
        tmp_path, SESSION, first, outcome(5, x_mm=FIRST_MM), second, outcome(1, x_mm=SECOND_MM)
    )
    with read_journal(path) as journal:
        accepted = journal.shots(1)
    first_mm = ResumeState(accepted, (), ()).first_drift_mm()
    assert first_mm[""][0] == FIRST_MM
    drift_mm = time_series("run", shots_of_journal(accepted, ROBOT.mechanism)).drift_mm
    np.testing.assert_allclose(drift_mm, [0.0, SECOND_MM - FIRST_MM], atol=1e-9)
