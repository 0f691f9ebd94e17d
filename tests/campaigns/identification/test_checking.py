"""Check by a few shots from another stand, and update of the parameters by them."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from rod_campaigns import SMALL, TRACKER_FROM_BASE, rod_campaign

from campaigns.api import find_robot, sample_workspace
from campaigns.errors import IdentificationRefused
from campaigns.evaluation.decision import coverage_factor
from campaigns.fit.events import visible_changes
from campaigns.fit.fit import Prior
from campaigns.fit.rigid_transforms import Transform, from_paper_angles
from campaigns.identification.checking import (
    CheckResult,
    Misfit,
    check,
    fit_with_former,
    former_datum,
    misfit_of,
    with_former_stand,
)
from campaigns.identification.identify import identify, update
from campaigns.identification.options import IdentificationOptions
from campaigns.kinematics.rotations import matrices_of

ELSEWHERE = from_paper_angles(np.array([0.01, 0.02, 0.8]), np.array([300.0, 900.0, 20.0]))


@pytest.fixture(scope="module")
def former():
    campaign = rod_campaign("par4-prototype", SMALL, shots=60, seed=6)
    how = IdentificationOptions(workspace=sample_workspace(campaign.robot, 30))
    return campaign, identify(campaign.robot.kinematics, campaign.shots, how), how


def few(former, count=8, encoder_deg=0.0, seed=1):
    """Shots of the same robot from another stand of the tracker, an encoder moved since."""
    shots = former[0].shots.rows(np.linspace(0, 59, count).astype(int))
    noise_mm = 0.01 * np.random.default_rng(seed).standard_normal((count, 3))
    joints = shots.joints + np.radians([encoder_deg, 0.0, 0.0, 0.0])
    return replace(
        shots,
        joints=joints,
        points_in_tracker_mm=ELSEWHERE.apply(shots.points_in_tracker_mm) + noise_mm,
    )


def checked(former, shots):
    """What a check by these shots says."""
    campaign, found, how = former
    return check(campaign.robot.kinematics, shots, found.uncertainty.posterior, how)


def test_an_unchanged_robot_is_good_wherever_the_tracker_stands(former):
    judged = checked(former, few(former))
    assert judged.decision == "pass"
    assert judged.parts == ()


def test_a_moved_encoder_is_named_and_the_update_corrects_it(former):
    campaign, found, how = former
    shots = few(former, encoder_deg=0.05)
    judged = checked(former, shots)
    assert judged.decision == "fail"
    assert "encoder 0" in judged.parts
    nominal, posterior = campaign.robot.kinematics, found.uncertainty.posterior
    updated = update(nominal, shots, posterior, how, judged.parts)
    assert updated.judgement.verdict == "pass", updated.judgement.reasons
    assert updated.value.motions == found.value.motions
    assert sum("turn of the base" in words for words in found.value.motions) == 3
    campaign.truth.encoder_shift[0] = np.radians(0.05)
    before_mm, after_mm = map(campaign.position_error_mm, (found, updated))
    campaign.truth.encoder_shift[0] = 0.0
    assert after_mm < 0.3 * before_mm
    assert after_mm < 2.0 * updated.uncertainty.position_std_mm.rms


def test_too_few_shots_decide_nothing(former):
    judged = checked(former, few(former, count=4))
    assert judged.decision == "not decided"
    assert "4 shots are too few" in judged.says


@pytest.mark.parametrize(
    ("wrong", "parts", "p", "alone"),
    [
        ((3,), (), 0.2, True),
        ((3,), ("arm 1",), 0.2, False),
        ((3,), (), 1e-4, False),
        ((), (), 0.2, False),
        ((), ("arm 1",), 0.2, False),
        ((), (), 1e-4, False),
    ],
)
def test_wrong_shots_alone_are_those_beside_no_change_and_no_misfit(wrong, parts, p, alone):
    judged = CheckResult(
        decision="fail", says="", shots=8, chi2=20.0, dof=18, p=p, parts=parts, wrong=wrong,
        log_factors={},
    )  # fmt: skip
    assert judged.is_of_shots_alone == alone


def test_held_parameters_and_a_former_result_with_held_ones_can_be_checked(former):
    campaign, found, _ = former
    nominal = campaign.robot.kinematics
    fixed = IdentificationOptions(fix=("rods",))
    assert check(nominal, few(former), found.uncertainty.posterior, fixed).decision == "pass"
    held = identify(nominal, campaign.shots, fixed)
    assert checked((campaign, held, IdentificationOptions()), few(former)).decision == "pass"


def test_a_result_of_another_kind_of_robot_is_refused(former):
    _, found, how = former
    other = find_robot("linear-delta").kinematics
    poses = sample_workspace(find_robot("linear-delta"), 8)
    joints = other.inverse(poses).values_or_raise()
    shots = replace(few(former), joints=joints, approach=np.zeros_like(joints), commanded=poses)
    with pytest.raises(IdentificationRefused, match="other unknowns"):
        check(other, shots, found.uncertainty.posterior, how)


# The tracker's stand


def again(former, *, stand_mm=0.0, encoder_deg=0.0, part=0, seed=1):
    """Eight shots measured again, by a stand that moved, and turned by a third of it in mrad."""
    campaign, rng = former[0], np.random.default_rng(seed)
    shots = campaign.shots.rows(np.linspace(0, 59, 8).astype(int))
    campaign.truth.encoder_shift[part] = np.radians(encoder_deg)
    points = campaign.truth.positions(shots.joints, shots.commanded, shots.approach)
    campaign.truth.encoder_shift[part] = 0.0
    shift, turn = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 3)))
    moved = Transform(matrices_of(1e-3 * stand_mm / 3.0 * turn), stand_mm * shift)
    seen = TRACKER_FROM_BASE.apply(points)
    now = moved.apply(seen) + 0.01 * rng.standard_normal(seen.shape)
    motion_mm = float(np.linalg.norm(moved.apply(seen) - seen, axis=1).max())
    return replace(shots, points_in_tracker_mm=now), motion_mm


def without_frame(posterior):
    """The posterior as an older version stored it."""
    return replace(posterior, frame=None, frame_covariance=())


@pytest.mark.slow
def test_a_stand_that_was_left_shows_smaller_changes_than_a_new_one(former):
    campaign, found, how = former
    nominal, posterior = campaign.robot.kinematics, found.uncertainty.posterior
    flat = fit_with_former(nominal, again(former)[0], posterior, how)
    stayed, new = visible_changes(with_former_stand(flat, posterior)), visible_changes(flat)
    encoder = ("encoder", nominal.mechanism.joints[0].is_revolute)
    assert stayed[encoder] < 0.85 * new[encoder]
    assert all(stayed[part] < new[part] for part in new)
    named = {"new": 0, "left": 0}
    for seed in range(1, 5):
        shots, _ = again(former, encoder_deg=0.02, part=seed - 1, seed=seed)
        for stand, known in (("new", without_frame(posterior)), ("left", posterior)):
            parts = check(nominal, shots, known, how).parts
            named[stand] += f"encoder {seed - 1}" in parts
    assert named["left"] > named["new"], named


@pytest.mark.slow
@pytest.mark.parametrize("stand_mm", [0.03, 0.1, 0.3, 1.0, 5.0])
def test_a_stand_that_moved_is_no_changed_robot_and_its_motion_is_stated(former, stand_mm):
    for seed in range(1, 5):
        shots, motion_mm = again(former, stand_mm=stand_mm, seed=seed)
        judged = checked(former, shots)
        assert (judged.decision, judged.parts) == ("pass", ())
        error_mm = abs(judged.stand_moved_mm - motion_mm)
        assert error_mm < coverage_factor(count=8) * judged.stand_moved_std_mm < 0.15
        assert "has moved by" in judged.says or stand_mm < 0.3


@pytest.mark.slow
@pytest.mark.parametrize("stand_mm", [0.1, 5.0])
def test_an_encoder_that_moved_is_named_though_the_stand_moved_too(former, stand_mm):
    for seed in range(1, 5):
        shots, _ = again(former, stand_mm=stand_mm, encoder_deg=0.05, part=seed - 1, seed=seed)
        judged = checked(former, shots)
        assert f"encoder {seed - 1}" in judged.parts
        assert "has moved by" in judged.says


def test_a_new_stand_and_a_result_without_a_frame_are_checked_as_ever(former):
    campaign, found, how = former
    nominal, posterior = campaign.robot.kinematics, found.uncertainty.posterior
    old = without_frame(posterior)
    assert checked(former, few(former)) == check(nominal, few(former), old, how)
    shots, _ = again(former)
    flat = fit_with_former(nominal, shots, posterior, how)
    assert with_former_stand(flat, old) is flat
    assert check(nominal, shots, old, how).stand_moved_mm is None


@pytest.mark.slow
def test_a_bump_and_the_slow_motion_of_a_campaign_are_in_the_frame_that_is_stored(former):
    campaign, _, how = former
    shots = campaign.shots
    points = shots.points_in_tracker_mm.copy()
    bumped = np.arange(len(shots)) >= 30
    points[bumped] += [0.0, 0.4, 0.0]
    moved = replace(shots, points_in_tracker_mm=points)
    found = identify(campaign.robot.kinematics, moved, how)
    assert "change" in {event.kind for event in found.judgement.events}
    for shift_mm, has_moved in ((0.4, False), (0.0, True)):
        now, _ = again(former)
        seen = now.points_in_tracker_mm + np.array([0.0, shift_mm, 0.0])
        judged = checked((campaign, found, how), replace(now, points_in_tracker_mm=seen))
        assert judged.parts == ()
        assert ("has moved by" in judged.says) is has_moved


def test_an_updated_result_is_checked_by_the_stand_of_its_update(former):
    campaign, found, how = former
    nominal, shots = campaign.robot.kinematics, again(former, encoder_deg=0.05)[0]
    judged = checked(former, shots)
    updated = update(nominal, shots, found.uncertainty.posterior, how, judged.parts)
    later = checked((campaign, updated, how), again(former, encoder_deg=0.05, seed=2)[0])
    assert (later.decision, later.parts) == ("pass", ())
    assert later.stand_moved_mm < 0.1


def test_the_misfit_of_a_stand_that_was_left_counts_the_coordinates_that_place_it(former):
    campaign, found, how = former
    nominal, posterior = campaign.robot.kinematics, found.uncertainty.posterior
    shots = (again(former, stand_mm=stand_mm)[0] for stand_mm in (0.0, 5.0))
    fits = (fit_with_former(nominal, of_stand, posterior, how) for of_stand in shots)
    left, moved = (misfit_of(with_former_stand(fit, posterior)) for fit in fits)
    assert 18 < left.dof <= 24
    assert moved.dof == 18
    assert not any(misfit.is_significant for misfit in (left, moved))


# Algebra


def permuted(posterior, seed=1):
    """The same posterior with its unknowns in another order, and with other tolerances."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(len(posterior.names))
    scale = rng.uniform(0.5, 2.0, len(order))
    covariance = np.array(posterior.covariance)[np.ix_(order, order)]
    return replace(
        posterior,
        names=tuple(posterior.names[place] for place in order),
        tolerances=tuple(np.array(posterior.tolerances)[order] / scale),
        mean=tuple(np.array(posterior.mean)[order] * scale),
        covariance=tuple(map(tuple, covariance * np.outer(scale, scale))),
        undetermined=tuple(map(tuple, np.array(posterior.undetermined)[:, order] * scale)),
    )


