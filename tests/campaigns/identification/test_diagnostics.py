"""What speaks against a result is named, decides, and can be accepted where that is foreseen."""

from dataclasses import replace

import numpy as np
import pytest
from identified_cases import TRUTH, doubt, found_with, identified, moved, noisy, simulated

from campaigns.estimation.estimators import Estimator, Model
from campaigns.evaluation.diagnostics import COMMON_SCALE, HOLD_OUT, LARGE_CHANGE
from campaigns.robots.schema import Tolerance
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import between, held_out

CLEAN = noisy(simulated(60, 20, seed=1), seed=1)


def scaled(data, factor):
    return replace(data, points_in_tracker_mm=factor * data.points_in_tracker_mm)


def test_a_common_share_is_named_and_not_passed_without_consent():
    factor = 0.99
    found = found_with(scaled(CLEAN, factor))
    told = doubt(found, COMMON_SCALE)
    assert told.numbers["share"] == pytest.approx(factor - 1.0, abs=2e-3)
    assert found.verdict == "fail"
    accepted = found_with(scaled(CLEAN, factor), accept_scale=True, accept_large_change=True)
    assert accepted.verdict == "pass"
    assert doubt(accepted, COMMON_SCALE).accepted


def test_a_change_beyond_the_robots_tolerance_fails_unless_accepted():
    narrow = Tolerance(length_mm=2.0)
    found = found_with(CLEAN, tolerance=narrow)
    assert found.verdict == "fail"
    assert "tolerance ± 2 mm" in doubt(found, LARGE_CHANGE).says
    assert found_with(CLEAN).doubts == ()
    accepted = found_with(CLEAN, tolerance=narrow, accept_large_change=True)
    assert accepted.verdict == "pass"


def test_unseen_pairs_as_good_as_their_sigmas_are_believed():
    tested = found_with(CLEAN).hold_out
    assert tested.pairs == 20
    assert 0.5 < tested.ratio < 1.5
    assert tested.p > 1e-3


def bent(data):
    """Points of the hold-out pairs where no parameter would put them, by 0.1 mm."""
    unseen = np.array([purpose is ShotSet.VALIDATION for purpose in data.purposes])
    push = 0.1 * np.random.default_rng(2).standard_normal((len(data), 3)) * unseen[:, None]
    return replace(data, points_in_tracker_mm=data.points_in_tracker_mm + push)


def test_unseen_pairs_worse_than_their_sigmas_leave_it_open_unless_limits_are_met():
    found = found_with(bent(CLEAN))
    assert found.hold_out.ratio > 3.0
    assert found.verdict == "not decided"
    assert doubt(found, HOLD_OUT).says in found.reasons
    assert found_with(bent(CLEAN), limits_mm={"max": 1.0}).verdict == "pass"
    assert found_with(bent(CLEAN), limits_mm={"max": 0.01}).verdict == "not decided"


@pytest.mark.parametrize("seed", range(2))
def test_sigma_of_22_pairs_is_true_by_the_coordinates_of_their_shots(seed):
    found = identified(noisy(simulated(22, 6, seed=seed), seed), Estimator.DISTANCES)
    truth = TRUTH.parameters
    sigmas = [
        (each.value - truth[name]) / each.std
        for name, each in found.parameters.items()
        if each.std is not None
    ]
    assert np.sqrt(np.mean(np.square(sigmas))) < 2.0


class TestHeldOut:
    def test_whole_pairs_are_held_out_beside_those_that_are_there(self):
        some = held_out(simulated(50, 0, seed=1), 0.2, np.random.default_rng(1))
        assert len(some.whole_pairs(ShotSet.VALIDATION).rows) == 10
        assert len(some.whole_pairs(ShotSet.IDENTIFICATION).rows) == 40
        assert not some.whole_pairs(ShotSet.VALIDATION).halves
        first = some.whole_pairs(ShotSet.VALIDATION).rows[:, 0]
        assert np.diff(np.sort(first)).max() < 20
        some = held_out(simulated(50, 7, seed=1), 0.2, np.random.default_rng(1))
        assert len(some.whole_pairs(ShotSet.VALIDATION).rows) == 17
        data = simulated(10, 2, seed=1)
        assert held_out(data, 0.0, np.random.default_rng(1)) is data

    def test_data_without_validation_pairs_can_pass_by_it(self):
        data = held_out(noisy(simulated(60, 0, seed=1), 1), 0.2, np.random.default_rng(1))
        found = found_with(data)
        assert found.verdict == "pass"
        assert found.hold_out.pairs == 12


class TestRangeOfShots:
    def test_identification_shots_outside_of_limits_are_left_out(self):
        some = between(simulated(50, 7, seed=1), 20, 59)
        assert len(some.whole_pairs(ShotSet.IDENTIFICATION).rows) == 20
        assert len(some.whole_pairs(ShotSet.VALIDATION).rows) == 7
        assert min(some.numbers) == 20
        data = simulated(10, 2, seed=1)
        assert between(data, None, None) is data


def test_no_sigma_at_all_is_not_decided():
    found = found_with(
        noisy(simulated(22, 8, seed=2), 2), estimator=Estimator.DISTANCES, model=Model.PAPER
    )
    assert found.verdict == "not decided"
    assert "the uncertainty of the parameters is unknown" in found.reasons[0]


def test_a_slipped_encoder_is_no_pass_by_distances_of_equal_weight_either():
    data = noisy(simulated(60, 20, seed=3), 3)
    joints = data.joints.copy()
    joints[60:, 2] += np.radians(0.05)
    slipped = replace(data, joints=joints)
    found = found_with(slipped, estimator=Estimator.DISTANCES, model=Model.PAPER)
    assert found.verdict == "fail"
    assert doubt(found, "change-during-campaign").numbers["cause"] == "arm2.joint_offset_deg"


def test_intervals_are_students_where_few_distances_tell_their_own_variance():
    data = noisy(simulated(30, 8, seed=2), 2)
    few = found_with(data, estimator=Estimator.DISTANCES, model=Model.PAPER)
    assert few.dof == 8
    assert few.coverage_factor_95 == pytest.approx(2.086, abs=1e-3), "8 left over, 12 stated"
    assert found_with(data).coverage_factor_95 == pytest.approx(1.960, abs=1e-3)
    stated = found_with(data, estimator=Estimator.DISTANCES)
    assert stated.coverage_factor_95 == pytest.approx(1.960, abs=1e-3)


@pytest.mark.parametrize("estimator", list(Estimator))
def test_so_many_wrong_shots_are_no_single_mistakes_by_either_estimator(estimator):
    found = found_with(moved(CLEAN, tuple(range(0, 120, 8)), by_mm=2.0), estimator=estimator)
    assert found.verdict == "fail"
    assert "so many are no single mistakes" in found.reasons[0]
