"""Poses that have moved: going on all the same, and what is compared at the end of a run."""

from pathlib import Path

import pytest
from fake_cell import ROBOT, FakeCell
from par4_space import par4
from small_plans import FOUR_PAIRS, interrupted, work

from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Event
from campaigns.measuring.reference_poses import ReferenceNoise
from campaigns.measuring.session import run_result
from campaigns.measuring.work import Work

WORN = par4({**ROBOT.parameters, "arm2.forearm_mm": ROBOT.parameters["arm2.forearm_mm"] + 1.0})


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


def result_of_a_run_with(tmp_path: Path, happens: str):
    cell, plan = FakeCell(), FOUR_PAIRS[:-1]
    job = work(plan, compared_at_end=True)

    def act() -> None:
        if happens == "a longer forearm":
            cell.tracker.truth = WORN
        if happens == "a moved stand":
            cell.tracker.shifted_mm[:] = (0.0, 1.5, 0.0)

    cell.tracker.during_measure = {8: act}
    journal = cell.run(tmp_path, job)
    return run_result(journal, 1, job)


@pytest.mark.parametrize("happens", ["a longer forearm", "nothing", "a moved stand"])
def test_a_run_is_not_good_where_the_robot_itself_has_changed_by_its_end(
    tmp_path, happens, monkeypatch
) -> None:
    """Its scatter is known here: nine shots are too few to estimate it."""
    scatter = ReferenceNoise(TrackerUncertainty(), 0.02)
    monkeypatch.setattr(Work, "noise_by", lambda *_: scatter)
    result = result_of_a_run_with(tmp_path, happens)
    assert result.shots == len(FOUR_PAIRS[:-1])
    assert result.reaches_goal
    is_robots = happens == "a longer forearm"
    assert result.good is not is_robots
    assert ("the robot has changed" in result.changed) is is_robots
