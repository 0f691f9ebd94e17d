"""Campaigns of every mechanism of the family on shots of others, taken in and identified."""

import shutil

import numpy as np
import pytest
from family_cases import MEMBERS, Member, flat_in

from app.main import run_command
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import find_robot
from sim.scenarios.scenario import shipped_text

CLOSE_TO_TRUTH = {"mm": 1e-4, "deg": 1e-5}
"""The files' points have six decimals, their joints nine."""
OFTEN = ("linear-delta",)
UNSEEN_PAIRS = 10
PAPER = ("--model", "paper")
DELTA = Member("delta")
SPACE = DELTA.space
pytestmark = pytest.mark.slow


@pytest.fixture(
    scope="module",
    params=[pytest.param(m, marks=[] if m.name in OFTEN else pytest.mark.long) for m in MEMBERS],
    ids=lambda each: each.name,
)
def member(request):
    return request.param


def taken_in(folder, member, kind, unseen=0):
    """A campaign with shots of the reference model, the last pairs as unseen ones."""
    assert run_command(["new", str(folder), "--robot", member.name]) == 0
    file = folder / "measured.csv"
    text = marked(member.shots_file(kind).read_text(encoding="utf-8"), unseen)
    file.write_text(text, encoding="utf-8")
    assert run_command(["import", str(folder), str(file)]) == 0
    return folder


def marked(text, unseen):
    """The same shots, the last pairs marked as of the set "validation"."""
    head, *rows = text.split()
    last = int(rows[-1].split(",")[0])
    sets = [("identification", "validation")[int(r.split(",")[0]) > last - unseen] for r in rows]
    return "\n".join([f"{head},set", *map(",".join, zip(rows, sets, strict=True))]) + "\n"


@pytest.fixture(scope="module")
def exact(member, tmp_path_factory):
    """A campaign on points without noise."""
    return taken_in(tmp_path_factory.mktemp("exact") / member.name, member, "exact")


@pytest.fixture(scope="module")
def noisy(member, tmp_path_factory):
    """A campaign on points as a tracker measures them."""
    return taken_in(tmp_path_factory.mktemp("noisy") / member.name, member, "noise")


def assert_same(found, expected, close):
    assert found.keys() >= expected.keys()
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, rel=0, abs=close[name.rpartition("_")[2]]), name


def values(document):
    return {name: found["value"] for name, found in document["parameters"].items()}


def robot_of(member, document):
    """Identified robot of a document."""
    return Kinematics.of(member.mechanism, values(document))


def test_exact_shots_give_the_truth_and_nothing_unproven_is_exported(pkmcal, member, exact):
    truth = flat_in(member.answers("exact")["truth"])
    ended = pkmcal("identify", exact, *PAPER, "--json")
    assert (ended.code, ended.document["verdict"]) == (1, "not decided")
    assert_same(values(ended.document), truth, CLOSE_TO_TRUTH)
    ended = pkmcal("identify", exact, "--json")
    assert (ended.code, ended.document["verdict"]) == (1, "not decided")
    robot = robot_of(member, ended.document)
    assert member.apart_mm(robot, Kinematics.of(member.mechanism, truth)).max() < 0.02
    ended = pkmcal("export", exact)
    assert ended.code == 1
    assert "no validation pairs" in ended.error_line
    assert not (exact / "robot-compensated.yaml").exists()


def test_noisy_points_give_the_truth_and_name_what_stays_undetermined(pkmcal, member, noisy):
    answer = member.answers("noise")
    found = pkmcal("identify", noisy, *PAPER, "--json").document
    free = [parameter for parameter, entry in found["parameters"].items() if entry["free"]]
    assert free == answer["free"]
    found = pkmcal("identify", noisy, "--json").document
    of_coordinates = found["residuals_mm"]["after"]["rms"] / 3**0.5
    assert of_coordinates == pytest.approx(answer["rms_mm"], rel=0.2)
    truth = Kinematics.of(member.mechanism, flat_in(answer["truth"]))
    apart = member.apart_mm(robot_of(member, found), truth)
    assert np.sqrt(np.mean(apart**2)) < 3.0 * found["position_std_mm"]["rms"]
    assert len(found["undetermined"]) >= 6, "the base frame may lie anywhere"
    named = {name for combination in found["undetermined"] for name in combination}
    assert {"arm0.x_mm", "arm0.y_mm", "arm0.z_mm"} & named
    assert abs(found["parameters"]["arm0.x_mm"]["delta"]) < 5.0, "kept at nominal"


@pytest.fixture(scope="module")
def passed_once(tmp_path_factory):
    folder = taken_in(tmp_path_factory.mktemp("passed") / "delta", DELTA, "exact", UNSEEN_PAIRS)
    assert run_command(["identify", str(folder)]) == 0
    return folder


@pytest.fixture
def passed(passed_once, tmp_path):
    """A Delta's campaign on exact shots whose identification hold-out pairs prove."""
    return shutil.copytree(passed_once, tmp_path / "delta")


def test_a_deltas_campaign_refuses_a_cell_of_a_par4(pkmcal, tmp_path):
    new = tmp_path / "delta"
    assert pkmcal("new", new, "--robot", "delta").code == 0
    assert pkmcal("plan", new, "--shots", 20).code == 0
    (new / "cell.yaml").write_text(shipped_text("realistic"), encoding="utf-8")
    ended = pkmcal("run", new, "--yes")
    assert ended.code == 2
    assert "cell realistic is a par4, but this campaign's robot is a delta" in ended.error_line
    assert "pkmcal new DIR --robot FILE" in ended.error_line


def test_a_deltas_exported_robot_is_the_true_one_and_the_nominal_of_a_next_campaign(
    pkmcal, passed, tmp_path
):
    assert pkmcal("export", passed).code == 0
    assert pkmcal("export", passed, "--format", "shots").code == 0
    robot = find_robot(str(passed / "robot-compensated.yaml")).robot
    assert robot.mechanism.name == DELTA.name
    assert robot.limits == DELTA.limits
    assert robot.workspace_centre_mm == (0.0, 0.0, -700.0)
    assert set(SPACE.names) <= set(robot.parameters)
    truth = Kinematics.of(DELTA.mechanism, flat_in(DELTA.answers("exact")["truth"]))
    assert DELTA.apart_mm(robot.kinematics, truth).max() < 0.02
    following = tmp_path / "next"
    assert pkmcal("new", following, "--robot", passed / "robot-compensated.yaml").code == 0
    assert pkmcal("import", following, passed / "shots.csv").code == 0
    found = pkmcal("identify", following, "--json").document
    assert found["residuals_mm"]["before"]["max_abs"] < 0.02
    assert DELTA.apart_mm(robot_of(DELTA, found), truth).max() < 0.02
