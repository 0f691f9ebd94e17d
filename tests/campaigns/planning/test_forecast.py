"""What a plan makes known, foreseen before anything moves."""

from dataclasses import replace

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, ROBOT
from small_plans import LIMITS

from campaigns.design.pose_sampling import sample_workspace
from campaigns.design.restricted_space import Disc, RestrictedSpace, Zone
from campaigns.errors import ConfigInvalid
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.fit import Prior, fit_model
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.fit.uncertainty import length_std
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.transmission import approach_along
from campaigns.planning import plans
from campaigns.planning.forecast import Forecast, forecast, judged_at, judged_positions
from campaigns.planning.paths import RobotModel
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

MIDDLE = Pose(*CENTRE.tolist())
VIEW = plans.View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
TRACKER_MM = np.array(VIEW.tracker_mm)
MODEL, INSTRUMENT = ErrorModel(NOMINAL), TrackerUncertainty()
OPEN = RobotModel(NOMINAL, LIMITS, CENTRE)
JUDGED = judged_positions(MODEL, OPEN, np.zeros((0, 4)))
SHOTS = 60


def planned(shots=SHOTS, seed=1):
    request = plans.PlanRequest(shots, 4, 2, MIDDLE)
    return plans.make_plan(ROBOT, VIEW, request, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def plan():
    return planned()


def foreseen(shots, tracker_mm=TRACKER_MM, instrument=INSTRUMENT, model=MODEL) -> Forecast:
    return forecast(shots, model, tracker_mm, instrument, JUDGED)


def mean_mm(found: Forecast) -> float:
    return float(found.position_std_mm.mean())


def measured(shots, x) -> Observations:
    """The plan's shots measured of a robot and a tracker with errors x (P,), in tolerances."""
    own = [shot.purpose is ShotSet.IDENTIFICATION for shot in shots]
    joints, poses = plans.joints_of(shots)[own], plans.poses_of(shots)[own]
    approach = approach_along(plans.joints_of(shots))[own]
    points = poses[:, :3] - TRACKER_MM
    noise = point_covariance_mm2(points, INSTRUMENT)
    rows = Observations.unmeasured(joints, poses, approach)
    rows = replace(rows, points=points, noise={"stated": noise})
    at = MODEL.predict(x, (Transform(np.eye(3), -TRACKER_MM),), rows, poses)
    rng = np.random.default_rng(4)
    scatter = np.array([rng.multivariate_normal(np.zeros(3), each) for each in noise])
    return replace(rows, points=rows.points + at.residual + scatter)


@pytest.fixture(scope="module")
def fitted(plan):
    """Posterior of a robot as far off as its tolerances say, which scatters by nothing.

    Its geometry, whose tolerances are broad and stay as they are, is off by a fifth of them.
    """
    x = np.random.default_rng(3).standard_normal(len(MODEL.names))
    learned = np.concatenate([*MODEL.learned.values()])
    x[np.setdiff1d(np.arange(len(x)), learned)] *= 0.2
    quiet = Prior(factors={"stated": 1.0, "points": 1e-8, "joints": 1e-8})
    return fit_model(MODEL, measured(plan, x), quiet)


def test_what_a_plan_predicts_is_what_a_fit_of_its_shots_states(plan, fitted) -> None:
    robot = MODEL.kinematics(fitted.x)
    poses = sample_workspace(NOMINAL, LIMITS, CENTRE)
    joints = robot.inverse(poses)
    judged = judged_at(MODEL, robot, joints.values[joints.is_solved], poses[joints.is_solved])
    size = len(MODEL.names)
    stated = length_std(judged, fitted.covariance[:size, :size])
    assert mean_mm(foreseen(plan)) == pytest.approx(stated.mean(), rel=0.1)


def test_parameters_that_no_shot_determines_are_left_out_and_others_have_their_unit(plan) -> None:
    found = foreseen(plan)
    assert found.shots == SHOTS
    assert set(found.std) <= set(MODEL.parameters)
    assert not [name for name in found.std if found.units[name] == "mm" and found.std[name] > 5.0]
    name, std = found.worst("mm")
    assert name.endswith("_mm")
    assert std == max(found.std[own] for own in found.std if own.endswith("_mm"))
    assert found.worst("") is None
    assert all(0.3 <= share <= 0.7 for share in found.from_below)


def test_more_shots_a_nearer_and_a_better_tracker_make_more_known(plan) -> None:
    whole = mean_mm(foreseen(plan))
    assert whole < 0.8 * mean_mm(foreseen(planned(20)))
    far = mean_mm(foreseen(plan, np.array([6000.0, 0.0, -500.0])))
    rough = TrackerUncertainty.of_limits(40.0, 20.0, 60.0, 24.0)
    assert whole < 0.9 * min(far, mean_mm(foreseen(plan, instrument=rough)))


def test_a_robot_that_takes_too_few_of_its_poses_is_refused(plan) -> None:
    p = NOMINAL.p.copy()
    p[NOMINAL.mechanism.parameters.columns["forearm"]] -= 400.0
    robot = Kinematics(NOMINAL.mechanism, p)
    elsewhere = Zone("cabinet", Disc((9000.0, 0.0), 1.0), (0.0, 1.0), keeps_in=True)
    short = RobotModel(robot, LIMITS, CENTRE, RestrictedSpace((elsewhere,)))
    with pytest.raises(ConfigInvalid, match=r"at \d+ of \d+ poses of its workspace \(limit 90 %\)"):
        judged_positions(ErrorModel(robot), short, plans.poses_of(plan))
