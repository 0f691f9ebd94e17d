"""What a plan will tell: parameters, positions, and from which side joints come."""

from dataclasses import replace

import numpy as np
import pytest

from campaigns.design.pose_sampling import workspace_poses
from campaigns.errors import PlanInvalid
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import FREE_BY_DEFAULT, Geometry, indices
from campaigns.mechanisms.par4 import inverse
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import PlanRequest, View, make_plan, region_of
from campaigns.planning.predicted_precision import (
    EstimationSetup,
    PrecisionCurvePoint,
    PredictedPrecision,
    plan_approach_shares,
    predict_precision,
    workspace_jacobian,
)
from campaigns.robots.robot import find_robot, numeric_geometry, numeric_limits
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
GEOMETRY = numeric_geometry(ROBOT)
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
VIEW = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
TRACKER_MM = np.array(VIEW.tracker_mm)
MEANS = EstimationSetup(Estimator.POINTS, FREE_BY_DEFAULT, TrackerUncertainty())
BY_DISTANCES = replace(MEANS, estimator=Estimator.DISTANCES)
REGION = region_of(GEOMETRY, numeric_limits(ROBOT), VIEW, CENTRE)


def planned(shots, seed=1):
    request = PlanRequest(shots, 4, 2, CENTRE)
    return make_plan(ROBOT, VIEW, request, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def plan():
    return planned(60)


@pytest.fixture(scope="module")
def poses():
    rng = np.random.default_rng(2)
    return workspace_poses(REGION.geometry, REGION.limits, REGION.centre, 100, rng)


@pytest.fixture(scope="module")
def rows(poses):
    return workspace_jacobian(GEOMETRY, FREE_BY_DEFAULT, poses)


def test_positions_scatter_as_foretold_when_parameters_do(plan, rows, poses):
    """Parameters drawn from what is foretold, poses by the forward model, frame by a best fit."""
    foresight = predict_precision(plan, GEOMETRY, TRACKER_MM, MEANS, rows)
    rng, joints = np.random.default_rng(3), inverse(GEOMETRY, poses).require()
    draws = rng.multivariate_normal(np.zeros(22), foresight.expected.covariance, 300)
    squares = np.zeros(len(poses))
    for draw in draws:
        vector = GEOMETRY.vector()
        vector[indices(FREE_BY_DEFAULT)] += draw
        points = forward(Geometry.from_vector(vector), joints, poses).require()[:, :3]
        fitted = fit_transform(points, poses[:, :3]).apply(points)
        squares += np.sum((fitted - poses[:, :3]) ** 2, axis=1)
    found = np.sqrt(squares / len(draws))
    assert found.mean() == pytest.approx(foresight.position_std_mm.mean(), rel=0.05)
    assert found == pytest.approx(foresight.position_std_mm, rel=0.25)


@pytest.mark.parametrize("means", [MEANS, BY_DISTANCES], ids=lambda means: means.estimator)
def test_covariance_and_prediction_are_of_one_estimator(plan, rows, means):
    foresight = predict_precision(plan, GEOMETRY, TRACKER_MM, means, rows)
    assert foresight.expected.std == pytest.approx(foresight.prediction.std, rel=1e-6)
    assert foresight.expected.shots == 60


def test_validation_and_drift_shots_tell_nothing(plan, rows):
    alone = [shot for shot in plan if shot.purpose is ShotSet.IDENTIFICATION]
    for means in (MEANS, BY_DISTANCES):
        whole = predict_precision(plan, GEOMETRY, TRACKER_MM, means, rows)
        part = predict_precision(alone, GEOMETRY, TRACKER_MM, means, rows)
        assert whole.expected.std == pytest.approx(part.expected.std, rel=1e-12)


def test_a_nearer_tracker_tells_more(plan, rows):
    far = predict_precision(plan, GEOMETRY, 2.0 * TRACKER_MM, MEANS, rows)
    near = predict_precision(plan, GEOMETRY, TRACKER_MM, MEANS, rows)
    assert near.expected.worst_length_mm < 0.8 * far.expected.worst_length_mm


@pytest.mark.parametrize(("means", "shots"), [(MEANS, 12), (BY_DISTANCES, 40)])
def test_too_few_shots_tell_nothing_for_sure(rows, means, shots):
    foresight = predict_precision(planned(shots), GEOMETRY, TRACKER_MM, means, rows)
    assert not foresight.expected.tells_all
    assert foresight.prediction.rank < 22
    assert set(foresight.expected.std_in_file_units.values()) == {np.inf}
    assert np.isinf(foresight.position_std_mm).all()


def test_worst_length_and_worst_angle_are_found_each_among_its_own():
    names = ("arm1.x_mm", "arm1.joint_offset_deg", "plate_mm")
    expected = PredictedPrecision(20, names, np.diag([0.04, 0.01, 0.09]))
    assert (expected.worst_length_mm, expected.worst_angle_rad) == pytest.approx((0.3, 0.1))
    assert expected.std_in_file_units["arm1.joint_offset_deg"] == pytest.approx(np.degrees(0.1))


def test_a_point_of_the_curve_has_the_mean_over_the_workspace(plan, rows):
    foresight = predict_precision(plan, GEOMETRY, TRACKER_MM, MEANS, rows)
    point = PrecisionCurvePoint.of(foresight.expected, rows)
    assert point.position_mm == pytest.approx(foresight.position_std_mm.mean())


def test_parameters_that_no_position_tells_apart_are_named(poses):
    with pytest.raises(PlanInvalid, match=r"arm0\.x_mm, .*arm3\.x_mm move together.*--fix"):
        workspace_jacobian(GEOMETRY, ("arm0.x_mm", *FREE_BY_DEFAULT), poses)


def at(number, purpose, *joints_rad):
    return PlannedShot(number, purpose, None, CENTRE, joints_rad)


def test_shares_count_identification_shots_alone_and_the_way_to_each():
    wanted = ShotSet.IDENTIFICATION
    shots = [
        at(0, ShotSet.DRIFT, 0.0, 0.0, 0.0, 0.0),
        at(1, wanted, 1.0, -1.0, 1.0, -1.0),
        at(2, ShotSet.VALIDATION, 0.0, 0.0, 2.0, 0.0),
        at(3, wanted, 1.0, -1.0, 1.0, 1.0),
    ]
    assert plan_approach_shares(shots) == (1.0, 0.0, 0.5, 0.5)
