"""Runs with a goal: when they end early, what they take all the same, and how they go on."""

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest
from fake_cell import FakeCell
from goal_plans import ALL, OTHERS, PLAN, mean_std_mm, noisy_cell, numbers, until
from tested_journal import journal_in

from campaigns.journal import records
from campaigns.journal.journal import Journal
from campaigns.journal.views import Entry
from campaigns.measuring.resume import complete_series, missing_shots
from campaigns.shots.shot_sets import ShotSet

GOAL_MM = 2.0
"""Met by 8 of the 26 identification shots."""
PAIR_OF = {shot.shot: shot.pair for shot in PLAN if shot.pair is not None}


@pytest.fixture(scope="module")
def ended_once(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, FakeCell]:
    """A campaign whose run met its goal before the plan was through."""
    folder, cell = tmp_path_factory.mktemp("early"), noisy_cell()
    cell.run(folder, until(GOAL_MM))
    return folder, cell


@pytest.fixture
def ended_early(ended_once: tuple[Path, FakeCell], tmp_path: Path) -> Path:
    return shutil.copytree(ended_once[0], tmp_path / "early")


def is_goal_met(record: records.Record) -> bool:
    return isinstance(record, records.Event) and record.kind == "goal met"


def goals_met(journal: Journal) -> list[str]:
    return [
        entry.record.text
        for entry in journal.records_of(records.Event)
        if is_goal_met(entry.record)
    ]


def test_what_is_left_out_is_whole_pairs_and_named_in_the_journal(
    ended_once: tuple[Path, FakeCell],
) -> None:
    folder, cell = ended_once
    with journal_in(folder, []) as journal:
        taken = numbers(journal.shots(1))
        (text,) = goals_met(journal)
    missing = ALL - taken
    assert 4 < len(missing) < 20
    assert {PAIR_OF[shot] for shot in missing}.isdisjoint(PAIR_OF.get(shot) for shot in taken)
    assert f"{len(missing)} shots left out: {min(missing)}" in text
    assert cell.observer.events == [text]
    last = cell.observer.told[-1]
    assert last.done == last.total == len(taken)


def test_an_early_end_finishes_the_series_with_no_further_shot_to_identify_from(
    ended_early: Path,
) -> None:
    with journal_in(ended_early, []) as journal:
        met = next(entry.number for entry in journal.records() if is_goal_met(entry.record))
        intents = journal.records_of(records.Intent)
        later = [entry.record.purpose for entry in intents if entry.number > met]
    assert set(later) == {ShotSet.VALIDATION.value, ShotSet.DRIFT.value}
    with journal_in(ended_early, []) as journal:
        assert journal.latest_series("run").finished
        assert complete_series(journal, until(GOAL_MM)).number == 1
        assert complete_series(journal, until(2.0 * GOAL_MM)).number == 1
        assert missing_shots(journal.latest_series("run"), until(None))
        stopped = journal.records_of(records.SessionStopped)[-1].record
    assert (stopped.how, stopped.reason) == ("finished", "everything wanted was measured")


@pytest.mark.slow
def test_what_was_left_out_is_measured_by_a_run_without_the_goal(ended_early: Path) -> None:
    cell = noisy_cell(seed=2)
    with journal_in(ended_early, cell.calls) as journal:
        assert complete_series(journal, until(None)) is None
        before = numbers(journal.shots(1))
        assert cell.measure(journal, until(None)) == 1, "the same series"
        assert numbers(journal.shots(1)) == ALL
        assert len(journal.records_of(records.SeriesFinished)) == 1
        assert complete_series(journal, until(None)).number == 1
    intents = [call[1] for call in cell.named("journal.intent")]
    references, added, again = set(intents[:4]), intents[4:-4], set(intents[-4:])
    assert references == again
    assert references <= before
    assert set(added) == ALL - before


def cut_off(folder: Path, whole: Sequence[Entry[records.Record]]) -> None:
    """A journal of these records alone: the power failed after them."""
    with journal_in(folder, []) as journal:
        for entry in whole:
            journal.append(entry.record, series=entry.series)


@pytest.mark.parametrize("place", [-1, 1], ids=["before the event", "at the next shot"])
def test_a_crash_about_an_early_end_loses_nothing(
    ended_once: tuple[Path, FakeCell], tmp_path: Path, place: int
) -> None:
    with journal_in(ended_once[0], []) as journal:
        whole = journal.records()
    met = next(place for place, entry in enumerate(whole, 1) if is_goal_met(entry.record))
    cut_off(tmp_path, whole[: met + place])
    cell = noisy_cell(seed=2)
    with journal_in(tmp_path, cell.calls) as journal:
        if complete_series(journal, until(GOAL_MM)) is None:
            cell.measure(journal, until(GOAL_MM))
        shots = journal.shots(1)
        assert journal.latest_series("run").finished
        assert [entry.series for entry in journal.records_of(records.SeriesFinished)] == [1]
    assert numbers(shots) >= OTHERS
    assert mean_std_mm(shots) <= GOAL_MM
    pairs = [PAIR_OF[shot] for shot in numbers(shots) if shot in PAIR_OF]
    assert {pairs.count(pair) for pair in pairs} == {2}
