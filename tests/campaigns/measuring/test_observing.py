"""Observations: the robot goes to each of their poses, and somebody reads a value there."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from fake_cell import FakeCell
from small_plans import OPEN, SETTLE, SPEED_FRACTION, joints_at

from campaigns.errors import InstrumentMissing
from campaigns.measuring.instruments import Answer, Task
from campaigns.measuring.observing import ObservationWork, Observing
from campaigns.shots.observation_records import PlannedRow, planned_rows
from campaigns.shots.observations_csv import ObservationRow
from drivers.errors import BeamBroken
from drivers.values import NoValue

PLACES = [(100.0, 40.0, -600.0, 0.0), (-80.0, 60.0, -560.0, 0.1), (20.0, -90.0, -640.0, -0.2)]


def row(kind: str, of: str, *places: tuple[float, ...], pair: str = "") -> ObservationRow:
    joints = tuple(tuple(joints_at(*place).tolist()) for place in places)
    return ObservationRow(kind, of, joints, (), 0.02, pair=pair)


HEIGHTS = [row("height", "bed", place) for place in PLACES]
DISTANCE = row("distance", "part", *PLACES[:2], pair="1")


@dataclass
class Bench:
    """A cell with an instrument that gives answers in turn, and keeps what it was asked."""

    answers: list[Answer | Exception]
    cell: FakeCell = field(default_factory=FakeCell)
    asked: list[Task] = field(default_factory=list)
    kept: list[tuple[PlannedRow, ObservationRow]] = field(default_factory=list)
    calls_when_kept: list[int] = field(default_factory=list)

    def read(self, task: Task) -> Answer:
        self.asked.append(task)
        answer = self.answers[len(self.asked) - 1]
        if isinstance(answer, Exception):
            raise answer
        return answer

    def keep(self, planned: PlannedRow, measured: ObservationRow) -> None:
        self.kept.append((planned, measured))
        self.calls_when_kept.append(len(self.cell.named("robot.move_joints")))

    def observe(self, rows: list[ObservationRow]):
        work = ObservationWork(
            planned=planned_rows(rows),
            robot=OPEN,
            speed_fraction=SPEED_FRACTION,
            settle=SETTLE,
            keep=self.keep,
            now_utc=lambda: "2026-11-29T01:00:00+00:00",
        )
        devices = replace(self.cell.devices, instrument=self.read)
        return Observing(devices, work, self.cell.observer, self.cell.wishes).run()

    @property
    def values(self) -> list[tuple[float, ...]]:
        return [measured.values for _, measured in self.kept]


def test_each_value_is_kept_before_the_robot_moves_again():
    bench = Bench([(1.0,), (2.0,), (3.0,)])
    result = bench.observe(HEIGHTS)
    assert (result.measured, result.skipped) == (3, ())
    assert bench.values == [(1.0,), (2.0,), (3.0,)]
    assert bench.calls_when_kept == sorted({*bench.calls_when_kept})
    for (_, measured), planned in zip(bench.kept, HEIGHTS, strict=True):
        assert measured.joints[0] == pytest.approx(planned.joints[0], abs=1e-9)
        assert measured.time == "2026-11-29T01:00:00+00:00"


def test_a_distance_is_read_at_its_second_pose_and_marked_at_its_first():
    bench = Bench([(), (141.5,)])
    bench.observe([DISTANCE])
    assert [task.columns for task in bench.asked] == [(), ("value_mm",)]
    assert "pose 1 of 2, at x 100.00 y 40.00 z -600.00 mm" in bench.asked[0].question
    [(_, measured)] = bench.kept
    assert len(measured.joints) == 2


def test_the_one_before_is_read_again():
    bench = Bench([(1.0,), NoValue.BACK, (1.5,), (2.0,), (3.0,)])
    assert bench.observe(HEIGHTS).measured == 3
    assert bench.values == [(1.0,), (1.5,), (2.0,), (3.0,)]
    assert bench.kept[0][0] == bench.kept[1][0]


def test_what_is_skipped_is_named_and_the_others_are_measured():
    bench = Bench([(1.0,), NoValue.SKIPPED, (3.0,)])
    result = bench.observe(HEIGHTS)
    assert result.measured == 2
    assert result.skipped == ("height of bed, line 0: skipped by the operator",)
    assert result.skipped[0] in bench.cell.observer.events[0]


def test_a_row_whose_joints_the_robot_may_not_take_moves_nothing():
    far = replace(HEIGHTS[0], joints=((2.5, 2.5, 2.5, 2.5),))
    bench = Bench([(2.0,)])
    result = bench.observe([far, HEIGHTS[1]])
    assert result.measured == 1
    assert "no safe way" in result.skipped[0]
    assert bench.calls_when_kept == [1]


def test_values_in_degrees_become_radians():
    probe = row("probe", "probe", PLACES[0])
    bench = Bench([(1.0, 2.0, 3.0, 90.0, 0.0, 0.0)])
    bench.observe([probe])
    assert bench.values[0] == pytest.approx((1.0, 2.0, 3.0, np.pi / 2.0, 0.0, 0.0))


def test_the_robot_is_stopped_before_an_error_leaves():
    bench = Bench([(1.0,), BeamBroken("lost", remedy="find it")])
    with pytest.raises(BeamBroken):
        bench.observe(HEIGHTS)
    assert bench.cell.calls[-1] == ("robot.stop",)
    assert bench.values == [(1.0,)]


def test_a_robot_that_was_pushed_meanwhile_gives_no_value():
    bench = Bench([(1.0,), (2.0,)])

    def push(task: Task) -> Answer:
        bench.cell.robot.joints = bench.cell.robot.joints + 0.01
        return Bench.read(bench, task)

    bench.read = push
    result = bench.observe(HEIGHTS[:1])
    assert result.measured == 0
    assert "the robot moved" in result.skipped[0]


def test_without_an_instrument_nothing_moves():
    bench = Bench([])
    with pytest.raises(InstrumentMissing, match="3 observations wait"):
        Observing(
            bench.cell.devices,
            ObservationWork(planned_rows(HEIGHTS), OPEN, SPEED_FRACTION, SETTLE, bench.keep, str),
            bench.cell.observer,
            bench.cell.wishes,
        )
    assert not bench.cell.named("robot.move_joints")


def test_equal_rows_are_two_observations():
    first, second = planned_rows([HEIGHTS[0], replace(HEIGHTS[0], line=9)])
    assert first.key != second.key
    (moved,) = planned_rows([replace(HEIGHTS[0], line=9)])
    assert moved.key == first.key  # wherever it stands in the file