def test_the_prior_of_new_shots_is_the_former_posterior_widened_by_the_drift(former):
    campaign, found, how = former
    nominal, posterior = campaign.robot.kinematics, found.uncertainty.posterior
    fit = fit_with_former(nominal, few(former), posterior, how)
    widened = np.linalg.inv(fit.prior.precision) - np.array(posterior.covariance)
    drift = dict(zip(fit.model.names, np.sqrt(np.abs(np.diag(widened))), strict=True))
    tolerance = dict(zip(fit.model.names, fit.model.tolerance, strict=True))
    assert widened == pytest.approx(np.diag(np.diag(widened)), abs=1e-7)
    for name, usual in {
        "arm0.x_mm": 0.01,
        "arm2.forearm_mm": 0.005,
        "arm1.arm_mm": 0.005,
        "arm3.joint_offset_deg": np.radians(0.002),
    }.items():
        assert drift[name] * tolerance[name] == pytest.approx(usual, rel=1e-2), name
    for name in ("scale", "constant", "transit", "arm0.axis_tilt_deg"):
        assert drift[name] < 1e-3
    assert fit.prior.mean == pytest.approx(np.array(posterior.mean))
    assert dict(fit.prior.factors) == posterior.factors
    changed = fit_with_former(nominal, few(former), posterior, how, ("encoder 1", "mount 2"))
    widened = np.linalg.inv(changed.prior.precision) - np.array(posterior.covariance)
    wider = np.sqrt(np.abs(np.diag(widened)))
    wider = dict(zip(fit.model.names, wider * fit.model.tolerance, strict=True))
    assert wider["arm1.joint_offset_deg"] == pytest.approx(np.radians(0.1), rel=1e-3)
    assert wider["arm2.y_mm"] == pytest.approx(0.2, rel=1e-3)
    assert wider["arm1.y_mm"] == pytest.approx(0.01, rel=2e-2)
    assert wider["arm0.joint_offset_deg"] == pytest.approx(np.radians(0.002), rel=1e-2)


