"""pkmcal identify on imported shots: options, what is left out by name, words and pictures."""

import json
from dataclasses import replace

import numpy as np
import pytest
from par4_space import SPACE, par4

from app.main import run_command
from app.new_campaign import create_simulated
from campaigns.campaign import open_campaign
from campaigns.design.pose_sampling import interior_poses
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, Model, Outliers
from campaigns.estimation.rigid_transforms import from_paper_angles
from campaigns.identification.options import AS_THE_PAPER, IdentificationOptions
from campaigns.planning.plans import region_of
from campaigns.robots.robot import pose_of
from campaigns.settings.option import typed_words
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow, write_shots
from campaigns.workflow.identification import identification_options, identify, model_to_find
from campaigns.workflow.importing import import_shots

STD_MM = np.array([0.004, 0.012, 0.012])
WRONG = (7, 50, 99)
STANDARD = ("--model", "standard")
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
    region = region_of(nominal, robot.limits, from_everywhere, pose_of(campaign.centre))
    joints = nominal.inverse(interior_poses(region, 160, rng)).values_or_raise()
    flat = nominal.parameters
    truth = par4(flat | {name: flat[name] + e for name, e in ERRORS.items()})
    frame = from_paper_angles(np.array([2.1, 0.02, -0.03]), np.array([2500.0, 400.0, 300.0]))
    points = frame.apply(truth.forward(joints).values_or_raise()[:, :3])
    points += STD_MM * rng.standard_normal(points.shape)
    away = rng.standard_normal((3, 3))
    points[list(WRONG)] += moved_mm * away / np.linalg.norm(away, axis=1)[:, None]
    covariance = tuple(map(tuple, np.diag(STD_MM**2).tolist()))
    sets = [ShotSet.IDENTIFICATION] * 120 + [ShotSet.VALIDATION] * 40
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
@pytest.mark.parametrize(
    ("estimator", "key", "named"),
    [("points", "shot", list(WRONG)), ("distances", "pair", [3, 25, 49])],
)
def test_moved_shots_are_named_and_cost_nothing(pkmcal, clean, spoilt, estimator, key, named):
    words = ("--estimator", estimator, *STANDARD, "--json")
    good = json.loads(pkmcal("identify", clean.folder, *words)[1])
    code, out, err = pkmcal("identify", spoilt.folder, *words)
    found = json.loads(out)
    assert code == 0
    assert [left[key] for left in found["excluded"]] == named
    assert unseen(found) <= 1.3 * unseen(good)
    assert f"left out: shot {WRONG[0]}" in err
    assert f"{key} {named[0]}: " in err
    assert " σ, limit " in err


def test_points_are_the_default_and_covariances_count(pkmcal, clean):
    code, out, _ = pkmcal("identify", clean.folder, "--json")
    found = json.loads(out)
    assert (code, found["estimator"], found["outliers"]) == (0, "points", "exclude")
    assert found["chi2"]["believable"]
    assert found["position_std_mm"]["mean"] < 0.01
    assert found["frame"]["x_mm"] == pytest.approx(2500.0, abs=0.5)
    for name, entry in found["parameters"].items():
        error = entry["delta"] - ERRORS.get(name, 0.0)
        assert abs(error) <= 4.5 * (entry["std"] or 1e-9), name


def test_what_takes_long_is_told_on_a_terminal(pkmcal, clean, monkeypatch):
    monkeypatch.setattr("rich.console.Console.is_terminal", True)
    monkeypatch.setattr("app.console.SILENT_S", 0.0)
    code, _, err = pkmcal("identify", clean.folder, *STANDARD)
    assert (code, "identifying" in err) == (0, True)


def test_a_set_with_axis_tilts_is_written_but_said_to_be_for_no_controller(pkmcal, clean):
    for words in ((), ("--free", "arm*.axis_tilt_deg")):
        tilted, folder = bool(words), clean.folder
        code, found, _ = pkmcal("identify", folder, *STANDARD, *words)
        assert code == 0
        _, _, written = pkmcal("export", folder, "--overwrite")
        for text in (found, written):
            assert ("takes axis tilts" in text) is tilted
        assert "next: put the exported file into the controller" in written


