"""pkmcal identify on imported shots: options, what is left out by name, words and pictures."""

import json
from dataclasses import replace

import numpy as np
import pytest
from par4_space import par4

from app.main import run_command
from app.new_campaign import create_simulated
from campaigns.campaign import open_campaign
from campaigns.design.pose_sampling import interior_poses
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.identification.options import IdentificationOptions
from campaigns.planning.plans import region_of
from campaigns.robots.robot import pose_of
from campaigns.settings.option import typed_words
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow, write_shots
from campaigns.workflow.importing import import_shots

STD_MM = np.array([0.004, 0.012, 0.012])
WRONG = (7, 50, 83)
ERRORS = {"arm0.arm_mm": 1.0, "arm1.x_mm": -0.8, "arm2.joint_offset_deg": 0.4, "plate_mm": 0.5}


def made(folder):
    create_simulated(folder, "par4-prototype", "paper-simulation")
    return open_campaign(folder)


def measured(campaign, moved_mm=0.0, seed=1):
    """60 pairs to identify from and 20 unseen ones, three of the former's shots moved."""
    rng = np.random.default_rng(seed)
    robot = campaign.nominal.robot
    nominal = robot.kinematics
    from_everywhere = replace(campaign.view, acceptance_rad=float(np.pi))
    region = region_of(robot, from_everywhere, pose_of(campaign.centre))
    region = replace(region, limits=robot.limits)
    joints = nominal.inverse(interior_poses(region, 120, rng)).values_or_raise()
    flat = nominal.parameters
    truth = par4(flat | {name: flat[name] + e for name, e in ERRORS.items()})
    frame = from_paper_angles(np.array([2.1, 0.02, -0.03]), np.array([2500.0, 400.0, 300.0]))
    points = frame.apply(truth.forward(joints).values_or_raise()[:, :3])
    points += STD_MM * rng.standard_normal(points.shape)
    away = rng.standard_normal((3, 3))
    points[list(WRONG)] += moved_mm * away / np.linalg.norm(away, axis=1)[:, None]
    covariance = tuple(map(tuple, np.diag(STD_MM**2).tolist()))
    sets = [ShotSet.IDENTIFICATION] * 90 + [ShotSet.VALIDATION] * 30
    return [
        ShotRow(row // 2, tuple(joint), tuple(point), sets[row], covariance_mm2=covariance)
        for row, (joint, point) in enumerate(zip(joints.tolist(), points.tolist(), strict=True))
    ]


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    campaign = made(tmp_path_factory.mktemp("clean") / "campaign")
    import_shots(campaign, measured(campaign))
    return campaign


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory):
    """Imported from a file, as others would."""
    campaign = made(tmp_path_factory.mktemp("spoilt") / "campaign")
    file = campaign.folder.parent / "shots.csv"
    write_shots(file, measured(campaign, moved_mm=2.0), campaign.robot.mechanism)
    assert run_command(["import", str(campaign.folder), str(file)]) == 0
    return campaign


def unseen(document):
    return document["unseen_mm"]["after"]["rms"]


@pytest.mark.slow
def test_moved_shots_are_named_and_cost_nothing(pkmcal, clean, spoilt):
    good = json.loads(pkmcal("identify", clean.folder, "--json")[1])
    code, out, err = pkmcal("identify", spoilt.folder, "--json")
    found = json.loads(out)
    assert code == 0
    assert [left["shot"] for left in found["excluded"]] == list(WRONG)
    assert unseen(found) <= 1.3 * unseen(good)
    lines = [line for line in err.splitlines() if "left out" in line]
    assert len(lines) == len(WRONG), "the finding that only counts them is not shown"
    assert lines[0].startswith(f"left out: shot {WRONG[0]} of pair 3: 2.0")
    assert lines[0].endswith(" mm off where all others put it: measure again")


def test_the_document_states_parameters_within_their_uncertainty(pkmcal, clean):
    code, out, _ = pkmcal("identify", clean.folder, "--json")
    found = json.loads(out)
    assert (code, found["model"], found["verdict"]) == (0, "full", "pass")
    assert found["position_std_mm"]["mean"] < 0.02
    total = sum(share["mm"] ** 2 for share in found["budget"]) ** 0.5
    assert total == pytest.approx(found["position_std_mm"]["rms"])
    assert found["frame"]["x_mm"] == pytest.approx(2500.0, abs=0.5)
    for name in ("arm0.arm_mm", "arm2.joint_offset_deg", "plate_mm"):
        entry = found["parameters"][name]
        assert abs(entry["delta"] - ERRORS[name]) <= 4.5 * entry["std"], name


def test_people_read_parameters_errors_budget_noise_and_the_verdict(pkmcal, clean):
    code, out, _ = pkmcal("identify", clean.folder, "--verbose")
    assert code == 0
    for words in ("plate_mm ", "Uncertainty of positions, 1 σ", "robot repeatability"):
        assert f"\n{words}" in out, words
    assert out.startswith("verdict: pass\n")
    assert "not observable" in out
    assert " 0.0000 " not in out[out.index("Uncertainty of positions") :]
    assert "axis_tilt_deg  " not in out, "parts that show no change are counted, not listed"


def test_a_small_screen_shows_the_verdict_first_and_the_largest_shares(pkmcal, clean):
    code, out, _ = pkmcal("identify", clean.folder)
    lines = out.splitlines()
    assert (code, lines[0]) == (0, "verdict: pass")
    assert len(lines) <= 12
    heading = next(place for place, line in enumerate(lines) if line.startswith("positions: σ"))
    shares = [float(line.split()[0]) for line in lines[heading + 1 : heading + 6]]
    assert shares == sorted(shares, reverse=True)
    assert "plate_mm " not in out, "parameters stand in the report"


def test_an_accepted_large_change_is_said_to_be_accepted(pkmcal, clean):
    tight = ("--prior", "plate_mm=0.01", "--prior", "arm0.arm_mm=0.01")
    code, out, _ = pkmcal("identify", clean.folder, *tight)
    assert code == 1
    assert "is off by" in out
    code, out, _ = pkmcal("identify", clean.folder, *tight, "--force")
    assert code == 0
    assert "(accepted)" in out


def test_a_covariance_in_the_journal_that_is_none_is_refused_by_its_shot(pkmcal, tmp_path):
    campaign = made(tmp_path / "campaign")
    rows = measured(campaign)
    broken = ((1e-4, 2e-4, 0.0), (2e-4, 1e-4, 0.0), (0.0, 0.0, 1e-4))
    rows[17] = replace(rows[17], covariance_mm2=broken)
    import_shots(campaign, rows)
    code, out, err = pkmcal("identify", campaign.folder, "--json")
    assert (code, "error" in json.loads(out)) == (2, True)
    assert "shot 17: its covariance is not positive definite → import the shots again" in err


def test_options_are_typed_as_they_were_given():
    options = IdentificationOptions(
        model="paper", fix=("arm1.*", "arm2.*"), shots=(None, 60), sessions=True
    )
    words = "--model paper --fix arm1.* --fix arm2.* --only-shots -60 --sessions"
    assert sorted(typed_words(options)) == sorted(words.split())
    assert typed_words(IdentificationOptions()) == []
