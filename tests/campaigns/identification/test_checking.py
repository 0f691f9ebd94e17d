"""Check by a few shots from another stand, and update of the parameters by them."""

from dataclasses import replace

import numpy as np
import pytest
import scipy
from rod_campaigns import SMALL, rod_campaign

from campaigns.api import find_robot, sample_workspace
from campaigns.errors import IdentificationRefused
from campaigns.fit.fit import Prior
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.identification.checking import (
    CheckResult,
    Misfit,
    check,
    fit_with_former,
    former_datum,
    misfit_of,
)
from campaigns.identification.identify import identify, update
from campaigns.identification.options import IdentificationOptions

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


def test_an_unchanged_robot_is_good_wherever_the_tracker_stands(former):
    campaign, found, how = former
    judged = check(campaign.robot.kinematics, few(former), found.uncertainty.posterior, how)
    assert judged.decision == "pass"
    assert judged.parts == ()


def test_a_moved_encoder_is_named_and_the_update_corrects_it(former):
    campaign, found, how = former
    shots = few(former, encoder_deg=0.05)
    judged = check(campaign.robot.kinematics, shots, found.uncertainty.posterior, how)
    assert judged.decision == "fail"
    assert "encoder 0" in judged.parts
    updated = update(
        campaign.robot.kinematics, shots, found.uncertainty.posterior, how, judged.parts
    )
    assert updated.judgement.verdict == "pass", updated.judgement.reasons
    campaign.truth.encoder_shift[0] = np.radians(0.05)
    before_mm, after_mm = map(campaign.position_error_mm, (found, updated))
    campaign.truth.encoder_shift[0] = 0.0
    assert after_mm < 0.3 * before_mm
    assert after_mm < 2.0 * updated.uncertainty.position_std_mm.rms


def test_too_few_shots_decide_nothing(former):
    campaign, found, how = former
    nominal = campaign.robot.kinematics
    judged = check(nominal, few(former, count=4), found.uncertainty.posterior, how)
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
    assert (
        check(nominal, few(former), held.uncertainty.posterior, IdentificationOptions()).decision
        == "pass"
    )


def test_a_result_of_another_kind_of_robot_is_refused(former):
    _, found, how = former
    other = find_robot("linear-delta").kinematics
    poses = sample_workspace(find_robot("linear-delta"), 8)
    joints = other.inverse(poses).values_or_raise()
    shots = replace(few(former), joints=joints, approach=np.zeros_like(joints), commanded=poses)
    with pytest.raises(IdentificationRefused, match="other unknowns"):
        check(other, shots, found.uncertainty.posterior, how)


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
    nominal = campaign.robot.kinematics
    same = fit_with_former(nominal, few(former), found.uncertainty.posterior, how)
    other = fit_with_former(nominal, few(former), permuted(found.uncertainty.posterior), how)
    assert other.prior.mean == pytest.approx(same.prior.mean)
    assert other.x / same.std == pytest.approx(same.x / same.std, abs=1e-3)
    assert other.std == pytest.approx(same.std, rel=1e-4)
    of_both = [
        former_datum(posterior, same).projector
        for posterior in (found.uncertainty.posterior, permuted(found.uncertainty.posterior))
    ]
    assert of_both[0] == pytest.approx(of_both[1], abs=1e-6)
    z = np.array(found.uncertainty.posterior.undetermined).T
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
    campaign, found, how = former
    nominal, shots = campaign.robot.kinematics, few(former)
    points = shots.points_in_tracker_mm.copy()
    points[3] += [0.5, 0.0, 0.3]
    one = check(
        nominal, replace(shots, points_in_tracker_mm=points), found.uncertainty.posterior, how
    )
    assert (one.decision, one.wrong) == ("not decided", (shots.numbers[3],))
    assert f"shot {shots.numbers[3]} contradicts all others: measure it again" in one.says
    points[6] += [0.0, 1.0, -0.7]
    two = check(
        nominal, replace(shots, points_in_tracker_mm=points), found.uncertainty.posterior, how
    )
    assert (two.decision, two.wrong) == ("fail", (shots.numbers[3], shots.numbers[6]))


def test_shots_that_scatter_more_than_ever_contradict_the_former_result(former):
    campaign, found, how = former
    shots = few(former, count=12)
    noise_mm = 0.06 * np.random.default_rng(4).standard_normal(shots.points_in_tracker_mm.shape)
    scattered = replace(shots, points_in_tracker_mm=shots.points_in_tracker_mm + noise_mm)
    judged = check(campaign.robot.kinematics, scattered, found.uncertainty.posterior, how)
    assert judged.decision == "fail"
    assert judged.p < 1e-3
