"""What the operator may ask for while it is measured, beside a stop."""

from pathlib import Path

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, FakeCell
from small_plans import FOUR_PAIRS, TWO_PAIRS, drift, work
from test_set_aside import blind_at, skips

from campaigns.errors import Interrupted
from campaigns.journal.records import Event, PairVoided, Rejected
from campaigns.measuring.run_state import EngineState, Wish
from drivers.errors import EmergencyStop, NotAMeasurement
from drivers.values import Measurement

PAUSED_S = 30.0


def fresh(folder: Path) -> Path:
    folder.mkdir()
    return folder


def notes(journal) -> list[str]:
    return [e.record.text for e in journal.records_of(Event) if e.record.kind == "operator note"]


def asking_later(cell: FakeCell, *wishes: Wish) -> None:
    """The operator goes on, or stops, after a while."""

    def later() -> None:
        for wish in wishes:
            cell.wishes.ask(wish)

    cell.clock.after(PAUSED_S, later)


def test_a_pause_comes_after_the_pair_and_ends_when_it_is_asked_for_again(tmp_path: Path) -> None:
    cell = FakeCell()

    def pause() -> None:
        cell.wishes.ask(Wish.PAUSE)
        asking_later(cell, Wish.PAUSE)

    cell.tracker.during_measure[2] = pause
    began_s = cell.clock.now_s()
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    assert len(journal.shots()) == len(TWO_PAIRS)
    assert notes(journal) == ["paused by the operator", "the operator goes on"]
    states = [progress.state for progress in cell.observer.told]
    paused = next(p for p in cell.observer.told if p.state is EngineState.PAUSED)
    assert (states.count(EngineState.PAUSED), paused.done) == (1, 3)
    assert cell.clock.now_s() - began_s > PAUSED_S


def test_a_stop_and_the_emergency_stop_are_heeded_in_a_pause(tmp_path: Path) -> None:
    stopped, pressed = FakeCell(), FakeCell()
    stopped.wishes.ask(Wish.PAUSE)
    stopped.clock.after(PAUSED_S, stopped.wish.ask)
    with pytest.raises(Interrupted):
        stopped.run(fresh(tmp_path / "a"), work(TWO_PAIRS))
    pressed.wishes.ask(Wish.PAUSE)
    pressed.clock.after(PAUSED_S, lambda: setattr(pressed.robot, "emergency_stop", True))
    with pytest.raises(EmergencyStop):
        pressed.run(fresh(tmp_path / "b"), work(TWO_PAIRS))


