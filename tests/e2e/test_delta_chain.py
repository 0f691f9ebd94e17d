"""A campaign on another mechanism than Par4, by the commands: plan, shots of others, result."""

import csv
import re
import shutil

import numpy as np
import pytest
from command_line import change
from family_cases import Member, flat_in

from app.main import run_command
from campaigns.robots.robot import find_robot
from sim.scenarios.scenario import shipped_text

DELTA = Member("delta")
SPACE = DELTA.space
CLOSE_TO_TRUTH = {"mm": 1e-6, "deg": 1e-7}
"""The files' points have six decimals, their joints nine."""
CLOSE_TO_LEAST_SQUARES = {"mm": 1e-9, "deg": 1e-10}
SMALL = {"plan.shots": 40, "plan.validation_pairs": 4}
UNSEEN_PAIRS = 10
AZIMUTHS_OF_TWO = "arm[12].azimuth_deg"


@pytest.fixture(scope="module")
def new_once(tmp_path_factory):
    folder = tmp_path_factory.mktemp("delta") / "delta"
    assert run_command(["new", str(folder), "--robot", "delta"]) == 0
    change(folder / "campaign.yaml", SMALL)
    return folder


@pytest.fixture
def new(new_once, tmp_path):
    """A campaign on a Delta, without a plan or shots."""
    return shutil.copytree(new_once, tmp_path / "delta")


@pytest.fixture
def taken_in(new):
    """Takes shots of the reference model into the campaign, the last pairs as unseen ones."""

    def taken(name, unseen=0):
        take_in(new, name, unseen)
        return new

    return taken


@pytest.fixture(scope="module")
def passed_once(new_once, tmp_path_factory):
    folder = shutil.copytree(new_once, tmp_path_factory.mktemp("passed") / "delta")
    take_in(folder, "exact", UNSEEN_PAIRS)
    assert run_command(["identify", str(folder)]) == 0
    return folder


@pytest.fixture
def passed(passed_once, tmp_path):
    """A campaign on exact shots whose identification unseen pairs prove."""
    return shutil.copytree(passed_once, tmp_path / "delta")


def take_in(folder, name, unseen):
    file = folder / "measured.csv"
    text = marked(DELTA.shots_file(name).read_text(encoding="utf-8"), unseen)
    file.write_text(text, encoding="utf-8")
    assert run_command(["import", str(folder), str(file)]) == 0


def marked(text, unseen):
    """The same shots, the last pairs marked as of the set "validation"."""
    head, *rows = text.split()
    last = int(rows[-1].split(",")[0])
    sets = [("identification", "validation")[int(r.split(",")[0]) > last - unseen] for r in rows]
    return "\n".join([f"{head},set", *map(",".join, zip(rows, sets, strict=True))]) + "\n"


def values(document):
    return {name: found["value"] for name, found in document["parameters"].items()}


def assert_same(found, expected, close):
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=0, abs=close[name.rpartition("_")[2]]), name


def test_its_plan_has_three_joints_and_no_turn(pkmcal, new):
    planned = pkmcal("plan", new, "--json").document
    assert list(planned["predicted_std"]) == list(SPACE.free_by_default)
    with (new / "plan.csv").open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    assert head == ["shot", "set", "pair", "x_mm", "y_mm", "z_mm", "q0_deg", "q1_deg", "q2_deg"]
    poses, joints_deg = np.split(np.array([row[3:] for row in rows], dtype=float), 2, axis=1)
    judged = DELTA.nominal.feasibility(DELTA.limits, poses)
    assert len(rows) == 40 + 2 * 4 + 3
    assert judged.feasible.all()
    assert np.abs(np.degrees(judged.joints) - joints_deg).max() < 1e-9


@pytest.mark.parametrize("name", ["exact", "noise"])
def test_its_parameters_are_the_reference_s_least_squares(pkmcal, taken_in, name):
    answer = DELTA.answers(name)
    found = pkmcal("identify", taken_in(name), "--json").document
    free = [parameter for parameter, entry in found["parameters"].items() if entry["free"]]
    assert free == answer["free"]
    assert_same(values(found), flat_in(answer["least_squares_points"]), CLOSE_TO_LEAST_SQUARES)
    assert (found["rank"], found["dof"]) == (15, 3 * 80 - 15 - 6)
    of_coordinates = found["residuals_mm"]["after"]["rms"] / 3**0.5
    assert of_coordinates == pytest.approx(answer["rms_mm"], rel=1e-6)


