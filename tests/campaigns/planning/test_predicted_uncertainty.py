"""What a plan will tell: parameters, positions, and from which side joints come."""

from dataclasses import replace

import numpy as np
import pytest
from par4_space import SPACE

from campaigns.design.pose_sampling import sample_workspace, workspace_poses
from campaigns.design.restricted_space import Disc, RestrictedSpace, Zone
from campaigns.errors import ConfigInvalid, PlanInvalid
from campaigns.estimation import information, tracker_noise
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.observability import observability
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.planning import plans, predicted_uncertainty
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.robot import find_robot
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
GEOMETRY = ROBOT.kinematics
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
VIEW = plans.View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
TRACKER_MM = np.array(VIEW.tracker_mm)
MEANS = predicted_uncertainty.EstimationSetup(
    Estimator.POINTS, SPACE.free_by_default, tracker_noise.TrackerUncertainty()
)
BY_DISTANCES = replace(MEANS, estimator=Estimator.DISTANCES)
REGION = plans.region_of(GEOMETRY, ROBOT.limits, VIEW, CENTRE)


def planned(shots, seed=1):
    request = plans.PlanRequest(shots, 4, 2, CENTRE)
    return plans.make_plan(ROBOT, VIEW, request, np.random.default_rng(seed))


def shortened(name, by_mm):
    """Shipped robot's model with shorter forearms, which cannot take all of its poses."""
    robot = find_robot(name).robot
    p, space = robot.kinematics.p.copy(), robot.mechanism.parameters
    p[space.places(space.of_field("forearm_mm"))] -= by_mm
    return Kinematics(robot.mechanism, p), robot


@pytest.mark.parametrize(("name", "by_mm"), [("i4l", 50.0), ("i4r", 200.0)])
def test_poses_that_a_robot_cannot_take_are_left_out_of_its_sample_and_counted(name, by_mm):
    """Out of reach, or, of one pose of the I4R, in another assembly mode."""
    short, robot = shortened(name, by_mm)
    free = robot.mechanism.parameters.free_by_default
    poses = sample_workspace(robot.kinematics, robot.limits, robot.workspace_centre)
    assert information.WorkspaceSample.of_workspace(robot.kinematics, free, poses).left_out == 0
    with pytest.raises(NoSolution):
        information.WorkspaceSample.of(short, free, poses)
    sample = information.WorkspaceSample.of_workspace(short, free, poses)
    taken = poses[short.forward(short.inverse(poses).values, poses).found]
    np.testing.assert_array_equal(sample.poses, taken)
    assert 0 < sample.left_out == len(poses) - len(sample.poses)
    again = information.WorkspaceSample.of(short, free, taken)
    np.testing.assert_array_equal(sample.jacobian, again.jacobian)


def test_a_robot_that_takes_hardly_a_pose_is_refused_with_what_to_correct(plan):
    short, _ = shortened("par4-prototype", 400.0)
    elsewhere = Zone("cabinet", Disc((9000.0, 0.0), 1.0), (0.0, 1.0), keeps_in=True)
    robot = RobotModel(short, ROBOT.limits, REGION.centre, RestrictedSpace((elsewhere,)))
    with pytest.raises(ConfigInvalid, match=r"at \d of 70 poses of its workspace \(limit 10 %\)"):
        predicted_uncertainty.sample_positions(robot, SPACE.free_by_default, plan)


@pytest.fixture(scope="module")
def plan():
    return planned(60)


@pytest.fixture(scope="module")
def poses():
    rng = np.random.default_rng(2)
    return workspace_poses(REGION.kinematics, REGION.limits, REGION.centre, 100, rng)


@pytest.fixture(scope="module")
def rows(poses):
    return information.WorkspaceSample.of(GEOMETRY, SPACE.free_by_default, poses)


def rows_of(plan, estimator):
    """Jacobian of what an estimator looks at, in units of its noise, the frame fitted."""
    pairs = plans.pairs_of(plan, ShotSet.IDENTIFICATION)
    joints, poses = plans.joints_of(plan), plans.poses_of(plan)
    noise = tracker_noise.point_covariance_mm2(
        poses[:, :3] - TRACKER_MM, tracker_noise.TrackerUncertainty()
    )
    if estimator is Estimator.POINTS:
        rows = pairs.ravel()
        seen = information.point_jacobian(
            GEOMETRY, SPACE.free_by_default, joints[rows], poses[rows]
        )
        return information.marginalise_frame(information.whitened(seen, noise[rows])).reshape(
            -1, 22
        )
    variance = tracker_noise.distance_variance_mm2(poses[:, :3], noise, *pairs.T)
    seen = information.distance_jacobian(GEOMETRY, SPACE.free_by_default, joints, poses, pairs)
    return seen / np.sqrt(tracker_noise.pooled_variance_mm2(variance))