def test_people_are_told_the_noise_and_the_verdict(pkmcal, clean):
    code, out, _ = pkmcal("identify", clean.folder)
    assert code == 0
    lines = out.splitlines()
    for words in (
        "Residuals of the fitted coordinates",
        "the shots scatter as the tracker states (χ² ",
        "predicted error of position (1 σ): 0.00",
        "verdict: pass",
    ):
        assert any(line.startswith(words) for line in lines), words
    assert max(map(len, lines)) < 200


def test_what_cannot_be_told_is_said_in_plain_words_and_a_prior_settles_it(pkmcal, clean):
    freed = (clean.folder, *STANDARD, "--free", "arm0.x_mm")
    code, out, _ = pkmcal("identify", *freed)
    assert code == 1
    assert "move together here: fixed at nominal along that combination" in out
    code, out, _ = pkmcal("identify", *freed, "--prior", "arm0.x_mm=0.1")
    assert code == 0
    assert "known by the priors alone: arm0.x_mm, arm1.x_mm, arm2.x_mm, arm3.x_mm" in out


@pytest.mark.slow
def test_a_picture_is_drawn_of_what_was_fitted(pkmcal, clean, tmp_path):
    path = tmp_path / "errors.svg"
    code, out, _ = pkmcal("identify", clean.folder, *STANDARD, "--plot", path)
    assert code == 0
    assert f"drawn: {path}" in out
    assert "fitted" in path.read_text(encoding="utf-8")


def test_a_covariance_in_the_journal_that_is_none_is_refused_by_its_shot(pkmcal, tmp_path):
    campaign = made(tmp_path / "campaign")
    rows = measured(campaign)
    broken = ((1e-4, 2e-4, 0.0), (2e-4, 1e-4, 0.0), (0.0, 0.0, 1e-4))
    rows[17] = replace(rows[17], covariance_mm2=broken)
    import_shots(campaign, rows)
    code, out, err = pkmcal("identify", campaign.folder, "--json")
    assert (code, out) == (2, "")
    assert "shot 17: its covariance is not positive definite → import the shots again" in err


def test_what_the_options_mean_is_checked_before_anything_is_read(tmp_path):
    campaign = made(tmp_path / "campaign")
    with pytest.raises(OptionsInvalid, match="matches no parameter"):
        identify(campaign, IdentificationOptions(free=("arm7.*",)))
    assert not campaign.journal_path.exists()


@pytest.mark.parametrize(
    ("planned", "found"),
    [
        ("", Model.STANDARD),
        ("standard", Model.STANDARD),
        ("rods", Model.RODS),
        ("full", Model.AUTO),
        ("of a later version", Model.AUTO),
    ],
)
def test_model_follows_what_the_shots_were_planned_for(planned, found):
    assert model_to_find(planned) is found


def test_import_without_a_plan_gets_the_smallest_model_that_explains_it(clean):
    found = identify(clean)
    assert (found.model, found.asked) == ("auto", ())
    assert [each.name for each in found.models if each.kept] == ["standard"]
    by_name = identify(clean, IdentificationOptions(model=Model.STANDARD, hold_out=0.25))
    assert (by_name.model, by_name.models) == ("standard", ())
    assert by_name.asked == ("--model", "standard", "--hold-out", "0.25")


def test_options_are_typed_as_they_were_given():
    options = IdentificationOptions(
        estimator=Estimator.DISTANCES, fix=("arm1.*", "arm2.*"), shots=(None, 60), sessions=True
    )
    words = "--estimator distances --fix arm1.* --fix arm2.* --shots -60 --sessions"
    assert sorted(typed_words(options)) == sorted(words.split())
    assert typed_words(IdentificationOptions()) == []


def test_the_papers_way_is_plain_least_squares_of_all_distances(clean):
    options = identification_options(clean, AS_THE_PAPER)
    assert options.estimator is Estimator.DISTANCES
    assert options.outliers is Outliers.KEEP
    assert options.equal_weights
    found = identify(clean, AS_THE_PAPER)
    assert found.free == SPACE.free_by_default
    assert found.priors == {}
    assert found.excluded == ()
    assert len(found.fitted.after) == 60, "the distance of each pair"