def test_the_order_and_the_tolerances_of_a_stored_posterior_do_not_matter(former):
    campaign, found, how = former
    nominal, posterior = campaign.robot.kinematics, found.uncertainty.posterior
    same = fit_with_former(nominal, few(former), posterior, how)
    other = fit_with_former(nominal, few(former), permuted(posterior), how)
    assert other.prior.mean == pytest.approx(same.prior.mean)
    assert other.x / same.std == pytest.approx(same.x / same.std, abs=1e-3)
    assert other.std == pytest.approx(same.std, rel=1e-4)
    of_both = [former_datum(each, same).projector for each in (posterior, permuted(posterior))]
    assert of_both[0] == pytest.approx(of_both[1], abs=1e-6)
    z = np.array(posterior.undetermined).T
    assert of_both[0] @ z == pytest.approx(0.0 * z, abs=1e-7)


def test_the_misfit_is_that_of_shots_and_prior_together(former):
    campaign, found, how = former
    fit = fit_with_former(campaign.robot.kinematics, few(former), found.uncertainty.posterior, how)
    misfit = misfit_of(fit)
    deviation = fit.x - np.array(found.uncertainty.posterior.mean)
    expected = sum(r @ w @ r for r, w in zip(fit.at.residual, fit.weights, strict=True))
    expected += deviation @ fit.prior.precision @ deviation
    assert misfit.chi2 == pytest.approx(expected)
    assert misfit.dof == 3 * 8 - 6
    assert misfit.p == pytest.approx(scipy.stats.chi2(18).sf(misfit.chi2))
    assert not misfit.is_significant
    assert Misfit(60.0, 18, 0.9e-3).is_significant
    assert not Misfit(40.0, 18, 1.1e-3).is_significant
    with pytest.raises(ValueError, match="no former result"):
        misfit_of(replace(fit, prior=Prior()))


def test_a_wrong_shot_of_a_check_is_named_and_decides_nothing_two_fail(former):
    shots = few(former)
    points = shots.points_in_tracker_mm.copy()
    points[3] += [0.5, 0.0, 0.3]
    one = checked(former, replace(shots, points_in_tracker_mm=points))
    assert (one.decision, one.wrong) == ("not decided", (shots.numbers[3],))
    assert f"shot {shots.numbers[3]} contradicts all others: measure it again" in one.says
    points[6] += [0.0, 1.0, -0.7]
    two = checked(former, replace(shots, points_in_tracker_mm=points))
    assert (two.decision, two.wrong) == ("fail", (shots.numbers[3], shots.numbers[6]))


def test_shots_that_scatter_more_than_ever_contradict_the_former_result(former):
    shots = few(former, count=12)
    noise_mm = 0.06 * np.random.default_rng(4).standard_normal(shots.points_in_tracker_mm.shape)
    scattered = replace(shots, points_in_tracker_mm=shots.points_in_tracker_mm + noise_mm)
    judged = checked(former, scattered)
    assert judged.decision == "fail"
    assert judged.p < 1e-3
