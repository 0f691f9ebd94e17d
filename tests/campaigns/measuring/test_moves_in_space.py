"""Moves of a run in a restricted space: from wherever the robot stands, and after a restart."""

from pathlib import Path

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, FakeCell, FakeRobot
from small_plans import FOUR_PAIRS, LIMITS, work

from campaigns.design.restricted_space import ANYWHERE, Disc, Rectangle, RestrictedSpace, Zone
from campaigns.errors import GateRefused, Interrupted, JogRequired
from campaigns.planning.paths import RobotModel

PILLAR = Zone("pillar", Disc((60.0, 10.0), 10.0), ANYWHERE, keeps_in=False)
FLOOR = Zone("space.z_lowest_mm -720", Rectangle(), (-720.0, np.inf), keeps_in=True)
SPACE = RestrictedSpace((PILLAR, FLOOR), 20.0, 5.0)
LOOKS = 2000


@pytest.fixture
def paths(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """Joint paths (N, n) of every move that a robot is given."""
    recorded: list[np.ndarray] = []
    move = FakeRobot._move

    def watched(robot: FakeRobot, target: np.ndarray, speed_fraction: float) -> None:
        here = robot.true_joints()
        recorded.append(here + np.linspace(0.0, 1.0, LOOKS)[:, None] * (target - here))
        move(robot, target, speed_fraction)

    monkeypatch.setattr(FakeRobot, "_move", watched)
    return recorded


def fenced_work():
    return work(FOUR_PAIRS, robot=RobotModel(NOMINAL, LIMITS, CENTRE, SPACE))


def least_mm(paths: list[np.ndarray]) -> float:
    points = NOMINAL.forward(np.vstack(paths)).values_or_raise()[:, :3]
    return float(SPACE.clearance_mm(points).min())


def standing_at(cell: FakeCell, *pose: float) -> None:
    cell.robot.joints = NOMINAL.inverse(np.array([pose])).values_or_raise()[0]


def measure(cell: FakeCell, folder: Path) -> None:
    cell.run(folder, fenced_work())


@pytest.mark.slow
def test_a_run_keeps_to_the_space_and_starts_from_no_place_that_the_centre_does_not_see(
    paths, tmp_path: Path
) -> None:
    cell = FakeCell()
    cell.robot.during_move = {6: cell.wish.ask}
    with pytest.raises(Interrupted):
        measure(cell, tmp_path)
    assert least_mm(paths) > -0.02
    paths.clear()
    hidden = FakeCell()
    standing_at(hidden, 110.0, 15.0, -600.0, 0.0)  # the pillar stands before the centre
    with pytest.raises(GateRefused, match="no safe way to shot 0"):
        measure(hidden, tmp_path)
    assert paths == []


def test_a_robot_in_a_forbidden_place_is_not_moved(paths, tmp_path: Path) -> None:
    cell = FakeCell()
    standing_at(cell, 0.0, -100.0, -735.0, 0.0)
    with pytest.raises(JogRequired) as caught:
        measure(cell, tmp_path)
    assert caught.value.problem == (
        "no way to shot 0: the robot stands where it may not be: "
        "z -735 mm is below space.z_lowest_mm -720 with margin_mm 5"
    )
    assert [call[1:] for call in cell.named("journal.intent")] == [(0, 1)], "and asked for once"
    assert "jog it out of there" in str(caught.value)
    assert paths == []
