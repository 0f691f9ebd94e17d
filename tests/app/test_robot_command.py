"""Robot files from the sizes of a symmetrical robot, by `pkmcal robot`."""

import numpy as np
import pytest

from campaigns.kinematics.catalog import FAMILY
from campaigns.robots.robot import find_robot, states_reflector

SIZES = {
    "delta": "--base 200 --platform 45 --arm 300 --forearm 800",
    "linear-delta": "--base 295 --platform 45 --forearm 520 --travel 900 --first 90",
    "par4": "--base 320 --platform 60 --arm 350 --forearm 700 --plate 100",
    "h4": "--base 342.85 --platform 60 --arm 350 --forearm 700 --plate 120",
    "i4r": "--base 320 --platform 60 --arm 350 --forearm 700 --pinion 30",
    "i4l": "--base 380 --platform 60 --forearm 600 --pinion 30",
}
"""Of every mechanism; some near the shipped robots."""


@pytest.fixture
def made(tmp_path, pkmcal):
    """Makes a robot file; gives its exit code, document and error line."""

    def robot(mechanism, sizes):
        path = tmp_path / "mine.yaml"
        ended = pkmcal("robot", mechanism, *sizes.split(), "--to", path, "--json")
        return ended.code, ended.document if ended.out else None, ended.err.strip()

    return robot


@pytest.mark.parametrize("mechanism", FAMILY)
def test_a_file_is_a_robot_that_stands_in_the_middle_of_its_workspace(made, mechanism):
    code, document, _ = made(mechanism, SIZES[mechanism])
    assert code == 0
    robot = find_robot(document["file"]).robot
    assert robot.mechanism.name == mechanism
    assert dict(robot.parameters) == document["geometry"]
    around = np.tile(robot.workspace_centre, (7, 1))
    around[1:4, :3] += 50.0 * np.eye(3)
    around[4:, :3] -= 50.0 * np.eye(3)
    assert robot.kinematics.feasibility(robot.limits, around).feasible.all()
    if mechanism in {"delta", "linear-delta"}:  # by the sizes of the shipped one
        shipped = find_robot(mechanism).robot
        assert document["geometry"] == pytest.approx(dict(shipped.parameters), abs=1e-8)
        assert robot.limits == shipped.limits


@pytest.mark.parametrize(
    ("mechanism", "sizes", "words"),
    [
        ("hexapod", "--base 1 --platform 1 --forearm 1", "mechanism 'hexapod' is not known"),
        ("delta", "--base 200 --platform 45 --forearm 800", "--arm is missing"),
        ("delta", f"{SIZES['delta']} --plate 10", "delta has no --plate"),
        ("linear-delta", "--base 0.25 --platform 0.03 --forearm 2.9 --travel 0.9", "mm: metres?"),
        ("delta", "--base nan --platform 45 --arm 300 --forearm 800", "--base is nan mm"),
        ("delta", "--base 200 --platform -1 --arm 300 --forearm 800", "--platform is -1 mm"),
    ],
)
def test_sizes_that_make_no_robot_are_refused(made, tmp_path, mechanism, sizes, words):
    code, _, line = made(mechanism, sizes)
    assert code == 2
    assert words in line
    assert "→" in line
    assert not (tmp_path / "mine.yaml").exists()


@pytest.mark.parametrize("mechanism", FAMILY)
def test_a_file_has_the_joints_on_the_plate_and_a_reflector_that_is_stated(made, mechanism):
    code, document, _ = made(mechanism, f"{SIZES[mechanism]} --reflector -20,30,-45")
    assert code == 0
    plate = find_robot(document["file"]).robot.mechanism.plate
    assert plate.reflector_mm == (-20.0, 30.0, -45.0)
    shipped = find_robot("par4-prototype" if mechanism == "par4" else mechanism).robot
    assert np.abs(np.subtract(plate.joints_mm, shipped.mechanism.plate.joints_mm)).max() < 0.05


def test_a_reflector_is_not_stated_where_nobody_answers(made):
    code, _, line = made("delta", f"{SIZES['delta']} --reflector 1,2,x")
    assert code == 2
    assert "'1,2,x' is no place" in line
    _, document, _ = made("delta", SIZES["delta"])
    assert not states_reflector(find_robot(document["file"]))


def test_a_file_that_is_there_stays(made, tmp_path):
    (tmp_path / "mine.yaml").write_text("mine", encoding="utf-8")
    code, _, line = made("delta", SIZES["delta"])
    assert code == 2
    assert "mine.yaml" in line
    assert (tmp_path / "mine.yaml").read_text(encoding="utf-8") == "mine"
