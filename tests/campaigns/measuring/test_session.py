"""Series that are begun, cut off and taken up again: same plan, same devices, nothing shifted."""

from dataclasses import replace
from pathlib import Path

import pytest
from fake_cell import FakeCell
from small_plans import TWO_PAIRS, interrupted, pair, work
from tested_journal import PowerCut, journal_in

from campaigns.errors import GateRefused, ResumeRefused
from campaigns.journal.records import (
    Event,
    Intent,
    Rejected,
    SeriesFinished,
    SessionStarted,
    SessionStopped,
)
from campaigns.measuring.resume import complete_series
from campaigns.measuring.session import run_result
from campaigns.planning.steps import joint_steps
from drivers.values import Weather


def test_second_session_measures_three_poses_and_then_only_what_is_missing_and_these_again(
    tmp_path: Path,
) -> None:
    interrupted(tmp_path, 4)
    cell = FakeCell()
    journal = cell.run(tmp_path, work())
    assert len(journal.shots()) == len(TWO_PAIRS)
    assert len(journal.series()) == 1
    intents = [call[1:] for call in cell.named("journal.intent")]
    first, last = [(0, 2), (1, 2), (2, 2)], [(0, 3), (1, 3), (2, 3)]
    assert sorted(intents[:3]) == first
    assert intents[3:6] == [(3, 2), (4, 1), (5, 1)]
    assert sorted(intents[6:]) == last


def test_comparison_of_one_pose_after_a_restart_is_kept_but_does_not_count(tmp_path: Path) -> None:
    interrupted(tmp_path, 3)
    cell = FakeCell()
    cell.tracker.shifted_mm[2] = 0.2
    journal = cell.run(tmp_path, work())
    drift = journal.shots()[0]
    rejected = [e.record for e in journal.records_of(Rejected) if e.record.measured]
    events = [e.record.text for e in journal.records_of(Event)]
    assert drift.outcome.attempt == 1
    assert [(each.shot, each.attempt, each.reason) for each in rejected] == [
        (0, 2, "only compared with the first one, 0.200 mm away")
    ]
    assert events[:2] == [
        "run goes on after 'stopped by the operator'",
        "shot 0: after the restart the pose is 0.200 mm from where it was first, limit 1 mm",
    ]
    assert cell.observer.told[-1].drift_mm == pytest.approx(0.2)


LAST_OUTCOME = 15


@pytest.mark.parametrize("record", [2, 4, 5, 6, 7, 8, LAST_OUTCOME, LAST_OUTCOME + 1])
def test_crash_before_any_record_loses_nothing_and_mixes_no_pair(
    tmp_path: Path, record: int
) -> None:
    first, second = FakeCell(), FakeCell()
    with journal_in(tmp_path, first.calls) as journal:
        journal.dies_before = record
        with pytest.raises(PowerCut):
            first.measure(journal, work())
        assert len(journal.records()) == record - 1
    journal = second.run(tmp_path, work())
    shots = journal.shots()
    assert [shot.intent.shot for shot in shots] == [0, 1, 2, 3, 4, 5]
    assert [entry.series for entry in journal.records_of(SeriesFinished)] == [1]
    assert bool(second.named("robot.move_joints")) is (record <= LAST_OUTCOME)
    resumed = [e.record.text for e in journal.records_of(Event) if e.record.kind == "resumed"]
    assert resumed == ["run goes on after a crash: the last session wrote no end"]
    assert len(journal.records_of(SessionStopped)) == 1
    restart = journal.records_of(SessionStarted)[-1].number
    places = {(e.record.shot, e.record.attempt): e.number for e in journal.records_of(Intent)}
    after_restart = [places[s.intent.shot, s.intent.attempt] > restart for s in shots]
    assert after_restart[1] == after_restart[2]
    assert after_restart[3] == after_restart[4]


def test_one_pose_that_has_shifted_during_the_pause_ends_the_run(tmp_path: Path) -> None:
    interrupted(tmp_path, 3)
    cell = FakeCell()
    cell.tracker.shifted_mm[0] = 1.5
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(GateRefused, match=r"after the restart the pose is 1\.500 mm") as caught:
            cell.measure(journal, work())
        assert len(journal.shots(1)) == 1
        rejected = journal.records_of(Rejected)[-1].record
    assert "--anew" in caught.value.remedy
    assert (rejected.shot, rejected.measured is not None) == (0, True)
    assert len(cell.named("robot.move_joints")) == 1
    assert len(cell.named("robot.stop")) == 1


MOVED = (
    TWO_PAIRS[0],
    replace(TWO_PAIRS[1], pose=replace(TWO_PAIRS[1].pose, x_mm=151.0)),
    *TWO_PAIRS[2:],
)
RENUMBERED = [replace(shot, shot=shot.shot + 50) for shot in TWO_PAIRS]


