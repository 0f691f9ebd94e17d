"""Where the robot may not go: no way of the simulated robot crosses it, in any command."""

import shutil
from itertools import pairwise

import numpy as np
import pytest
from command_line import change
from par4_space import par4

from app.main import run_command
from campaigns.robots.robot import find_robot
from sim.robot.assembly import follow
from sim.robot.controller import SimulatedController

pytestmark = pytest.mark.long

SMALL_TESTS = {
    "plan.shots": 32,
    "plan.validation_pairs": 4,
    "validation.repeatability_approaches": 4,
    "validation.line_lengths_mm": [300.0, 300.0, 150.0],
}
SPACE = {
    "space.z_lowest_mm": -720.0,
    "space.z_highest_mm": -420.0,
    "space.radius_mm": 520.0,
    "space.margin_mm": 20.0,
    "space.keep_out.boxes": [
        {"name": "conveyor", "x_mm": [-400.0, -150.0], "y_mm": [150.0, 400.0]},
        {"name": "wall", "x_mm": [330.0, 332.0]},
        {"name": "shelf", "x_mm": [-600.0, -200.0], "y_mm": [-400.0, 60.0], "z_mm": [-600, -599]},
    ],
    "space.keep_out.cylinders": [{"centre_mm": [185.0, -270.0], "radius_mm": 20.0}],
}
HALF_WAY = {"kind": "drive_fault", "seconds": 5.0}
STOPPED_HALF_WAY = {"faults": [{"at_move": 12, **HALF_WAY}, {"at_move": 65, **HALF_WAY}]}
"""Once in the first validation, once in the run."""
LOOKS = 400
TRUE_LOOKS = 6
NOMINAL = par4(dict(find_robot("par4-prototype").robot.parameters))


class Recorder:
    """Joint paths of the simulated controller, and where the true robot's plate is on them."""

    def __init__(self, monkeypatch):
        self.paths, self.true_points = [], []
        start = SimulatedController._start

        def recorded(controller, target, speed_fraction, now_s):
            took_s = start(controller, target, speed_fraction, now_s)
            motion = controller._motion
            at = now_s + motion.duration_s * np.linspace(0.0, 1.0, LOOKS)
            self.paths.append(np.array([motion.joints(t) for t in at]))
            self._follow(controller._robot, self.paths[-1])
            return took_s

        monkeypatch.setattr(SimulatedController, "_start", recorded)

    def _follow(self, robot, path):
        assembly = robot.standing.assembly
        for joints in path[:: LOOKS // TRUE_LOOKS]:
            assembly = follow(robot._mechanism, assembly, joints)
            self.true_points.append(assembly.plate.position_mm)

    def points(self):
        """Points of the nominal robot, (N, 3)."""
        return NOMINAL.forward(np.vstack(self.paths)).values_or_raise()[:, :3]

    def clear(self):
        self.paths.clear()
        self.true_points.clear()


@pytest.fixture
def recorder(monkeypatch):
    return Recorder(monkeypatch)


def least_mm(points, margin_mm):
    """Least clearance of a plate of 100 mm, by SPACE's walls and nothing of the product."""
    x, y, z = np.asarray(points).T
    reach = 100.0 + margin_mm
    kept = [z + 720.0 - margin_mm, -420.0 - z - margin_mm, 520.0 - np.hypot(x, y) - reach]
    kept.append(np.hypot(x - 185.0, y + 270.0) - 20.0 - reach)
    for box in SPACE["space.keep_out.boxes"]:
        dx, dy, dz = (
            np.maximum(np.maximum(box[key][0] - v, v - box[key][1]), 0.0) if key in box else 0.0 * v
            for key, v in (("x_mm", x), ("y_mm", y), ("z_mm", z))
        )
        aside = np.hypot(dx, dy) - reach
        kept.append(np.maximum(aside, dz - margin_mm) if "z_mm" in box else aside)
    return float(np.min(kept))


def assert_held(recorder, least_moves):
    """No motion left the space: the nominal robot's not at all, the true one's by no margin."""
    assert len(recorder.paths) >= least_moves
    for before, after in pairwise(recorder.paths):
        on_it = np.abs(before - after[0]).max(axis=1).min()
        assert on_it < 0.005, "each motion begins where the last one ended, or was stopped"
    assert least_mm(recorder.points(), SPACE["space.margin_mm"]) > -0.05
    assert least_mm(recorder.true_points, 0.0) > 0.0
    recorder.clear()


@pytest.fixture(scope="module")
def fenced_once(planned_once, tmp_path_factory):
    folder = shutil.copytree(planned_once, tmp_path_factory.mktemp("campaigns") / "fenced")
    change(folder / "campaign.yaml", SPACE | SMALL_TESTS)
    change(folder / "cell.yaml", STOPPED_HALF_WAY)
    assert run_command(["plan", str(folder)]) == 0
    return folder


@pytest.fixture
def fenced(fenced_once, tmp_path):
    """A campaign in a cell with a floor, a ceiling, a pillar, a wall, a shelf and a conveyor."""
    return shutil.copytree(fenced_once, tmp_path / "fenced")


def test_no_way_of_the_simulated_robot_leaves_the_space(pkmcal, fenced, recorder):
    validate = ("validate", fenced, "--stage", "before", "--yes")
    assert pkmcal(*validate).code == 3, "stopped half way"
    assert_held(recorder, 10)
    assert pkmcal(*validate).code in (0, 1)
    assert_held(recorder, 15)
    assert pkmcal("run", fenced, "--yes").code == 3, "stopped half way"
    assert_held(recorder, 5)
    resumed = pkmcal("run", fenced, "--yes")
    assert resumed.code == 0, resumed.err
    assert_held(recorder, 30)


def test_the_recorder_sees_a_plan_that_knows_no_space(pkmcal, fenced, recorder):
    """The same plan in an open cell: what the test above looks for can be found."""
    change(fenced / "campaign.yaml", {"space": None})
    assert pkmcal("plan", fenced).code == 0
    assert pkmcal("validate", fenced, "--stage", "before", "--yes").code == 3
    assert least_mm(recorder.points(), SPACE["space.margin_mm"]) < -20.0


def test_candidates_that_the_space_refuses_are_counted_and_its_zones_drawn(
    pkmcal, fenced, tmp_path
):
    told = pkmcal("plan", fenced, "--plot", tmp_path / "plan.svg")
    assert "candidates that could be measured are refused" in told.out
    assert "by space.keep_out.boxes[1] 'wall'" in told.out
    drawn = (tmp_path / "plan.svg").read_text()
    assert ">keep out<" in drawn
    assert "walls 120 mm off" in drawn
    space = pkmcal("plan", fenced, "--json").document["space"]
    assert 0 < space["refused"] < space["tried"]
    assert space["by_zone"]["space.z_lowest_mm -720"] > 0
