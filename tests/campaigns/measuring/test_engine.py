"""What the engine asks of the devices and writes into the journal, and in which order."""

from pathlib import Path

import pytest
from fake_cell import FakeCell
from small_plans import TWO_PAIRS, work

from campaigns.journal.journal import read_journal
from campaigns.journal.records import Outcome


def taken(shot: int, *joints_deg: float) -> list[tuple[object, ...]]:
    """All that is asked and written of a shot; readings that follow one another are one entry."""
    return [
        ("journal.intent", shot, 1),
        ("robot.state",),
        ("robot.move_joints", *joints_deg),
        ("robot.state",),
        ("tracker.measure",),
        ("robot.state",),
        ("journal.outcome", shot, 1),
    ]


GOLDEN_TWO_PAIRS = [
    ("journal.series-started",),
    ("robot.state",),
    ("journal.session-started",),
    # the drift pose: the robot stands there already, and is still sent there
    *taken(0, 31.34, 31.34, 21.0, 21.0),
    # pair 0
    *taken(1, 55.48, 29.16, 5.3, 36.98),
    *taken(2, 25.37, 48.81, 26.23, -8.9),
    # pair 1
    *taken(3, 17.98, 33.69, 52.36, 39.16),
    *taken(4, 17.49, 1.97, 17.63, 37.36),
    # the drift pose again, compared with the first one
    *taken(5, 31.34, 31.34, 21.0, 21.0)[:-1],
    ("journal.event",),
    ("journal.outcome", 5, 1),
    ("journal.series-finished",),
    ("journal.session-stopped",),
]


def test_golden_sequence_of_a_two_pair_plan_and_what_its_outcomes_hold(tmp_path: Path) -> None:
    """What was asked, read and measured, and how long it took."""
    cell = FakeCell()
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    assert cell.calls == GOLDEN_TWO_PAIRS
    shot = journal.shots()[1]
    assert shot.intent.target == TWO_PAIRS[1].pose
    assert shot.intent.target_joints == TWO_PAIRS[1].joints
    assert (shot.intent.purpose, shot.intent.pair) == ("identification", 0)
    assert shot.outcome.joints == pytest.approx(TWO_PAIRS[1].joints)
    assert shot.outcome.raw_robot.startswith("reading")
    assert shot.outcome.raw_tracker == "measurement 2"
    assert shot.outcome.durations.move_s == pytest.approx(0.4, abs=0.2)
    assert shot.outcome.durations.settle_s == pytest.approx(0.2, abs=0.03)
    assert shot.outcome.durations.measure_s == pytest.approx(1.0)


def test_outcome_is_on_the_disk_before_the_next_motion_and_never_before_its_measurement(
    tmp_path: Path,
) -> None:
    cell = FakeCell()
    written = []

    def look() -> None:
        with read_journal(tmp_path / "campaign.db") as reader:
            written.append([entry.record.shot for entry in reader.records_of(Outcome)])

    cell.robot.during_move = dict.fromkeys(range(2, 7), look)
    cell.tracker.during_measure = dict.fromkeys(range(1, 7), look)
    cell.run(tmp_path, work())
    before_measuring = [list(range(shot)) for shot in range(6)]
    before_moving = [list(range(shot)) for shot in range(1, 6)]
    assert sorted(written, key=len) == sorted(before_measuring + before_moving, key=len)
