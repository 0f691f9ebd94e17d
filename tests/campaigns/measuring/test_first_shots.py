"""First shots of a series: the wrong one among them, and the tracker's place."""

from dataclasses import replace
from math import dist
from pathlib import Path

import numpy as np
import pytest
from fake_cell import NOMINAL, TRACKER_FROM_BASE, FakeCell
from small_plans import FOUR_PAIRS, TWO_PAIRS, drift, pair, work
from tested_journal import journal_in

from campaigns.errors import GateRefused, Interrupted
from campaigns.journal.records import Event, Outcome, PairVoided, SessionStarted
from campaigns.measuring.monitors import Station, StationMonitor
from campaigns.planning.plan_file import PlannedShot
from drivers.values import Vector3

PLACE_MM = tuple(TRACKER_FROM_BASE.inverted().translation_mm.tolist())
STATION = Station(PLACE_MM, None, np.radians(25.0), (0.0, 0.0, -575.0))


MORE = (
    *pair(9, 4, (-150.0, -60.0, -560.0, 0.1), (120.0, -80.0, -620.0, -0.1)),
    *pair(11, 5, (80.0, 160.0, -520.0, -0.2), (-60.0, 120.0, -680.0, 0.3)),
)


def shifts(cell: FakeCell, by_mm: float):
    def shift() -> None:
        cell.tracker.shifted_mm[1] = by_mm

    return shift


def events_of(journal, kind: str) -> list[str]:
    return [e.record.text for e in journal.records_of(Event) if e.record.kind == kind]


def true_mm(outcome: Outcome | PlannedShot) -> tuple[float, ...]:
    pose = NOMINAL.forward(np.array([outcome.joints])).values_or_raise()[:, :3]
    return tuple(TRACKER_FROM_BASE.apply(pose)[0].tolist())


def test_first_shot_off_by_less_than_the_gate_of_distances_is_found_when_the_fit_is_firmer(
    tmp_path: Path,
) -> None:
    plan = (*FOUR_PAIRS[:-1], *MORE)
    cell = FakeCell()
    cell.tracker.during_measure = {1: shifts(cell, 10.0), 2: shifts(cell, 0.0)}
    journal = cell.run(tmp_path, work(plan))
    assert [e.record.shots for e in journal.records_of(PairVoided)][-1] == (0,)
    points = [shot.outcome for shot in journal.shots()]
    assert len(points) == len(plan)
    assert dist(points[0].point_in_tracker_mm, true_mm(points[0])) < 0.01


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


def test_right_first_shot_is_confirmed_and_the_wrong_later_one_is_taken_again(
    tmp_path: Path,
) -> None:
    cell = FakeCell()
    cell.tracker.during_measure = {2: shifts(cell, 400.0), 3: shifts(cell, 0.0)}
    journal = cell.run(tmp_path, work())
    assert [shot.outcome.attempt for shot in journal.shots()] == [1, 2, 1, 1, 1, 1]
    assert not journal.records_of(PairVoided)
    assert [call[1:] for call in cell.named("journal.intent")][:3] == [(0, 1), (1, 1), (0, 2)]


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


def went_to(cell: FakeCell, direction: Vector3) -> bool:
    """Whether the tracker was sent there at any distance."""
    sent_mm = (np.array(call[1]) for call in cell.named("tracker.go_to"))
    return any(dist(point_mm / np.linalg.norm(point_mm), direction) < 1e-3 for point_mm in sent_mm)


def test_session_that_begins_on_a_wrong_target_uses_the_direction_in_which_the_first_began(
    tmp_path: Path,
) -> None:
    """Nothing has contradicted the first shot yet when the first session is cut off."""
    first, second = FakeCell(), FakeCell()
    for cell in (first, second):
        cell.tracker.tells_direction = True
    began = first.tracker.direction()
    first.tracker.during_measure = {1: first.tracker.take_wrong_target}
    first.robot.during_move = {2: first.wish.ask}
    with journal_in(tmp_path, first.calls) as journal, pytest.raises(Interrupted):
        first.measure(journal, work())
    second.tracker.on_wrong_target = True
    second.robot.joints = first.robot.joints
    journal = second.run(tmp_path, work())
    points = [shot.outcome for shot in journal.shots()]
    starts = [entry.record.beam for entry in journal.records_of(SessionStarted)]
    assert [dist(p.point_in_tracker_mm, true_mm(p)) < 0.01 for p in points] == [True] * 6
    assert starts[0].direction == pytest.approx(began)
    assert went_to(second, starts[0].direction)
    assert not went_to(second, starts[1].direction)


def places_told(place_mm, **changes) -> list[str]:
    """By a monitor that sees the plan's shots come in."""
    station = replace(STATION, place_mm=tuple(place_mm), **changes)
    monitor = StationMonitor(station, NOMINAL, FOUR_PAIRS)
    seen = [Outcome(s.shot, 1, s.joints, true_mm(s), None, None, "", "", None) for s in FOUR_PAIRS]
    return [e.text for count in range(len(seen)) for e in monitor.events(seen[: count + 1])]


def test_tracker_elsewhere_is_named_once_with_its_place_and_how_far_off() -> None:
    """All directions are seen, so that nothing is said of the plan."""
    assert places_told(np.add(PLACE_MM, (60.0, 0.0, 0.0))) == []
    wrong_mm = np.add(PLACE_MM, (0.0, 0.0, 1600.0))
    at, said = (f"({', '.join(f'{v:.0f}' for v in place)})" for place in (PLACE_MM, wrong_mm))
    assert places_told(wrong_mm)[-1] == (
        f"the tracker stands at {at} mm, campaign.yaml says {said}: 1.6 m off; "
        "correct tracker.place_mm"
    )


def test_plan_that_cannot_be_seen_from_the_found_place_is_named() -> None:
    """The reflector looks where the tracker was said to stand, a quarter turn from where it is."""
    x, y, z = PLACE_MM
    told = places_told((-y, x, z), facing=(-y, x, z))
    assert told[-1].startswith("from there 10 of 10 shots of the plan cannot be seen")
    assert ": 0–9; move the tracker" in told[-1]


def test_wrong_shot_whose_row_was_removed_is_voided_and_nothing_measured_in_its_place(
    tmp_path: Path,
) -> None:
    """Two drift shots of a reflector that stands elsewhere; then the first one's row goes."""
    first, second = FakeCell(), FakeCell()
    for cell in (first, second):
        cell.tracker.tells_direction = True
    plan = (drift(0), drift(10), *TWO_PAIRS[1:5])
    first.tracker.during_measure = {1: first.tracker.take_wrong_target}
    first.robot.during_move = {3: first.wish.ask}
    with journal_in(tmp_path, first.calls) as journal, pytest.raises(Interrupted):
        first.measure(journal, work(plan))
    second.tracker.on_wrong_target = True
    second.robot.joints = first.robot.joints
    journal = second.run(tmp_path, work(plan[1:]))
    assert [shot.intent.shot for shot in journal.shots()] == [1, 2, 3, 4, 10]
    assert all(
        dist(s.outcome.point_in_tracker_mm, true_mm(s.outcome)) < 0.01 for s in journal.shots()
    )