def test_rows_taken_out_and_added_are_no_other_plan(tmp_path: Path) -> None:
    """Measured are 0, 1 and 2; the pair of 3 goes, and that of 20 comes."""
    interrupted(tmp_path, 4)
    cell = FakeCell()
    more = pair(20, 9, (150.0, -60.0, -560.0), (-120.0, 80.0, -620.0))
    edited = (*TWO_PAIRS[:3], *more, TWO_PAIRS[5])
    journal = cell.run(tmp_path, work(edited))
    assert [shot.intent.shot for shot in journal.shots()] == [0, 1, 2, 5, 20, 21]
    assert len(journal.series()) == 1
    numbers = {call[1] for call in cell.named("journal.intent")}
    assert numbers == {0, 1, 2, 5, 20, 21}, "three of them only compared"


def test_rows_added_to_a_finished_plan_are_measured_in_its_series(tmp_path: Path) -> None:
    first, second = FakeCell(), FakeCell()
    more = pair(20, 9, (150.0, -60.0, -560.0), (-120.0, 80.0, -620.0))
    first.run(tmp_path, work())
    with journal_in(tmp_path, second.calls) as journal:
        assert complete_series(journal, work((*TWO_PAIRS, *more))) is None
        assert second.measure(journal, work((*TWO_PAIRS, *more))) == 1
        assert len(journal.shots(1)) == len(TWO_PAIRS) + 2
        assert complete_series(journal, work(TWO_PAIRS)).number == 1
        assert complete_series(journal, work(stage="before")) is None


def test_shot_to_be_skipped_costs_its_pair_is_named_and_measured_by_the_next_run(
    tmp_path: Path,
) -> None:
    skipping = work(skip=frozenset({4}))
    journal = FakeCell().run(tmp_path, skipping)
    assert [shot.intent.shot for shot in journal.shots()] == [0, 1, 2, 5]
    ran = run_result(journal, 1, skipping)
    assert complete_series(journal, skipping).number == 1
    assert complete_series(journal, work()) is None
    assert ran.skipped == {(3, 4): "left out by --skip"}
    assert ran.left_out == 0
    journal = FakeCell().run(tmp_path, work())
    assert len(journal.series()) == 1
    assert len(journal.shots()) == len(TWO_PAIRS)
    assert run_result(journal, 1, work()).skipped == {}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"plan_digest": "0" * 64, "steps": joint_steps(MOVED)},
            "was begun with another plan (shot 1 was measured at another pose than plan.csv has",
        ),
        (
            {"plan_digest": "0" * 64, "steps": joint_steps(RENUMBERED)},
            "none of its shots is in plan.csv",
        ),
        ({"stage": "before", "plan_digest": "0" * 64}, "another plan"),
        ({"robot_file_digest": "0" * 64}, "another parameter set"),
        ({"robot": "X-9"}, "the controller of serial number"),
        ({"tracker": "X-9"}, "the tracker of serial number"),
    ],
    ids=["moved", "renumbered", "of a validation", "parameters", "controller", "tracker"],
)
def test_another_plan_robot_or_device_is_not_resumed(
    tmp_path: Path, changes: dict[str, object], said: str
) -> None:
    interrupted(tmp_path, 4, stage=changes.get("stage", "run"))
    cell = FakeCell()
    for device in {"robot", "tracker"} & set(changes):
        getattr(cell, device).serial = changes.pop(device)
    with journal_in(tmp_path, cell.calls) as journal:
        records = journal.last_number()
        with pytest.raises(ResumeRefused, match="--anew") as caught:
            cell.measure(journal, work(**changes))
        assert journal.last_number() == records
    assert said in caught.value.problem
    assert not cell.named("robot.move_joints")


def test_anew_leaves_the_unfinished_series_and_begins_another(tmp_path: Path) -> None:
    interrupted(tmp_path, 4)
    cell = FakeCell()
    cell.robot.serial = "X-9"
    with journal_in(tmp_path, cell.calls) as journal:
        assert cell.measure(journal, work(), anew=True) == 2
        assert [series.finished for series in journal.series("run")] == [False, True]
        assert [shot.intent.attempt for shot in journal.shots(2)] == [1] * 6
    assert not cell.named("journal.rejected")


def test_air_is_compared_with_that_of_the_series_beginning(tmp_path: Path) -> None:
    interrupted(tmp_path, 4)
    cell = FakeCell()
    cell.tracker.air = Weather(21.5, 1013.0, 50.0)
    cell.run(tmp_path, work())
    assert cell.observer.events == ["the air has changed by +1.50 °C since the start, limit 1 °C"]