def test_the_truth_lies_within_the_stated_uncertainty(pkmcal, taken_in):
    found = pkmcal("identify", taken_in("noise"), "--json").document
    truth = flat_in(DELTA.answers("noise")["truth"])
    off = [
        (entry["value"] - truth[name]) / entry["std"]
        for name, entry in found["parameters"].items()
        if entry["free"]
    ]
    assert found["chi2"]["believable"]
    assert np.abs(off).max() < 3.0
    assert 0.3 < np.sqrt(np.mean(np.square(off))) < 1.5


def test_two_of_its_azimuths_can_be_told_too_and_the_third_is_the_frame_s(pkmcal, taken_in):
    folder = taken_in("exact", UNSEEN_PAIRS)
    two = pkmcal("identify", folder, "--free", AZIMUTHS_OF_TWO, "--json").document
    assert (two["rank"], two["verdict"]) == (17, "pass")
    three = pkmcal("identify", folder, "--free", "arm*.azimuth_deg", "--json").document
    assert (three["rank"], three["verdict"]) == (17, "fail")
    (together,) = three["unobservable"]
    assert {f"arm{arm}.azimuth_deg" for arm in range(3)} <= set(together)


def test_without_unseen_pairs_nothing_is_exported(pkmcal, taken_in):
    folder = taken_in("exact")
    found = pkmcal("identify", folder, "--json")
    assert (found.code, found.document["verdict"]) == (1, "not decided")
    ended = pkmcal("export", folder)
    assert ended.code == 1
    assert "no validation pairs" in ended.error_line
    assert not (folder / "robot-compensated.yaml").exists()


def test_its_exported_robot_file_holds_the_true_robot(pkmcal, passed):
    ended = pkmcal("export", passed)
    assert ended.code == 0, ended.err
    robot = find_robot(str(passed / "robot-compensated.yaml")).robot
    assert robot.mechanism.name == DELTA.name
    assert robot.limits == DELTA.limits
    assert robot.workspace_centre_mm == (0.0, 0.0, -700.0)
    assert list(robot.parameters.std) == list(SPACE.free_by_default)
    assert_same(dict(robot.parameters), flat_in(DELTA.answers("exact")["truth"]), CLOSE_TO_TRUTH)


def test_its_exported_robot_is_the_nominal_of_a_next_campaign(pkmcal, passed, tmp_path):
    assert pkmcal("export", passed).code == 0
    assert pkmcal("export", passed, "--shots").code == 0
    following = tmp_path / "next"
    assert pkmcal("new", following, "--robot", passed / "robot-compensated.yaml").code == 0
    assert pkmcal("import", following, passed / "shots.csv").code == 0
    found = pkmcal("identify", following, "--json").document
    assert_same(
        {name: entry["delta"] for name, entry in found["parameters"].items()},
        dict.fromkeys(SPACE.names, 0.0),
        CLOSE_TO_TRUTH,
    )


def test_its_report_speaks_of_its_own_parameters_and_of_no_turn(pkmcal, passed):
    reported = pkmcal("report", passed, "--json")
    assert reported.code == 0, reported.err
    assert "against-position" in reported.document["figures"]
    page = (passed / "report.html").read_text(encoding="utf-8")
    page = re.sub(r"<style.*?</style>", "", page, flags=re.DOTALL)
    for name in SPACE.free_by_default:
        assert name in page
    for of_another in ("θ", "theta", "Par4", "par4", "arm3", "plate_mm"):
        assert of_another not in page, of_another


def test_shots_of_four_joints_are_refused(pkmcal, new):
    file = new / "four.csv"
    file.write_text("pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm\n0,1,2,3,4,5,6,7\n")
    ended = pkmcal("import", new, file)
    assert ended.code == 2
    assert "q3_deg" in ended.error_line


def test_a_simulated_cell_of_another_mechanism_is_refused(pkmcal, new):
    assert pkmcal("plan", new).code == 0
    (new / "cell.yaml").write_text(shipped_text("realistic"), encoding="utf-8")
    ended = pkmcal("run", new, "--yes")
    assert ended.code == 2
    assert "cell realistic is a par4, but this campaign's robot is a delta" in ended.error_line
    assert "pkmcal new DIR --robot FILE" in ended.error_line


def test_a_controller_file_of_another_mechanism_is_refused(pkmcal, passed):
    ended = pkmcal("export", passed, "--format", "linuxcnc-lineardelta")
    assert ended.code == 2
    assert "delta" in ended.error_line
    assert not (passed / "calib.hal").exists()
