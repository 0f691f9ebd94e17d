"""Going on although poses have moved, and comparing them at the end of an uninterrupted run."""

from pathlib import Path

from fake_cell import FakeCell
from small_plans import FOUR_PAIRS, TWO_PAIRS, interrupted, work

from campaigns.journal.records import Event, Rejected


def texts(journal, kind: str) -> list[str]:
    return [e.record.text for e in journal.records_of(Event) if e.record.kind == kind]


def test_run_goes_on_anyway_with_a_moved_stand_and_says_so_in_the_journal(tmp_path: Path) -> None:
    """Moved by more than the gate allows, no shot would pass by what was measured before."""
    interrupted(tmp_path, 8, FOUR_PAIRS)
    cell = FakeCell()
    cell.tracker.shifted_mm[1] = 40.0
    journal = cell.run(tmp_path, work(FOUR_PAIRS, override=True))
    assert len(journal.shots()) == len(FOUR_PAIRS)
    (text,) = texts(journal, "gone on anyway")
    assert text.startswith(
        "gone on all the same: after the restart reference poses differ by up to"
    )
    assert "the tracker, its stand or the robot's base has moved" in text
    assert text in cell.observer.events


def test_poses_are_compared_at_the_end_of_a_run_that_nothing_interrupted(tmp_path: Path) -> None:
    cell = FakeCell()
    journal = cell.run(tmp_path, work(FOUR_PAIRS, compared_at_end=True))
    assert {shot.outcome.attempt for shot in journal.shots()} == {1}
    end = texts(journal, "drift check")[-1]
    compared = [e.record for e in journal.records_of(Rejected)]
    assert end.startswith("at the end reference poses differ by up to 0.000 mm")
    assert end.endswith("no change detected")
    assert len(compared) == 4
    assert all(each.reason.startswith("only compared with the first one") for each in compared)
    assert cell.observer.events == []


def test_stand_bumped_during_a_run_is_told_at_its_end_and_nothing_is_lost(tmp_path: Path) -> None:
    cell = FakeCell()

    def bump() -> None:
        cell.tracker.shifted_mm[:] = (0.0, 1.5, 0.0)

    plan = FOUR_PAIRS[:-1]
    cell.tracker.during_measure = {8: bump}
    journal = cell.run(tmp_path, work(plan, compared_at_end=True))
    assert len(journal.shots()) == len(plan)
    (told,) = cell.observer.events
    assert told.startswith("at the end reference poses differ by up to 1.")
    assert "has moved" in told


def test_pose_that_cannot_be_compared_at_the_end_loses_nothing(tmp_path: Path) -> None:
    cell = FakeCell()

    def go_away() -> None:
        cell.tracker.shifted_mm[:] = (0.0, 500.0, 0.0)

    cell.tracker.during_measure = {7: go_away}
    journal = cell.run(tmp_path, work(compared_at_end=True))
    assert len(journal.shots()) == len(TWO_PAIRS)
    assert journal.latest_series("run").finished
    (told,) = [text for text in cell.observer.events if text.startswith("at the end")]
    assert "a pose could not be compared" in told
