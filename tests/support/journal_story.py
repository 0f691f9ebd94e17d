"""Records to test the journal with, and the short campaign that tests/data/journal-vN.db hold.

Each golden file was written once, by version N of the journal, with

    python tests/support/journal_story.py tests/data/journal-vN.db

It stays as it is: it stands for the files that users have. A new version gets a file of its own.
"""

import sys
from pathlib import Path

from tested_journal import ticking

from campaigns.journal import records
from campaigns.journal.journal import Journal, open_journal
from drivers.values import Identity, Pose, Weather

ROBOT = Identity("Acme", "Par4", "R-1", "1.0", "robotline")
TRACKER = Identity("Leica", "AT403", "T-7", "2.3", "emScon")
WEATHER = Weather(20.5, 1013.25, 45.0)
SESSION = records.SessionStarted("0.1.0", ROBOT, TRACKER, WEATHER)
STOPPED = records.SessionStopped("finished", "")


def beginning(stage: records.Stage = "run") -> records.SeriesStarted:
    return records.SeriesStarted(
        stage, "p1an", {"settle": {"within_s": 5.0}}, "0.1.0", "r0b0t", ROBOT, TRACKER, WEATHER
    )


def intent(shot: int, attempt: int = 1) -> records.Intent:
    target = Pose(100.0, -20.0, -650.0, 0.25)
    return records.Intent(shot, attempt, "identification", target, (0.1, 0.2, 0.3, 0.4), "joints")


def outcome(shot: int, attempt: int = 1, *, x_mm: float = 1000.1) -> records.Outcome:
    return records.Outcome(
        shot,
        attempt,
        joints=(0.1, 0.2, 0.3, 0.1 + 0.2),
        point_in_tracker_mm=(x_mm, -2000.2, 1e-17),
        covariance_mm2=((1e-4, 0.0, 0.0), (0.0, 2e-4, 0.0), (0.0, 0.0, 3e-4)),
        weather=WEATHER,
        raw_robot="#12 STATE θ=0.3\x00\r\n",
        raw_tracker="00ff",
        durations=records.Durations(1.5, 0.5, 2.0),
        predicted_in_tracker_mm=(1000.0, -2000.0, 0.0),
        residual_mm=0.22,
    )


def imported(shot: int) -> records.Outcome:
    """A shot of which only the least is known."""
    return records.Outcome(shot, 1, (0.0,) * 4, (1.0, 2.0, 3.0), None, None, "", "", None)


def tell(journal: Journal) -> None:
    """One record of every kind, a crash, and a pair that is measured twice."""
    run = journal.start_series(beginning())
    before_the_crash: tuple[records.Record, ...] = (
        SESSION,
        records.Event("operator note", "reflector cleaned – σ was 12 µm"),
        intent(1),
        outcome(1),
        intent(2),
        records.Rejected(
            2, 1, "3.1 mm from the prediction, the gate is 1 mm", outcome(2, x_mm=3.1)
        ),
        records.PairVoided(1, (1, 2), "shot 2 was rejected"),
        intent(1, 2),
    )
    after_the_crash: tuple[records.Record, ...] = (
        SESSION,
        intent(1, 3),
        outcome(1, 3, x_mm=1000.3),
        intent(2, 2),
        records.Rejected(2, 2, "beam broken"),
        intent(2, 3),
        outcome(2, 3),
        records.SeriesFinished(),
        STOPPED,
    )
    for record in before_the_crash + after_the_crash:
        journal.append(record, series=run)
    received = journal.start_series(
        records.SeriesStarted("import", "", {}, "0.1.0", "r0b0t", None, None, None)
    )
    journal.append(intent(1), series=received)
    journal.append(imported(1), series=received)
    journal.append(
        records.Finding("identification", {"journal": journal.digest(), "converged": True})
    )


def write_story(path: Path) -> None:
    with open_journal(path, now_utc=ticking()) as journal:
        tell(journal)


if __name__ == "__main__":
    write_story(Path(sys.argv[1]))
