"""What the operator may ask for while it is measured, beside a stop."""

from pathlib import Path

import numpy as np
import pytest
from fake_cell import FakeCell
from small_plans import FOUR_PAIRS, TWO_PAIRS, drift, joints_at, work
from test_set_aside import blind_at, skips

from campaigns.errors import Interrupted
from campaigns.journal.records import Event, PairVoided, Rejected
from campaigns.measuring.run_state import EngineState, Wish
from drivers.errors import EmergencyStop, NotAMeasurement
from drivers.values import Measurement

PAUSED_S = 30.0


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
    assert notes(journal) == ["paused by the operator", "resumed by the operator"]
    states = [progress.state for progress in cell.observer.told]
    paused = next(p for p in cell.observer.told if p.state is EngineState.PAUSED)
    assert (states.count(EngineState.PAUSED), paused.done) == (1, 3)
    assert cell.clock.now_s() - began_s > PAUSED_S


@pytest.mark.parametrize("error", [Interrupted, EmergencyStop])
def test_a_stop_and_the_emergency_stop_end_a_pause(tmp_path: Path, error: type[Exception]) -> None:
    cell = FakeCell()
    cell.wishes.ask(Wish.PAUSE)

    def stop() -> None:
        if error is Interrupted:
            cell.wish.ask()
        cell.robot.emergency_stop = error is EmergencyStop

    cell.clock.after(PAUSED_S, stop)
    with pytest.raises(error):
        cell.run(tmp_path, work(TWO_PAIRS))
    assert cell.named("robot.stop")


def test_the_last_pair_is_voided_and_measured_again(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.tracker.during_measure[3] = lambda: cell.wishes.ask(Wish.AGAIN)
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    (voided,) = (entry.record for entry in journal.records_of(PairVoided))
    assert (voided.pair, voided.shots) == (0, (1, 2))
    assert [shot.intent.attempt for shot in journal.shots()] == [1, 2, 2, 1, 1, 1]
    assert cell.observer.told[-1].done == len(TWO_PAIRS)
    assert notes(journal) == ["measuring shots 1–2 again (operator)"]


@pytest.mark.parametrize(
    ("at", "attempts", "voided"),
    [
        # on the way to the second pair: the first one again, then the second
        (4, [1, 2, 2, 2, 1, 1], [(0, (1, 2))]),
        # on the way to the second shot of a pair: the last shot is of this very pair
        (5, [1, 1, 1, 2, 2, 1], [(1, (3,))]),
        # where nothing counts yet, the shot itself is taken again
        (1, [2, 1, 1, 1, 1, 1], []),
    ],
)
def test_one_step_back_voids_the_last_shot_and_measures_it_before_the_present_one(
    tmp_path: Path, at: int, attempts: list[int], voided: list[tuple[int, tuple[int, ...]]]
) -> None:
    cell = FakeCell()
    cell.robot.during_move[at] = lambda: cell.wishes.ask(Wish.BACK)
    journal = cell.run(tmp_path, work(TWO_PAIRS))
    records = [entry.record for entry in journal.records_of(PairVoided)]
    assert [(record.pair, record.shots) for record in records] == voided
    assert [shot.intent.attempt for shot in journal.shots()] == attempts
    assert cell.observer.told[-1].done == len(TWO_PAIRS)


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


ELSEWHERE = tuple(joints_at(100.0, 0.0, -625.0, 0.0).tolist())


@pytest.mark.parametrize("park", [(), ELSEWHERE], ids=["at the drift pose", "as configured"])
def test_the_robot_is_parked_and_goes_on(tmp_path: Path, park: tuple[float, ...]) -> None:
    cell, parked = FakeCell(), []

    def ask_to_park() -> None:
        cell.wishes.ask(Wish.PARK)
        asking_later(cell, Wish.PAUSE)

    cell.tracker.during_measure[2] = ask_to_park
    cell.clock.after(PAUSED_S / 2.0, lambda: parked.append(cell.robot.true_joints()))
    journal = cell.run(tmp_path, work(TWO_PAIRS, park=park))
    assert parked[0] == pytest.approx(np.array(park or drift(0).joints), abs=1e-6)
    assert notes(journal) == ["parked by the operator", "resumed by the operator"]
    assert len(journal.shots()) == len(TWO_PAIRS)
