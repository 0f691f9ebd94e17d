"""Shots that give no data: kept as rejected, their pair void, and measured again as a whole."""

from pathlib import Path

import pytest
from fake_cell import FakeCell
from small_plans import FOUR_PAIRS, GATE, drift, work
from tested_journal import journal_in

from campaigns.errors import GateRefused
from campaigns.journal.records import Event, PairVoided, Rejected
from campaigns.journal.views import AcceptedShot
from campaigns.measuring.shot_taker import FORGIVEN_BREAKS
from drivers.errors import BeamBroken
from drivers.values import Measurement


def attempts_of(shots: tuple[AcceptedShot, ...]) -> list[int]:
    return [shot.outcome.attempt for shot in shots]


@pytest.mark.parametrize(
    ("measurement", "voids", "attempts"),
    [(3, [(0, (1,))], [1, 2, 2, 1, 1, 1]), (4, [], [1, 1, 1, 2, 1, 1])],
    ids=["second", "first"],
)
def test_broken_beam_at_a_second_shot_repeats_the_whole_pair_and_at_a_first_that_shot(
    tmp_path: Path, measurement: int, voids, attempts: list[int]
) -> None:
    cell = FakeCell()
    cell.tracker.during_measure = {measurement: cell.tracker.break_beam}
    journal = cell.run(tmp_path, work())
    voided = [entry.record for entry in journal.records_of(PairVoided)]
    (rejected,) = (entry.record for entry in journal.records_of(Rejected))
    assert [(void.pair, void.shots) for void in voided] == voids
    assert (rejected.shot, rejected.attempt, rejected.measured) == (measurement - 1, 1, None)
    assert attempts_of(journal.shots()) == attempts
    assert cell.observer.told[-1].done == cell.observer.told[-1].total == 6


def test_search_starts_where_the_beam_points_and_never_at_another_shots_point(
    tmp_path: Path,
) -> None:
    """At the tracker's distance, before anybody knows the frame."""
    cell = FakeCell()
    cell.tracker.during_measure = {3: cell.tracker.break_beam}
    cell.run(tmp_path, work())
    looks = [call for call in cell.calls if call[0] in ("tracker.go_to", "tracker.find_reflector")]
    assert looks == [("tracker.find_reflector", 2500.0)]


@pytest.mark.parametrize(
    ("measurement", "lasts_s", "advice"),
    [
        (1, 60.0, "put the beam onto the robot's reflector by hand, about 2."),
        (8, 120.0, " mm in the tracker's frame, 2."),
    ],
)
def test_broken_beam_is_waited_for_with_advice_and_counts_no_attempt(
    tmp_path: Path, measurement: int, lasts_s: float, advice: str
) -> None:
    """The gate allows one attempt only, and the robot stands still until the beam is back."""
    cell = FakeCell()

    def break_it() -> None:
        cell.tracker.hide_reflector()
        cell.clock.after(lasts_s, lambda: setattr(cell.tracker, "finds", True))

    cell.tracker.during_measure = {measurement: break_it}
    once = GATE.model_copy(update={"attempts": 1})
    journal = cell.run(tmp_path, work(FOUR_PAIRS, gate=once))
    assert len(journal.shots()) == len(FOUR_PAIRS)
    names = [call[0] for call in cell.calls]
    searches = ("tracker.go_to", "tracker.find_reflector")
    waits = [place for place, name in enumerate(names) if name in searches]
    assert "robot.move_joints" not in names[waits[0] : waits[-1]]
    events = [entry.record for entry in journal.records_of(Event)]
    broken = [event.text for event in events if event.kind == "beam broken"]
    assert broken
    assert all(advice in text and text in cell.observer.events for text in broken)
    resumed = next(event.text for event in events if event.kind == "resumed")
    assert lasts_s - 2.0 <= float(resumed.split()[-2]) <= lasts_s + 5.0
    shown = [p for p in cell.observer.told if p.beam_advice]
    assert shown
    assert all(advice in p.beam_advice and not p.beam_locked for p in shown)
    assert not cell.observer.told[-1].beam_advice


def test_reflector_that_is_found_and_lost_each_time_is_no_passer_by(tmp_path: Path) -> None:
    cell = FakeCell()

    def measure_badly() -> Measurement:
        cell.calls.append(("tracker.measure",))
        raise BeamBroken("the beam is broken", remedy="find the reflector")

    cell.tracker.measure = measure_badly
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(GateRefused, match="3 attempts failed, the last one: shot 3"):
            cell.measure(journal, work())
        assert not journal.shots(1)
    assert len(cell.named("tracker.measure")) == 3 * (FORGIVEN_BREAKS + 3)


def test_wrong_target_is_refused_with_its_data_and_the_tracker_sent_to_the_right_one(
    tmp_path: Path,
) -> None:
    cell = FakeCell()
    cell.tracker.during_measure = {7: cell.tracker.take_wrong_target}
    journal = cell.run(tmp_path, work(FOUR_PAIRS))
    (rejected,) = (entry.record for entry in journal.records_of(Rejected))
    assert attempts_of(journal.shots()) == [1, 1, 1, 1, 1, 2, 2, 1, 1, 1]
    assert "from the predicted point, limit" in rejected.reason
    assert rejected.measured.point_in_tracker_mm == (1000.0, 2000.0, 300.0)
    assert rejected.measured.residual_mm > 60.0
    assert len(cell.named("tracker.go_to")) == 1


def test_wrong_target_is_noticed_by_distances_before_the_frame_is_known(tmp_path: Path) -> None:
    """The robot then brings the reflector back to where the beam was on it."""
    cell = FakeCell()
    cell.tracker.during_measure = {3: cell.tracker.take_wrong_target}
    journal = cell.run(tmp_path, work())
    refused, looked = (entry.record for entry in journal.records_of(Rejected))
    assert attempts_of(journal.shots()) == [1, 2, 2, 1, 1, 1]
    first_mm = journal.shots()[0].outcome.point_in_tracker_mm
    assert "the distance to an earlier shot is" in refused.reason
    assert looked.reason.startswith("only compared with the one before")
    assert cell.named("tracker.go_to") == [("tracker.go_to", tuple(round(v, 1) for v in first_mm))]


def test_robot_that_moved_while_it_was_measured_is_measured_again(tmp_path: Path) -> None:
    cell = FakeCell()

    def push() -> None:
        cell.robot.joints = cell.robot.joints + 1e-4

    cell.tracker.during_measure = {2: push}
    journal = cell.run(tmp_path, work())
    (rejected,) = (entry.record for entry in journal.records_of(Rejected))
    assert attempts_of(journal.shots()) == [1, 2, 1, 1, 1, 1]
    assert rejected.reason == "the robot moved while it was measured"
    assert rejected.measured is not None


def test_drift_beyond_its_limit_ends_the_run_and_does_not_count(tmp_path: Path) -> None:
    cell = FakeCell()

    def bump() -> None:
        cell.tracker.shifted_mm[:] = (0.0, 0.9, 0.9)

    cell.tracker.during_measure = {2: bump}
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(GateRefused, match=r"1\.273 mm from where it was first, limit 1 mm"):
            cell.measure(journal, work((drift(0), drift(1))))
        (rejected,) = (entry.record for entry in journal.records_of(Rejected))
        assert [shot.intent.shot for shot in journal.shots(1)] == [0]
    assert rejected.measured is not None
    assert cell.calls[-2:] == [("robot.stop",), ("journal.session-stopped",)]