@pytest.mark.parametrize("means", [MEANS, BY_DISTANCES], ids=lambda means: means.estimator)
def test_covariance_rank_and_condition_are_of_one_estimator(plan, rows, means):
    forecast = predicted_uncertainty.plan_forecast(plan, GEOMETRY, TRACKER_MM, means, rows)
    seen = rows_of(plan, means.estimator)
    alone = np.linalg.inv(seen.T @ seen)
    std = np.sqrt(np.diag(alone)) / SPACE.units(SPACE.free_by_default)
    assert [*forecast.predicted.std().values()] == pytest.approx(std, rel=1e-6)
    assert forecast.seen.rank == 22
    assert forecast.seen.condition == pytest.approx(observability(seen).condition, rel=1e-6)
    assert forecast.shots == 60


def test_validation_and_drift_shots_tell_nothing(plan, rows):
    alone = [shot for shot in plan if shot.purpose is ShotSet.IDENTIFICATION]
    for means in (MEANS, BY_DISTANCES):
        whole = predicted_uncertainty.plan_forecast(plan, GEOMETRY, TRACKER_MM, means, rows)
        part = predicted_uncertainty.plan_forecast(alone, GEOMETRY, TRACKER_MM, means, rows)
        assert whole.predicted.std() == pytest.approx(part.predicted.std(), rel=1e-12)


def test_a_nearer_tracker_tells_more(plan, rows):
    far = predicted_uncertainty.plan_forecast(plan, GEOMETRY, 2.0 * TRACKER_MM, MEANS, rows)
    near = predicted_uncertainty.plan_forecast(plan, GEOMETRY, TRACKER_MM, MEANS, rows)
    assert near.predicted.largest("mm") < 0.8 * far.predicted.largest("mm")


@pytest.mark.parametrize("means", [MEANS, BY_DISTANCES], ids=lambda means: means.estimator)
def test_a_wrong_scale_of_the_tracker_scales_all_positions(plan, poses, rows, means):
    forecast = predicted_uncertainty.plan_forecast(plan, GEOMETRY, TRACKER_MM, means, rows)
    moved_mm = forecast.predicted.common_of_positions(rows)["scale"]
    scaled_mm = means.uncertainty.scale * (poses[:, :3] - poses[:, :3].mean(axis=0))
    assert scaled_mm.max() > 1e-4
    np.testing.assert_allclose(
        moved_mm, np.sign(np.sum(moved_mm * scaled_mm)) * scaled_mm, atol=1e-6
    )
    assert (forecast.total_position_std_mm > forecast.position_std_mm).all()
    assert forecast.position_std_mm == pytest.approx(forecast.predicted.random.of_positions(rows))


@pytest.mark.parametrize(("means", "shots"), [(MEANS, 12), (BY_DISTANCES, 40)])
def test_too_few_shots_tell_nothing_for_sure(rows, means, shots):
    forecast = predicted_uncertainty.plan_forecast(
        planned(shots), GEOMETRY, TRACKER_MM, means, rows
    )
    assert not forecast.predicted.full_rank
    assert forecast.seen.rank < 22
    assert set(forecast.predicted.std().values()) == {np.inf}
    assert np.isinf(forecast.position_std_mm).all()


def test_parameters_that_no_position_tells_apart_are_named(poses):
    with pytest.raises(PlanInvalid, match=r"arm0\.x_mm, .*arm3\.x_mm move together.*--fix"):
        predicted_uncertainty.require_identifiable(
            information.WorkspaceSample.of(GEOMETRY, ("arm0.x_mm", *SPACE.free_by_default), poses)
        )


def at(number, purpose, *joints):
    return PlannedShot(number, purpose, None, CENTRE, joints)


def test_shares_count_identification_shots_alone_and_the_way_to_each():
    wanted = ShotSet.IDENTIFICATION
    shots = [
        at(0, ShotSet.DRIFT, 0.0, 0.0, 0.0, 0.0),
        at(1, wanted, 1.0, -1.0, 1.0, -1.0),
        at(2, ShotSet.VALIDATION, 0.0, 0.0, 2.0, 0.0),
        at(3, wanted, 1.0, -1.0, 1.0, 1.0),
    ]
    assert predicted_uncertainty.plan_approach_shares(shots) == (1.0, 0.0, 0.5, 0.5)
