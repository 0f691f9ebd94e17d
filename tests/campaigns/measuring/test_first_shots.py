"""First shots of a series: the wrong one among them, and the tracker's place."""

from collections.abc import Sequence
from math import dist
from pathlib import Path

import numpy as np
import pytest
from fake_cell import NOMINAL, TRACKER_FROM_BASE, FakeCell
from small_plans import FOUR_PAIRS, TWO_PAIRS, drift, work
from tested_journal import journal_in

from campaigns.errors import GateRefused, Interrupted
from campaigns.journal.records import Event, Outcome, PairVoided, SessionStarted
from campaigns.measuring.monitors import Station, StationMonitor
from campaigns.planning.plan_file import PlannedShot
from drivers.values import Vector3

PLACE_MM = tuple(TRACKER_FROM_BASE.inverted().translation_mm.tolist())


def events_of(journal, kind: str) -> list[str]:
    return [e.record.text for e in journal.records_of(Event) if e.record.kind == kind]


def true_mm(outcome: Outcome | PlannedShot) -> tuple[float, ...]:
    pose = NOMINAL.forward(np.array([outcome.joints])).values_or_raise()[:, :3]
    return tuple(TRACKER_FROM_BASE.apply(pose)[0].tolist())


def test_wrong_first_shot_is_voided_named_and_taken_again(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.tracker.during_measure = {
        1: cell.tracker.take_wrong_target,
        2: cell.tracker.take_right_target,
    }
    journal = cell.run(tmp_path, work())
    attempts = [shot.outcome.attempt for shot in journal.shots()]
    (voided,) = (entry.record for entry in journal.records_of(PairVoided))
    (told,) = events_of(journal, "shot voided")
    # wrong, compared, taken again; refused once, then right
    assert attempts == [3, 2, 1, 1, 1, 1]
    assert (voided.pair, voided.shots) == (None, (0,))
    assert "shot 0 does not count: a wrong target or a wrong pose: measured again it is" in told
    assert "where shot 1 agrees with it" in told
    assert told in cell.observer.events
    assert cell.observer.told[-1].done == cell.observer.told[-1].total == 6


def test_shots_of_a_reflector_that_stands_elsewhere_are_voided_and_the_next_run_goes_on(
    tmp_path: Path,
) -> None:
    cell = FakeCell()
    cell.tracker.on_wrong_target = True
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(
            GateRefused, match="shots 0–1 have one point, although the encoders moved"
        ):
            cell.measure(journal, work())
        assert not journal.shots(1)
    again = FakeCell()
    with journal_in(tmp_path, again.calls) as journal:
        assert len(journal.shots(again.measure(journal, work()))) == len(TWO_PAIRS)


def begin_on_a_wrong_target(
    folder: Path, plan: Sequence[PlannedShot], stop_at_move: int
) -> FakeCell:
    """Let a session take a wrong target right after its beginning; return the next session's cell.

    Nothing has contradicted the first session's shots yet when it is cut off.
    """
    first, second = FakeCell(), FakeCell()
    first.tracker.tells_direction = second.tracker.tells_direction = True
    first.tracker.during_measure = {1: first.tracker.take_wrong_target}
    first.robot.during_move = {stop_at_move: first.wish.ask}
    with journal_in(folder, first.calls) as journal, pytest.raises(Interrupted):
        first.measure(journal, work(plan))
    second.tracker.on_wrong_target = True
    second.robot.joints = first.robot.joints
    return second


def went_to(cell: FakeCell, direction: Vector3) -> bool:
    """Whether the tracker was sent there at any distance."""
    sent_mm = (np.array(call[1]) for call in cell.named("tracker.go_to"))
    return any(dist(point_mm / np.linalg.norm(point_mm), direction) < 1e-3 for point_mm in sent_mm)


def test_session_that_begins_on_a_wrong_target_uses_the_direction_in_which_the_first_began(
    tmp_path: Path,
) -> None:
    cell = begin_on_a_wrong_target(tmp_path, TWO_PAIRS, stop_at_move=2)
    journal = cell.run(tmp_path, work())
    shots = [shot.outcome for shot in journal.shots()]
    assert [dist(shot.point_in_tracker_mm, true_mm(shot)) < 0.01 for shot in shots] == [True] * 6
    starts = [entry.record.beam for entry in journal.records_of(SessionStarted)]
    assert went_to(cell, starts[0].direction)
    assert not went_to(cell, starts[1].direction)


def test_wrong_shot_whose_row_was_removed_is_voided_and_nothing_measured_in_its_place(
    tmp_path: Path,
) -> None:
    plan = (drift(0), drift(10), *TWO_PAIRS[1:5])
    cell = begin_on_a_wrong_target(tmp_path, plan, stop_at_move=3)
    shots = [shot.outcome for shot in cell.run(tmp_path, work(plan[1:])).shots()]
    assert [shot.shot for shot in shots] == [1, 2, 3, 4, 10]
    assert [dist(shot.point_in_tracker_mm, true_mm(shot)) < 0.01 for shot in shots] == [True] * 5


def test_tracker_elsewhere_is_named_once_with_the_shots_that_it_cannot_see() -> None:
    """The reflector looks where the tracker was said to stand, a quarter turn from where it is."""
    x, y, z = PLACE_MM
    shots = [Outcome(s.shot, 1, s.joints, true_mm(s), None, None, "", "", None) for s in FOUR_PAIRS]

    def announced(place_mm: Vector3, facing: Vector3 | None = None) -> list[str]:
        station = Station(place_mm, facing, np.radians(25.0), (0.0, 0.0, -575.0))
        monitor = StationMonitor(station, NOMINAL, FOUR_PAIRS)
        counts = range(1, len(shots) + 1)
        return [event.text for count in counts for event in monitor.events(shots[:count])]

    assert announced((x + 60.0, y, z)) == []
    (place,) = announced((x, y, z + 1600.0))
    assert place.startswith(f"the tracker stands at ({x:.0f}, {y:.0f}, {z:.0f}) mm")
    assert "1.6 m off" in place
    _, unseen = announced((-y, x, z), facing=(-y, x, z))
    assert unseen.startswith("from there 10 of 10 shots of the plan cannot be seen")
    assert ": 0–9; move the tracker" in unseen
