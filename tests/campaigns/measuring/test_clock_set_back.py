"""What came first is said by the journal's numbers: a computer's clock may be set back."""

from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path

import numpy as np
from fake_cell import ROBOT
from journal_story import SESSION, STOPPED, beginning, intent, outcome

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


def drift_shots(folder: Path) -> Path:
    first, second = (replace(intent(shot), purpose="drift") for shot in (5, 1))
    return written(
        folder, SESSION, first, outcome(5, x_mm=FIRST_MM), second, outcome(1, x_mm=SECOND_MM)
    )


def test_the_first_drift_shot_is_the_first_by_record(tmp_path: Path) -> None:
    with read_journal(drift_shots(tmp_path)) as journal:
        first_mm = ResumeState(journal.shots(1), (), ()).first_drift_mm()
    assert first_mm is not None
    assert first_mm[0] == FIRST_MM


def test_drift_is_drawn_from_the_first_shot_by_record(tmp_path: Path) -> None:
    with read_journal(drift_shots(tmp_path)) as journal:
        shots = shots_of_journal(journal.shots(1), ROBOT.mechanism)
    drift_mm = time_series("run", shots).drift_mm
    np.testing.assert_allclose(drift_mm, [0.0, SECOND_MM - FIRST_MM], atol=1e-9)
    again = shots.rows(np.array([1, 0]))
    np.testing.assert_allclose(time_series("run", again).drift_mm, drift_mm, atol=1e-9)
    assert again.records == shots.records[::-1]


def test_a_shot_is_of_the_session_that_began_before_it_by_record(tmp_path: Path) -> None:
    path = written(
        tmp_path, SESSION, intent(1), outcome(1), STOPPED, SESSION, intent(2), outcome(2)
    )
    with read_journal(path) as journal:
        assert [shot.session for shot in journal.shots(1)] == [1, 2]
