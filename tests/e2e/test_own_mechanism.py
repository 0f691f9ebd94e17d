"""A mechanism of one's own, from a Python file: planned, measured elsewhere, identified."""

import csv
import html

import numpy as np
import pytest
from command_line import SMALL_TESTS, change

from campaigns.evaluation.simulated_devices import OWN_EQUATIONS
from campaigns.robots.robot import find_robot

PARTS = """
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.limbs import Crank
from campaigns.kinematics.platforms import HingedPlate

OWN = ClosedChain("quarter-h4", Crank(), HingedPlate(shares=(-0.25, -0.25, 0.75, 0.75)))
OTHER = "par4"
"""
TRACKER_MM = np.array([2400.0, -300.0, -600.0])


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "parts" / "my.py"
    path.parent.mkdir()
    path.write_text(PARTS, encoding="utf-8")
    return path


def measured(campaign, robot):
    """The planned shots as somebody else's program measured them: a table of joints and points."""
    rows = list(csv.DictReader((campaign / "plan.csv").read_text().splitlines()))
    columns = [axis.column for axis in robot.mechanism.joints]
    joints = np.radians([[float(row[column]) for column in columns] for row in rows])
    points = robot.kinematics.forward(joints).values_or_raise()[:, :3] - TRACKER_MM
    points += np.random.default_rng(3).normal(0.0, 0.01, points.shape)
    path = campaign.parent / "measured.csv"
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["set", "pair", *columns, "x_mm", "y_mm", "z_mm"])
        for row, point in zip(rows, points.tolist(), strict=True):
            writer.writerow([row["set"], row["pair"], *(row[c] for c in columns), *point])
    return path


def test_a_mechanism_of_ones_own_goes_all_the_way_to_its_parameters(pkmcal, file, tmp_path):
    campaign = tmp_path / "campaign"
    assert pkmcal("new", campaign, "--robot", f"{file}:OWN", "--offline").code == 0
    file.unlink()  # the folder has its own copy
    planned = pkmcal("plan", campaign, "--shots", 24)
    assert planned.code == 0, planned.err
    nominal = find_robot(str(campaign / "robot.yaml")).robot
    longer = nominal.parameters | {"arm1.forearm_mm": nominal.parameters["arm1.forearm_mm"] + 0.8}
    truth = type(nominal).of(nominal.mechanism, longer, name="truth", limits=nominal.limits)
    assert pkmcal("import", campaign, measured(campaign, truth)).code == 0
    ended = pkmcal("identify", campaign, "--json")
    forearm = ended.document["parameters"]["arm1.forearm_mm"]
    assert ended.document["verdict"] == "pass"
    assert forearm["delta"] == pytest.approx(0.8, abs=4.0 * forearm["std"])
    assert pkmcal("export", campaign, "--to", campaign / "found.yaml").code == 0
    assert find_robot(str(campaign / "found.yaml")).robot.mechanism.name == "quarter-h4"


@pytest.mark.parametrize(
    ("word", "reason"),
    [
        ("my.py:MINE", "has no attribute 'MINE'"),
        ("my.py:OTHER", "is 'par4', must be a Mechanism"),
        ("none.py:OWN", "there is no such file"),
    ],
)
def test_a_file_that_gives_no_mechanism_is_refused(pkmcal, file, tmp_path, word, reason):
    ended = pkmcal("new", tmp_path / "campaign", "--robot", file.parent / word, "--offline")
    assert ended.code == 2
    assert reason in ended.error_line


@pytest.mark.slow
def test_a_dry_run_says_what_it_does_not_test(pkmcal, file, tmp_path):
    """The simulated cell has no parts of such a robot: it moves by the robot's own equations."""
    folder = tmp_path / "campaign"
    assert pkmcal("new", folder, "--robot", f"{file}:OWN").code == 0
    change(folder / "campaign.yaml", SMALL_TESTS | {"plan.shots": 24, "plan.validation_pairs": 4})
    change(folder / "cell.yaml", {"speed_up": 3000})
    ended = pkmcal("dry-run", folder, "--json")
    assert ended.code == 0, ended.err
    assert ended.document["after"]["distances_mm"]["max_abs"] < 0.15
    assert OWN_EQUATIONS in ended.err
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert OWN_EQUATIONS in html.unescape(page)
    refused = pkmcal("sim", folder / "cell.yaml")
    assert refused.code == 2
    assert "nothing here simulates a quarter-h4" in refused.error_line
