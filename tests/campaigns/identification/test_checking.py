"""Check by a few shots from another stand, and update of the parameters by them."""

from dataclasses import replace

import numpy as np
import pytest
from rod_campaigns import SMALL, rod_campaign

from campaigns.api import find_robot, sample_workspace
from campaigns.errors import IdentificationRefused
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.identification.checking import check
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
    judged = check(campaign.robot.kinematics, few(former), found.posterior, how)
    assert judged.decision == "pass"
    assert judged.parts == ()


def test_a_moved_encoder_is_named_and_the_update_corrects_it(former):
    campaign, found, how = former
    shots = few(former, encoder_deg=0.05)
    judged = check(campaign.robot.kinematics, shots, found.posterior, how)
    assert judged.decision == "fail"
    assert "encoder 0" in judged.parts
    updated = update(campaign.robot.kinematics, shots, found.posterior, how, judged.parts)
    assert updated.verdict == "pass", updated.reasons
    campaign.truth.encoder_shift[0] = np.radians(0.05)
    before_mm, after_mm = map(campaign.position_error_mm, (found, updated))
    campaign.truth.encoder_shift[0] = 0.0
    assert after_mm < 0.3 * before_mm
    assert after_mm < 2.0 * updated.position_std_mm.rms


def test_too_few_shots_decide_nothing(former):
    campaign, found, how = former
    nominal = campaign.robot.kinematics
    judged = check(nominal, few(former, count=4), found.posterior, how)
    assert judged.decision == "not decided"
    assert "4 shots are too few" in judged.says


def test_held_parameters_and_a_former_result_with_held_ones_can_be_checked(former):
    campaign, found, _ = former
    nominal = campaign.robot.kinematics
    fixed = IdentificationOptions(fix=("rods",))
    assert check(nominal, few(former), found.posterior, fixed).decision == "pass"
    held = identify(nominal, campaign.shots, fixed)
    assert check(nominal, few(former), held.posterior, IdentificationOptions()).decision == "pass"


def test_a_result_of_another_kind_of_robot_is_refused(former):
    _, found, how = former
    other = find_robot("linear-delta").kinematics
    poses = sample_workspace(find_robot("linear-delta"), 8)
    joints = other.inverse(poses).values_or_raise()
    shots = replace(few(former), joints=joints, approach=np.zeros_like(joints), commanded=poses)
    with pytest.raises(IdentificationRefused, match="other unknowns"):
        check(other, shots, found.posterior, how)
