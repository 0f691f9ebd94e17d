"""Nests: measured while the robot stands still, with the beam sent there and back."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest
from fake_cell import FakeCell, FakeTracker
from small_plans import GATE, TWO_PAIRS, work
from tested_journal import Told, journal_in

from campaigns.errors import GateRefused
from campaigns.journal.records import Event
from campaigns.measuring.session import measure_series
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import with_nests
from campaigns.settings.sections import KnownLengthConfig, NestConfig
from drivers import values

PLACES = {"A": (900.0, 300.0, -200.0), "B": (1900.0, 300.0, -200.0), "C": (900.0, -700.0, 400.0)}
NESTS = tuple(NestConfig(name=name, place_mm=mm, occupied=True) for name, mm in PLACES.items())
BAR = KnownLengthConfig(name="bar", length_mm=1000.0, std_mm=0.01, nests=("A", "B"))
PLAN = with_nests(TWO_PAIRS, NESTS, (BAR,))


@dataclass
class TrackerOfNests(FakeTracker):
    """Sees the reflectors in nests too: the nearest to where it is sent, within 50 mm."""

    places: dict[str, tuple[float, float, float]] = field(default_factory=lambda: dict(PLACES))
    on: str = ""

    def prepare(self, reflector: str, measuring_time_s: float) -> None:
        self.calls.append(("tracker.prepare", reflector))

    def seen_mm(self) -> values.Vector3:
        return self.places[self.on] if self.on else super().seen_mm()

    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:
        near = [
            n
            for n, mm in self.places.items()
            if np.linalg.norm(np.subtract(mm, point_in_tracker_mm)) < 50.0
        ]
        self.on = near[0] if near else ""
        super().go_to(point_in_tracker_mm)


def cell_of_nests(**changes: object) -> FakeCell:
    cell = FakeCell()
    cell.tracker = TrackerOfNests(cell.clock, cell.calls, cell.robot, cell.truth, **changes)
    cell.tracker.cancelled = cell.wish
    return cell


def work_at(nests: Sequence[NestConfig] = NESTS, plan: Sequence[PlannedShot] = PLAN):
    return work(plan, nests=tuple(nests), reflector="CCR")


def changed_nest(name: str, **changes: object) -> NestConfig:
    return next(nest for nest in NESTS if nest.name == name).model_copy(update=changes)


def test_beam_goes_to_each_nest_and_back_and_the_robot_stays(tmp_path: Path) -> None:
    cell = cell_of_nests()
    told = cell.run(tmp_path, work_at())
    shots = told.shots()
    assert [shot.intent.nest for shot in shots if shot.intent.nest] == ["A", "B", "C"] * 2
    for shot in shots:
        at_mm = shot.outcome.point_in_tracker_mm
        assert (at_mm == PLACES.get(shot.intent.nest)) is bool(shot.intent.nest)
        assert not (shot.intent.nest and shot.outcome.predicted_in_tracker_mm)
        assert shot.outcome.joints
    kinds = [e.record.text for e in told.records_of(Event) if e.record.kind == "drift check"]
    assert sum("nest B is 0.000 mm from where it was first" in text for text in kinds) == 2
    assert cell.tracker.on == ""  # it ends on the robot


def test_other_reflector_is_chosen_in_its_nest_and_the_robots_again(tmp_path: Path) -> None:
    cell = cell_of_nests()
    cell.run(tmp_path, work_at((*NESTS[:2], changed_nest("C", reflector="1/2in"))))
    assert [call[1] for call in cell.named("tracker.prepare")] == ["1/2in", "CCR"] * 2


def test_operator_is_asked_for_what_nobody_else_can_do(tmp_path: Path) -> None:
    cell, asked = cell_of_nests(), []
    untaught = changed_nest("C", occupied=False, place_mm=None)

    def ask(what: str) -> bool:
        asked.append(what)
        cell.tracker.on = "C" if "point the beam" in what else cell.tracker.on
        return True

    with journal_in(tmp_path, cell.calls) as journal:
        devices = replace(cell.devices, ask=ask)
        measure_series(
            devices, journal, work_at((*NESTS[:2], untaught)), cell.observer, cell.wishes
        )
    words = [text.removeprefix("the robot stands still: ").split(" and ")[0] for text in asked]
    put, back = "put the reflector into nest C", "put the reflector back onto the robot"
    assert words == [put, "point the beam at the reflector in nest C", back, put, back]
    assert len(Told(tmp_path).shots()) == len(PLAN)


def test_nobody_there_to_put_a_reflector_stops_the_run_in_order(tmp_path: Path) -> None:
    cell = cell_of_nests()
    with pytest.raises(GateRefused, match="put the reflector into nest C") as refused:
        cell.run(tmp_path, work_at((*NESTS[:2], changed_nest("C", occupied=False))))
    assert "occupied: true" in refused.value.remedy
    stopped = [("robot.stop",), ("journal.rejected", 3, 1), ("journal.session-stopped",)]
    assert cell.calls[-3:] == stopped


def test_robots_reflector_is_no_nest(tmp_path: Path) -> None:
    cell = cell_of_nests(places={"A": PLACES["A"], "B": PLACES["B"]})
    at_robot_mm = cell.tracker.seen_mm()
    with pytest.raises(GateRefused, match=r"nest C is 0\.0 mm from the reflector of the robot"):
        cell.run(tmp_path, work_at((*NESTS[:2], changed_nest("C", place_mm=at_robot_mm))))
    assert all(shot.intent.nest != "C" for shot in Told(tmp_path).shots())


def test_nest_that_cannot_be_seen_is_skipped_and_named(tmp_path: Path) -> None:
    cell = cell_of_nests(places={"A": PLACES["A"], "B": PLACES["B"]}, searches=False)
    told = cell.run(tmp_path, work_at())
    skipped = {e.record.shots for e in told.records_of(Event) if e.record.kind == "shot skipped"}
    assert skipped == {(3,), (11,)}
    assert len(told.shots()) == len(PLAN) - 2


def test_nest_that_is_elsewhere_is_told(tmp_path: Path) -> None:
    cell = cell_of_nests()
    cell.robot.during_move = {
        6: lambda: cell.tracker.places.update(A=(900.0, 300.0, -200.0 + 1.5 * GATE.drift_mm))
    }
    cell.run(tmp_path, work_at())
    assert [text for text in cell.observer.events if "nest A is 1.500 mm" in text]
