"""A robot that stays where it is although its encoders say that it moves."""

from pathlib import Path

import pytest
from fake_cell import FakeCell
from small_plans import FOUR_PAIRS, pair, work

from campaigns.errors import GateRefused

PLAN = (
    *FOUR_PAIRS[:-1],
    *pair(9, 4, (-150.0, -60.0, -560.0, 0.1), (120.0, -80.0, -620.0, -0.1)),
    *pair(11, 5, (80.0, 160.0, -520.0, -0.2), (-60.0, 120.0, -680.0, 0.3)),
)
SOON_S = 200.0


@pytest.mark.parametrize(("measured", "searches"), [(1, True), (6, True), (9, False)])
def test_it_is_named_soon_and_waited_for_no_longer(
    tmp_path: Path, measured: int, searches: bool
) -> None:
    """Whether the tracker finds its reflector by itself, or only where it is sent."""
    cell = FakeCell()
    cell.tracker.searches = searches
    cell.tracker.during_measure[measured] = cell.tracker.leave_robot
    cell.clock.after(10.0 * SOON_S, cell.wish.ask)
    with pytest.raises(GateRefused, match="the robot does not move although its encoders say so"):
        cell.run(tmp_path, work(PLAN))
    assert cell.clock.now_s() < SOON_S


def test_beam_is_waited_for_no_longer_than_the_cell_says_with_nobody_there(tmp_path: Path) -> None:
    cell = FakeCell(beam_wait_s=90.0)
    cell.tracker.during_measure[7] = cell.tracker.hide_reflector
    cell.clock.after(3000.0, cell.wish.ask)
    with pytest.raises(GateRefused, match="no reflector found, or the robot does not move"):
        cell.run(tmp_path, work(PLAN))
    assert 90.0 < cell.clock.now_s() < SOON_S


def test_somebody_in_the_beam_is_waited_for_although_the_robot_was_measured_before(
    tmp_path: Path,
) -> None:
    cell = FakeCell()

    def step_in() -> None:
        cell.tracker.hide_reflector()
        cell.clock.after(0.5 * SOON_S, step_out)

    def step_out() -> None:
        cell.tracker.finds = True

    cell.tracker.during_measure[7] = step_in
    assert len(cell.run(tmp_path, work(PLAN)).shots()) == len(PLAN)
    assert cell.clock.now_s() > 0.5 * SOON_S
