"""Shots that tell little or are plainly wrong: nothing is let go, believed or left unsaid."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from fake_cell import NOMINAL
from identified_cases import (
    TRACKER_FROM_BASE,
    dataset,
    deviations,
    identified,
    moved,
    noisy,
    region,
    simulated,
    stating,
    values,
    workspace,
)
from par4_space import par4

from campaigns.design.pose_sampling import interior_poses
from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.estimation.estimators import Estimator, Outliers
from campaigns.shots.shot_sets import ShotSet

BOTH = pytest.mark.parametrize("estimator", list(Estimator))
OFF = {"arm1.x_mm": 172.2, "arm2.forearm_mm": 700.3, "plate_mm": 99.9}
LITTLE_OFF = par4(NOMINAL.parameters | OFF)


def at_one_theta(theta_rad: float, spread_rad: float = 0.0):
    rng = np.random.default_rng(5)
    poses = interior_poses(region(), 160, rng)
    poses[:, 3] = theta_rad + rng.uniform(-spread_rad, spread_rad, len(poses))
    solution = NOMINAL.inverse(poses)
    joints = solution.values[solution.found][:140]
    points = TRACKER_FROM_BASE.apply(LITTLE_OFF.forward(joints).values_or_raise()[:, :3])
    purposes = [ShotSet.IDENTIFICATION] * 120 + [ShotSet.VALIDATION] * 20
    return noisy(dataset(joints, points, np.repeat(np.arange(70), 2).tolist(), purposes), 1)


def test_what_shots_at_one_theta_hardly_tell_is_named_and_fails() -> None:
    found = identified(at_one_theta(0.3), Estimator.POINTS, poses=workspace())
    assert found.verdict == "fail"
    assert any("plate_mm" in names for names in found.unobservable)
    assert found.rank < 22
    assert deviations(found)["plate_mm"] is None
    assert abs(values(found)["plate_mm"] - 100.0) < 0.5
    found = identified(at_one_theta(0.1, spread_rad=0.03), Estimator.POINTS)
    assert deviations(found)["plate_mm"] > 5.0
    assert found.verdict == "fail"
    assert any(reason.startswith("the data barely determine ") for reason in found.reasons)


@BOTH
def test_a_gross_error_among_shots_stated_far_too_well_is_no_crash(estimator: Estimator) -> None:
    """Covariances in m² where mm² are meant: a whitened misfit of more than a million."""
    data = stating(moved(simulated(30, 8, seed=3), (4, 9), by_mm=30.0), std_mm=1e-5)
    with suppress(ShotsInvalid):  # which says that no robot explains them
        found = identified(data, estimator, poses=workspace())
        of_points = estimator is Estimator.POINTS
        left_out = {each.shot if of_points else each.pair for each in found.excluded}
        assert found.verdict == "fail" or left_out >= ({4, 9} if of_points else {2, 4})


@pytest.mark.long
@BOTH
def test_a_gross_error_that_is_kept_is_no_crash(estimator: Estimator) -> None:
    for seed in range(2):
        data = moved(noisy(simulated(30, 8, seed=seed), seed), (4, 9, 20), by_mm=400.0, seed=seed)
        found = identified(data, estimator, poses=workspace(), outliers=Outliers.KEEP)
        assert found.verdict == "fail" or found.residuals_mm.after.rms > 1.0


def test_pairs_at_one_place_are_left_out_and_named() -> None:
    data = noisy(simulated(60, 8, seed=3), 4)
    joints, points = data.joints.copy(), data.points_in_tracker_mm.copy()
    joints[1], points[1] = joints[0], points[0]
    twice = replace(data, joints=joints, points_in_tracker_mm=points)
    found = identified(twice, Estimator.DISTANCES)
    assert [(each.pair, each.reason) for each in found.excluded] == [
        (0, "its two shots are at one place")
    ]
    assert found.verdict == "pass"
    still = np.tile(joints[0], (136, 1)), np.tile(points[0], (136, 1))
    nowhere = replace(data, joints=still[0], points_in_tracker_mm=still[1])
    with pytest.raises(ShotsMissing, match=r"0 pairs \(60 left out\)"):
        identified(nowhere, Estimator.DISTANCES)


def test_no_pairs_are_too_few_whatever_the_priors() -> None:
    data = noisy(simulated(60, 8, seed=3), 4)
    unseen = replace(data, purposes=(ShotSet.VALIDATION,) * len(data.purposes))
    with pytest.raises(ShotsMissing, match="0 pairs"):
        identified(unseen, Estimator.DISTANCES, prior=["*=1"])


def test_one_shot_stated_badly_hides_no_outlier_among_distances() -> None:
    data = moved(noisy(simulated(60, 20, seed=3), 4), (20,), by_mm=2.0)
    stated = data.stated_covariance_mm2.copy()
    stated[3] = 100.0 * np.eye(3)
    found = identified(replace(data, stated_covariance_mm2=stated), Estimator.DISTANCES)
    assert [each.pair for each in found.excluded] == [10]


@BOTH
def test_outliers_are_looked_for_where_priors_stand_for_shots(estimator: Estimator) -> None:
    data = moved(noisy(simulated(14, 8, seed=3, truth=LITTLE_OFF), 4), (2,), by_mm=20.0)
    found = identified(data, estimator, prior=["*=0.5"])
    assert len(found.excluded) == 1


@BOTH
def test_a_prior_that_the_shots_contradict_is_named_and_fails(estimator: Estimator) -> None:
    data = noisy(simulated(60, 8, seed=3, truth=LITTLE_OFF), 4)
    wrong = identified(data, estimator, prior=["arm2.forearm_mm=0.01"])
    assert wrong.verdict == "fail"
    (reason,) = (each for each in wrong.reasons if "contradict" in each)
    assert "the prior of arm2.forearm_mm: they alone give 700." in reason
    right = identified(data, estimator, prior=["arm2.forearm_mm=0.3", "arm1.arm_mm=0.01"])
    assert right.verdict == "pass"
