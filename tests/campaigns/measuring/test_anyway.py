"""Poses that have moved: going on all the same, and what is compared at the end of a run."""

from pathlib import Path

from fake_cell import FakeCell
from small_plans import FOUR_PAIRS, interrupted, work

from campaigns.journal.records import Event


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
