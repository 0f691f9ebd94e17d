"""Identification of robots made of rods and gears: corrected, stated truly, and judged."""

from dataclasses import replace

import numpy as np
import pytest
from rod_campaigns import SMALL, Errors, rod_campaign, with_joints, with_points

from campaigns.api import sample_workspace
from campaigns.errors import OptionsInvalid, ShotsInvalid, ShotsMissing
from campaigns.identification import findings
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.settings.sections import KnownLengthConfig
from campaigns.shots.shot_sets import ShotSet

MECHANISMS = ("par4-prototype", "h4", "i4r", "i4l", "delta", "linear-delta")


def identified(campaign, **options):
    sample = sample_workspace(campaign.robot, 60)
    how = IdentificationOptions(workspace=sample, **options)
    return identify(campaign.robot.kinematics, campaign.shots, how)


def names_of(found):
    return [own.name for own in found.findings if own.affects_verdict]


@pytest.fixture(scope="module")
def clean():
    campaign = rod_campaign("par4-prototype", shots=80, seed=3)
    return campaign, identified(campaign)


@pytest.mark.parametrize("name", MECHANISMS)
def test_what_is_wrong_with_a_robot_is_corrected_and_stated_truly(name):
    campaign = rod_campaign(name, SMALL, shots=80, seed=2)
    found = identified(campaign)
    assert found.verdict == "pass", found.reasons
    real_mm = campaign.position_error_mm(found)
    assert real_mm < 2.0 * found.position_std_mm.rms
    assert real_mm < 0.05
    assert found.residuals_mm.before.rms > 20.0 * found.residuals_mm.after.rms


@pytest.mark.parametrize(
    "errors",
    [
        Errors(eccentricity_deg=0.03, rods_mm=0.2),
        Errors(ratio_ppm=1000.0, tilts_mrad=2.0),
        Errors(azimuths_mrad=2.0, backlash=1.0),
        Errors(sag_mm=0.2),
    ],
    ids=["eccentricity and rods", "ratio and tilts", "azimuths and backlash", "sag"],
)
def test_large_errors_are_corrected_without_a_choice_of_models(errors):
    campaign = rod_campaign("par4-prototype", errors, shots=80, seed=5)
    found = identified(campaign)
    real_mm = campaign.position_error_mm(found)
    assert found.converged
    assert real_mm < 2.0 * found.position_std_mm.rms
    assert real_mm < 0.06
    assert not [own for own in found.excluded if own.size_mm is not None]


def test_clean_robot_passes_and_its_noise_is_told_from_the_trackers(clean):
    campaign, found = clean
    assert found.verdict == "pass"
    assert campaign.position_error_mm(found) < 0.03
    assert found.scatter.point_mm < 0.01
    assert found.scatter.instrument == {}
    parts = np.array([share.mm for share in found.budget])
    assert np.sqrt((parts**2).sum()) == pytest.approx(found.position_std_mm.rms, rel=1e-6)
    assert {share.kind for share in found.budget if share.source == "stated"} == {"B"}
    assert {share.kind for share in found.budget if share.source == "points"} == {"A"}


def test_result_is_written_read_and_reported(clean):
    _, found = clean
    recorded = RecordedIdentification.of(
        found, series=1, robot_digest="r", plan_digest="p", journal_digest="j", journal_records=9,
        at_utc="2026-01-01T00:00:00+00:00",
    )  # fmt: skip
    again = read_identification(recorded.document())
    assert again.flat() == found.flat()
    assert again.posterior.names == found.posterior.names
    text = found.report()
    assert "verdict: pass" in text
    assert "combined" in text
    frame = found.frame.tracker_from_base
    assert np.abs(frame.rotation @ frame.rotation.T - np.eye(3)).max() < 1e-9


def test_what_no_shot_determines_stays_at_nominal_whatever_the_base_frame(clean):
    """Inner constraints: the mean motion of the base frame is no parameter's error."""
    campaign, found = clean
    named = {name for combination in found.undetermined for name in combination}
    assert {"arm0.x_mm", "arm0.y_mm", "arm0.z_mm"} <= named
    heights = [found.parameters[f"arm{arm}.z_mm"] for arm in range(4)]
    moved_mm = np.mean([height.delta for height in heights])
    assert abs(moved_mm) < 3.0 * max(height.std for height in heights) + 0.5
    assert campaign.position_error_mm(found) < 2.0 * found.position_std_mm.rms


def test_noise_that_a_file_does_not_state_is_estimated():
    campaign = rod_campaign("delta", shots=80, seed=4, noise_mm=0.03, stated=False)
    found = identified(campaign)
    assert found.verdict == "pass"
    assert set(found.scatter.instrument) == {"along", "across"}
    assert "noise estimated" in found.scatter.says
    assert campaign.position_error_mm(found) < 2.0 * found.position_std_mm.rms


def test_a_gross_shot_is_left_out_by_name_and_good_ones_never(clean):
    campaign, _ = clean
    points = campaign.shots.points_in_tracker_mm.copy()
    points[17] += [0.4, -0.3, 0.2]
    points[40] += 900.0  # another target
    found = identified(with_points(campaign, points))
    assert {own.shot for own in found.excluded if own.size_mm is not None} == {17, 40}
    assert found.verdict == "pass"
    assert campaign.position_error_mm(found) < 2.0 * found.position_std_mm.rms


