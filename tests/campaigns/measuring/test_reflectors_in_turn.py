"""One reflector carried between the halves of a plate, or one on each of them, in one run."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from fake_cell import FakeCell, FakeTracker
from par4_cases import TRACKER_FROM_BASE
from small_plans import FOUR_PAIRS, work
from tested_journal import Told, journal_in

from campaigns.errors import GateRefused, Interrupted
from campaigns.identification.objects import Object
from campaigns.journal.records import Event, Rejected
from campaigns.measuring.session import measure_series
from campaigns.planning.plan_file import PlannedShot
from drivers import values
from drivers.errors import BeamBroken

HALF_2 = "half 2"
OFF_MM = np.array([3.0, -2.0, 1.0])
"""Where the reflector really sits on half 2, beyond its stated place."""
CARRIERS = {HALF_2: Object(HALF_2, body="half 2", place_mm=(0.0, 0.0, 0.0), std_mm=5.0)}
OF_PAIRS_2_AND_3 = {5, 6, 7, 8}
IN_TURN = tuple(
    replace(shot, reflector=HALF_2) if shot.shot in OF_PAIRS_2_AND_3 else shot
    for shot in FOUR_PAIRS
)


@dataclass
class TrackerOfHalves(FakeTracker):
    """Sees the reflectors on some halves: that which it is on, or is sent to within a radius."""

    mounted: set[str] = field(default_factory=lambda: {""})
    on: str = ""
    radius_mm: float = 50.0

    def place_mm(self, half: str) -> np.ndarray:
        if not half:
            return np.array(super().seen_mm())
        robot = replace(self.truth, mechanism=self.truth.mechanism.seen_from(2))
        plate = robot.forward(self.robot.true_joints()[None]).values_or_raise()[:, :3]
        return np.asarray(TRACKER_FROM_BASE.apply(plate + OFF_MM)[0])

    def seen_mm(self) -> values.Vector3:
        return tuple(self.place_mm(self.on).tolist())

    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:
        self.calls.append(("tracker.go_to", *point_in_tracker_mm))
        away = {
            half: float(np.linalg.norm(self.place_mm(half) - point_in_tracker_mm))
            for half in self.mounted
        }
        nearest = min(away, key=away.__getitem__)
        self.beam_broken = not (self.finds and away[nearest] < self.radius_mm)
        if self.beam_broken:
            raise BeamBroken("no reflector found", remedy="look for it")
        self.on = nearest


@dataclass
class Operator:
    """Carries the one reflector when asked to, and keeps what he was asked."""

    cell: FakeCell
    asked: list[str] = field(default_factory=list)

    def __call__(self, task: str) -> bool:
        self.asked.append(task)
        tracker = self.cell.tracker
        tracker.on = HALF_2 if HALF_2 in task else ""
        tracker.mounted, tracker.beam_broken = {tracker.on}, False
        return True


def cell_of_halves(**changes: object) -> FakeCell:
    cell = FakeCell()
    cell.tracker = TrackerOfHalves(cell.clock, cell.calls, cell.robot, cell.truth, **changes)
    cell.tracker.cancelled = cell.wish
    return cell


def work_in_turn(plan: tuple[PlannedShot, ...] = IN_TURN, **changes: object):
    return work(plan, carriers=CARRIERS, **changes)


def measured(folder: Path, cell: FakeCell, **changes: object) -> tuple[Told, list[str]]:
    operator = Operator(cell)
    with journal_in(folder, cell.calls) as journal:
        devices = replace(cell.devices, ask=operator)
        measure_series(devices, journal, work_in_turn(**changes), cell.observer, cell.wishes)
    return Told(folder), operator.asked


def reflectors_of(told: Told) -> list[str]:
    return [shot.outcome.reflector for shot in told.shots()]


def test_operator_carries_it_and_each_shot_says_which_it_measured(tmp_path: Path) -> None:
    told, asked = measured(tmp_path, cell_of_halves())
    assert reflectors_of(told) == [shot.reflector for shot in IN_TURN]
    assert [task.partition(": ")[2].partition(",")[0] for task in asked] == [
        "move the reflector to half 2",
        "move the reflector to its own place",
    ]
    notes = [e.record.text for e in told.records_of(Event) if "measured from here" in e.record.text]
    assert notes == [
        "measured from here on: the reflector on half 2, carried there",
        "measured from here on: the reflector at its own place, carried there",
    ]


def test_beam_that_came_with_it_is_not_pointed_away(tmp_path: Path) -> None:
    cell = cell_of_halves()
    measured(tmp_path, cell)
    assert not cell.named("tracker.go_to")
    assert not [text for text in cell.observer.events if "broken" in text]


def test_gate_predicts_the_point_of_the_half(tmp_path: Path) -> None:
    told, _ = measured(tmp_path, cell_of_halves())
    *kept, last = [shot for shot in told.shots() if shot.outcome.reflector]
    others = [shot for shot in told.shots() if not shot.outcome.reflector]
    away_mm, std_mm = [], []
    for shots in (others, (*others, *kept)):
        point, std = work_in_turn().gate_after(shots).predict(last.outcome.joints, HALF_2)
        away_mm.append(np.linalg.norm(point - last.outcome.point_in_tracker_mm))
        std_mm.append(std)
    assert away_mm[0] == pytest.approx(np.linalg.norm(OFF_MM), abs=0.5)
    assert away_mm[1] < 0.2 * away_mm[0]  # its own shots show where it sits
    assert 50.0 < std_mm[0] < 60.0  # nothing says where the robot's own reflector sits, to 30 mm
    assert std_mm[1] < 0.6 * std_mm[0]


def test_tracker_finds_a_second_reflector_itself_and_nobody_is_asked(tmp_path: Path) -> None:
    told, asked = measured(tmp_path, cell_of_halves(mounted={"", HALF_2}, tells_direction=True))
    assert not asked
    assert reflectors_of(told) == [shot.reflector for shot in IN_TURN]


def test_former_reflector_that_a_wide_search_finds_is_not_taken_for_the_other(
    tmp_path: Path,
) -> None:
    told, asked = measured(tmp_path, cell_of_halves(radius_mm=150.0, tells_direction=True))
    assert len(asked) == 2
    assert reflectors_of(told) == [shot.reflector for shot in IN_TURN]


def test_a_tracker_that_is_aimed_by_hand_is_not_asked_for_a_point_of_no_shot(
    tmp_path: Path,
) -> None:
    cell = cell_of_halves()
    told, asked = measured(tmp_path, cell)
    assert len(asked) == 2
    assert len(cell.named("tracker.measure")) == len(told.shots()) + len(told.records_of(Rejected))


def test_both_reflectors_at_each_stop_are_measured_without_a_motion_between(tmp_path: Path) -> None:
    twice = tuple(
        replace(shot, shot=2 * shot.shot + number, pair=None, reflector=reflector,
                purpose=FOUR_PAIRS[0].purpose if shot.pair is None else shot.purpose)
        for shot in FOUR_PAIRS if shot.pair is None
        for number, reflector in enumerate(("", HALF_2))
    )  # fmt: skip
    plan = (*FOUR_PAIRS[:5], *(replace(shot, shot=100 + shot.shot) for shot in twice))
    cell = cell_of_halves(mounted={"", HALF_2}, tells_direction=True)
    told, asked = measured(tmp_path, cell, plan=plan)
    assert not asked
    assert reflectors_of(told)[-4:] == ["", HALF_2] * 2
    joints = [shot.outcome.joints for shot in told.shots()][-4:]
    assert joints[0] == joints[1]


def test_with_nobody_there_the_run_ends_in_order_and_says_what_to_do(tmp_path: Path) -> None:
    cell = cell_of_halves()
    with pytest.raises(GateRefused, match="move the reflector to half 2") as refused:
        cell.run(tmp_path, work_in_turn())
    assert "place_mm" in refused.value.remedy
    told = Told(tmp_path)
    assert reflectors_of(told) == [""] * 5
    assert cell.calls[-2:] == [("robot.stop",), ("journal.session-stopped",)]


def test_resumed_run_goes_on_with_the_half_that_it_ended_on(tmp_path: Path) -> None:
    cell = cell_of_halves()
    operator = Operator(cell)
    cell.robot.during_move = {7: cell.wish.ask}
    devices = replace(cell.devices, ask=operator)
    with journal_in(tmp_path, cell.calls) as journal, pytest.raises(Interrupted):
        measure_series(devices, journal, work_in_turn(), cell.observer, cell.wishes)
    again = cell_of_halves(mounted={HALF_2}, on=HALF_2)
    again.robot.joints = cell.robot.true_joints()
    again.robot._from = again.robot.joints
    told, asked = measured(tmp_path, again)
    assert len(asked) == 1
    assert "to its own place" in asked[0]
    assert reflectors_of(told) == [shot.reflector for shot in IN_TURN]


def test_reflector_left_on_the_wrong_half_is_refused(tmp_path: Path) -> None:
    cell = cell_of_halves()
    with journal_in(tmp_path, cell.calls) as journal:
        devices = replace(cell.devices, ask=lambda _: True)  # says so, and does nothing
        measure_series(devices, journal, work_in_turn(), cell.observer, cell.wishes)
    told = Told(tmp_path)
    assert HALF_2 not in reflectors_of(told)
    refused = [
        e.record.shot for e in told.records_of(Rejected) if "it was not moved" in e.record.reason
    ]
    assert {5, 7} <= {*refused}