def test_the_last_pair_is_voided_and_measured_again(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.tracker.during_measure[3] = lambda: cell.wishes.ask(Wish.AGAIN)
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    (voided,) = (entry.record for entry in journal.records_of(PairVoided))
    assert (voided.pair, voided.shots) == (0, (1, 2))
    assert [shot.intent.attempt for shot in journal.shots()] == [1, 2, 2, 1, 1, 1]
    assert cell.observer.told[-1].done == len(TWO_PAIRS)
    assert notes(journal) == ["measuring shots 1–2 again (operator)"]


def test_a_shot_that_is_moved_to_is_skipped_with_its_pair(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.robot.during_move[3] = lambda: cell.wishes.ask(Wish.SKIP)
    journal = cell.run(tmp_path, work(FOUR_PAIRS))
    (skipped,) = skips(journal)
    assert skipped.shots == (1, 2)
    assert {1, 2}.isdisjoint(shot.intent.shot for shot in journal.shots())
    reasons = [entry.record.reason for entry in journal.records_of(Rejected)]
    assert reasons == ["skipped by the operator"]
    assert len(journal.shots()) == len(FOUR_PAIRS) - 2


def test_a_shot_whose_reflector_is_not_seen_is_skipped_at_once(tmp_path: Path) -> None:
    cell = FakeCell()
    third = work(FOUR_PAIRS).steps[3].planned
    blind_at(cell, [third])
    search = cell.tracker.find_reflector

    def searched(distance_mm: float) -> None:
        if cell.observer.told[-1].beam_lost_s > 10.0:
            cell.wishes.ask(Wish.SKIP)
        search(distance_mm)

    cell.tracker.find_reflector = searched
    journal = cell.run(tmp_path, work(FOUR_PAIRS))
    assert [event.shots for event in skips(journal)] == [(3, 4)]
    assert cell.observer.told[-1].state is EngineState.FINISHED
    lost = [p.beam_lost_s for p in cell.observer.told]
    assert max(lost) < 20.0


def test_a_wish_to_skip_is_about_no_later_shot(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.tracker.during_measure[2] = lambda: cell.wishes.ask(Wish.SKIP)
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    assert skips(journal) == []
    assert len(journal.shots()) == len(TWO_PAIRS)
    assert notes(journal) == ["nothing is skipped: shot 1 is already measured; press r to redo it"]
    assert notes(journal)[0] in cell.observer.events


def test_a_wish_to_skip_while_nothing_is_taken_is_answered(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.tracker.during_measure[2] = lambda: (
        cell.wishes.ask(Wish.PAUSE),
        asking_later(cell, Wish.SKIP, Wish.PAUSE),
    )
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    assert notes(journal)[2:] == ["nothing is skipped: no shot was being taken"]
    assert len(journal.shots()) == len(TWO_PAIRS)


def test_a_shot_that_is_about_to_be_tried_again_is_skipped(tmp_path: Path) -> None:
    cell = FakeCell()
    measure = cell.tracker.measure

    def measured() -> Measurement:
        if cell.tracker.measured == 3:
            cell.tracker.measured += 1
            cell.wishes.ask(Wish.SKIP)
            raise NotAMeasurement("no result", remedy="measure again")
        return measure()

    cell.tracker.measure = measured
    journal = cell.run(tmp_path, work(FOUR_PAIRS))
    assert [event.shots for event in skips(journal)] == [(3, 4)]
    assert [len(journal.records_of(kind)) for kind in (Rejected, PairVoided)] == [1, 0]


def test_a_comparison_that_is_skipped_is_told_and_the_run_ends_in_order(tmp_path: Path) -> None:
    cell = FakeCell()
    for move in range(len(FOUR_PAIRS) + 2, 40):
        cell.robot.during_move[move] = lambda: cell.wishes.ask(Wish.SKIP)
    cell.run(tmp_path, work(FOUR_PAIRS, compared_at_end=True))
    assert cell.observer.told[-1].state is EngineState.FINISHED
    assert cell.observer.events == [
        "at the end it is not known whether anything has moved: skipped by the operator"
    ]


def test_nothing_to_measure_again_is_told(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.wishes.ask(Wish.AGAIN)
    cell.robot.during_move[1] = lambda: cell.wishes.ask(Wish.SKIP)
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    assert notes(journal) == ["no shot counts that can be measured again"]


def test_it_is_parked_at_the_drift_pose_or_where_campaign_yaml_says_and_goes_on(
    tmp_path: Path,
) -> None:
    elsewhere = NOMINAL.inverse(CENTRE[None] + [100.0, 0.0, -50.0, 0.0]).values_or_raise()[0]
    for name, park in (("drift", ()), ("elsewhere", tuple(elsewhere.tolist()))):
        cell = FakeCell()

        def asked(cell: FakeCell = cell) -> None:
            cell.wishes.ask(Wish.PARK)
            asking_later(cell, Wish.PAUSE)

        cell.tracker.during_measure[2] = asked
        where: list[np.ndarray] = []
        cell.clock.after(PAUSED_S / 2.0, lambda c=cell, w=where: w.append(c.robot.true_joints()))
        journal = cell.run(fresh(tmp_path / name), work(TWO_PAIRS, park=park))
        assert where[0] == pytest.approx(np.array(park or drift(0).joints), abs=1e-6)
        assert notes(journal) == ["parked by the operator", "the operator goes on"]
        assert len(journal.shots()) == len(TWO_PAIRS)