@pytest.mark.parametrize(("since", "until"), [(40, 100), (30, 50)], ids=["lasting", "taken back"])
def test_a_bumped_tracker_fails_with_the_shots_between_which_it_was(clean, since, until):
    campaign, _ = clean
    points = campaign.shots.points_in_tracker_mm.copy()
    points[since:until] += [0.15, -0.1, 0.12]
    found = identified(with_points(campaign, points))
    assert found.verdict == "fail"
    change = next(own for own in found.findings if own.name == findings.CHANGE)
    assert change.numbers["part"] == "frame"
    assert change.numbers["before_shot"] == pytest.approx(since, abs=2)
    assert ("last_shot" in change.numbers) == (until < 80)


def test_of_two_steps_neither_leaves_a_change_without_a_size(clean):
    campaign, _ = clean
    points = campaign.shots.points_in_tracker_mm.copy()
    points[20:] += [0.35, -0.3, 0.3]
    points[50:] -= [0.2, 0.2, 0.2]
    found = identified(with_points(campaign, points))
    changes = [own.numbers for own in found.findings if own.name == findings.CHANGE]
    assert [change["part"] for change in changes] == ["frame", "frame"]
    ends = {change["last_shot"] + 1 for change in changes if "last_shot" in change}
    assert {change["before_shot"] for change in changes} | ends == {20, 50}
    assert all(abs(change["size"]) > change["U"] for change in changes)


def test_a_step_of_an_encoder_fails_with_its_arm(clean):
    campaign, _ = clean
    joints = campaign.shots.joints.copy()
    joints[45:, 2] += np.radians(0.03)
    found = identified(with_joints(campaign, joints))
    change = next(own for own in found.findings if own.name == findings.CHANGE)
    assert found.verdict == "fail"
    assert "arm 2" in change.says
    assert change.numbers["before_shot"] == pytest.approx(45, abs=2)


def test_joints_of_another_instant_are_a_scatter_that_no_robot_has(clean):
    campaign, _ = clean
    lagging = campaign.shots.joints + 0.02 * np.roll(campaign.shots.joints, 1, axis=0)
    found = identified(with_joints(campaign, lagging))
    assert found.verdict == "fail"
    assert findings.SCATTER in names_of(found)


def test_a_wrong_nominal_length_is_a_finding_until_it_is_accepted(clean):
    campaign, _ = clean
    wrong = dict(campaign.robot.parameters)
    wrong["arm1.forearm_mm"] += 20.0
    nominal = campaign.robot.kinematics.of(campaign.robot.mechanism, wrong)
    sample = sample_workspace(campaign.robot, 60)
    for accepts in (False, True):
        how = IdentificationOptions(workspace=sample, accept_large_change=accepts)
        found = identify(nominal, campaign.shots, how)
        assert (findings.BEYOND_TOLERANCE in names_of(found)) != accepts
        assert bool(found.accepted) == accepts


def test_without_pairs_to_judge_by_nothing_is_decided(clean):
    campaign, _ = clean
    alone = replace(campaign, shots=campaign.shots.of_set(ShotSet.IDENTIFICATION))
    found = identified(alone)
    assert found.verdict == "not decided"
    assert names_of(found) == [findings.NOTHING_UNSEEN]
    assert "--hold-out 20%" in found.reasons[0]


def test_options_hold_parameters_and_change_tolerances(clean):
    campaign, _ = clean
    found = identified(campaign, fix=("arm1.*", "eccentricity"), prior=("arm2.arm_mm=0.001",))
    assert not [name for name in found.free if name.startswith("arm1.")]
    assert not [name for name in found.free if "eccentricity" in name]
    assert abs(found.parameters["arm2.arm_mm"].delta) < 0.01
    for wrong, said in (
        ({"fix": ("arm9.*",)}, "no parameter, pattern or group"),
        ({"prior": ("arm1.arm_mm=0",)}, "σ must be a number from"),
        ({"model": "standard"}, "take full or paper"),
    ):
        with pytest.raises(OptionsInvalid, match=said):
            identified(campaign, **wrong)


def test_a_known_length_measures_the_scale_unless_that_is_held(clean):
    shots, bar = clean[0].shots, KnownLengthConfig(name="bar", length_mm=500.0, std_mm=0.01)
    first, second = shots.whole_pairs(ShotSet.VALIDATION).rows[0].tolist()
    purposes, points = list(shots.purposes), shots.points_in_tracker_mm.copy()
    purposes[first] = purposes[second] = ShotSet.KNOWN_LENGTH
    points[second] = points[first] + [0.0, 0.0, 500.0 * (1.0 + 1e-4)]
    shots = replace(shots, purposes=tuple(purposes), points_in_tracker_mm=points)
    campaign = replace(clean[0], shots=shots)
    scale_ppm, std_ppm = identified(campaign, known_lengths=(bar,)).tracker["scale"]
    assert std_ppm < 45.0
    assert scale_ppm == pytest.approx(100.0, abs=3.0 * std_ppm)
    held = identified(campaign, known_lengths=(bar,), fix=("scale",))
    assert "scale" not in held.tracker
    assert held.verdict == "pass", held.reasons


def test_too_few_shots_and_nonsense_are_refused_with_a_remedy(clean):
    campaign, _ = clean
    few = replace(campaign, shots=campaign.shots.rows(np.arange(3)))
    with pytest.raises(ShotsMissing, match="3 shots to identify from"):
        identified(few)
    line = 1000.0 + np.outer(np.arange(len(campaign.shots)), [1.0, 2.0, 3.0])
    with pytest.raises(ShotsInvalid, match="lead to no robot"):
        identified(with_points(campaign, line))


def test_the_papers_model_fits_its_parameters_by_distances(clean):
    campaign, full = clean
    found = identified(campaign, model="paper")
    assert found.model == "paper"
    assert len(found.free) == 22
    assert found.residuals_mm.after.rms < 0.1 * found.residuals_mm.before.rms
    assert found.posterior is None
    assert full.posterior is not None
