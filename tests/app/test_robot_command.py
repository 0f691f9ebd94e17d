"""Robot files from the sizes of a symmetrical robot, by `pkmcal robot`."""

import numpy as np
import pytest

from campaigns.kinematics.catalog import FAMILY, MECHANISMS
from campaigns.robots.robot import find_robot, states_reflector

SIZES = {
    "delta": "--base 200 --platform 45 --arm 300 --forearm 800",
    "linear-delta": "--base 295 --platform 45 --forearm 520 --travel 900 --first 90",
    "par4": "--base 320 --platform 60 --arm 350 --forearm 700 --plate 100",
    "h4": "--base 342.85 --platform 60 --arm 350 --forearm 700 --plate 120",
    "i4r": "--base 320 --platform 60 --arm 350 --forearm 700 --pinion 30",
    "i4l": "--base 380 --platform 60 --forearm 600 --pinion 30",
    "hexapod": "--base 400 --platform 150 --shortest 450 --longest 750",
    "hexaglide": "--base 300 --platform 120 --forearm 520 --travel 600",
    "five-bar": "--base 200 --arm 200 --forearm 250",
}
SHIPPED_SIZES = {"delta", "linear-delta", "hexapod", "hexaglide", "five-bar"}
"""Of every mechanism; some near the shipped robots."""


@pytest.fixture
def made(tmp_path, pkmcal):
    """Makes a robot file; gives its exit code, document and error line."""

    def robot(mechanism, sizes):
        path = tmp_path / "mine.yaml"
        ended = pkmcal("robot", mechanism, *sizes.split(), "--to", path, "--json")
        return ended.code, ended.document if ended.out else None, ended.err.strip()

    return robot


@pytest.mark.parametrize("mechanism", MECHANISMS)
def test_a_file_is_a_robot_that_stands_in_the_middle_of_its_workspace(made, mechanism):
    code, document, _ = made(mechanism, SIZES[mechanism])
    assert code == 0
    robot = find_robot(document["file"]).robot
    assert robot.mechanism.name == mechanism
    assert dict(robot.parameters) == document["geometry"]
    around = np.tile(robot.workspace_centre, (7, 1))
    aside = 50.0 * np.diag([not axis.is_fixed for axis in robot.mechanism.task[:3]])
    around[1:4, :3] += aside
    around[4:, :3] -= aside
    assert robot.kinematics.feasibility(robot.limits, around).feasible.all()
    if mechanism in SHIPPED_SIZES:
        shipped = find_robot(mechanism).robot
        assert document["geometry"] == pytest.approx(dict(shipped.parameters), abs=1e-8)
        assert robot.limits == shipped.limits


@pytest.mark.parametrize(
    ("mechanism", "sizes", "words"),
    [
        ("gantry", "--base 1 --platform 1 --forearm 1", "mechanism 'gantry' is not known"),
        ("delta", "--base 200 --arm 300 --forearm 800", "--platform is missing"),
        ("hexapod", "--base 400 --platform 150 --shortest 450", "--longest is missing"),
        ("hexapod", f"{SIZES['hexapod']} --travel 10", "hexapod has no --travel"),
        ("hexapod", f"{SIZES['hexapod']} --pair 61", "--pair is 61°"),
        ("hexapod", "--base 400 --platform 150 --shortest 9 --longest 8", "not below --longest"),
        ("hexapod", "--base 400 --platform 150 --shortest 20 --longest 30", "does not reach"),
        (
            "hexapod",
            "--base 400 --platform 0 --shortest 450 --longest 750",
            "too near a singularity",
        ),
        ("five-bar", "--base 0.2 --arm 0.2 --forearm 0.25", "mm: metres?"),
        ("five-bar", f"{SIZES['five-bar']} --first 10", "five-bar has no --first"),
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


def test_legs_of_a_pair_stand_as_far_apart_as_is_asked(made):
    _, document, _ = made("hexapod", f"{SIZES['hexapod']} --pair 12 --first 30 --reflector 1,2,-9")
    robot = find_robot(document["file"]).robot
    assert robot.mechanism.reflector_mm == (1.0, 2.0, -9.0)
    for on, first_deg in (("", 30.0), ("plate_", 90.0)):
        x, y = (
            np.array([robot.parameters[f"arm{leg}.{on}{c}_mm"] for leg in range(6)]) for c in "xy"
        )
        directions = np.sort((np.degrees(np.arctan2(y, x)) - first_deg + 20.0) % 360.0)
        assert directions == pytest.approx([8.0, 32.0, 128.0, 152.0, 248.0, 272.0], abs=1e-4)


def test_a_file_that_is_there_stays(made, tmp_path):
    (tmp_path / "mine.yaml").write_text("mine", encoding="utf-8")
    code, _, line = made("delta", SIZES["delta"])
    assert code == 2
    assert "mine.yaml" in line
    assert (tmp_path / "mine.yaml").read_text(encoding="utf-8") == "mine"
