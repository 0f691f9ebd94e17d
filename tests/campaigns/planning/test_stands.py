"""Stands of the tracker: what a plan tells from each, and what hides its shots."""

import numpy as np
import pytest
from par4_space import SPACE

from campaigns.design.pose_sampling import sample_workspace
from campaigns.design.restricted_space import UNRESTRICTED, Disc, RestrictedSpace, Zone
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import WorkspaceSample
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.planning.plans import PlanRequest, View, make_plan, poses_of
from campaigns.planning.predicted_uncertainty import EstimationSetup, predicted_uncertainty
from campaigns.planning.stands import best_stand, compare_stands, places_about
from campaigns.robots.robot import find_robot
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
CENTRE = np.array([0.0, 0.0, -575.0])
VIEW = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(40.0))
SETUP = EstimationSetup(Estimator.POINTS, SPACE.free_by_default, TrackerUncertainty())


@pytest.fixture(scope="module")
def shots():
    request = PlanRequest(40, 4, 2, Pose(0.0, 0.0, -575.0, 0.0))
    return make_plan(ROBOT, VIEW, request, np.random.default_rng(1))


@pytest.fixture(scope="module")
def sample():
    poses = sample_workspace(ROBOT.kinematics, ROBOT.limits, np.append(CENTRE, 0.0))
    return WorkspaceSample.of(ROBOT.kinematics, SPACE.free_by_default, poses)


def compared(shots, sample, places, facing=None, space=UNRESTRICTED):
    return compare_stands(
        shots, ROBOT.kinematics, VIEW, places, facing, space, SETUP, sample, CENTRE
    )


def test_a_nearer_stand_tells_more_and_each_as_a_plan_from_there_does(shots, sample):
    places = places_about(CENTRE, -500.0)[:6]
    stands = compared(shots, sample, places)
    told = [stand.position_std_mm for stand in stands]
    assert told == sorted(told)
    assert told[0] < 0.8 * told[-1]
    predicted, _ = predicted_uncertainty(shots, ROBOT.kinematics, places[3], SETUP)
    assert told[3] == pytest.approx(predicted.of_positions(sample).max())
    assert {stand.unseen for stand in stands} == {0}
    assert best_stand(stands) == stands[0]
    assert (stands[2].direction_deg, stands[2].distance_mm) == (0.0, pytest.approx(2500.0))


def test_a_reflector_that_looks_away_is_not_seen(shots, sample):
    places = np.array([[2500.0, 0.0, -500.0], [-2500.0, 0.0, -500.0]])
    before, behind = compared(shots, sample, places, facing=(1.0, 0.0, 0.0))
    assert before.unseen == 0
    assert behind.unseen == len(shots)
    assert behind.position_std_mm == np.inf
    assert best_stand((behind, before)) == before


def test_a_pillar_in_the_beam_hides_the_shots_behind_it(shots, sample):
    pillar = Zone("pillar", Disc((1200.0, 0.0), 60.0), (-np.inf, np.inf), keeps_in=False)
    space = RestrictedSpace((pillar,), plate_radius_mm=100.0)
    places = np.array([[2500.0, 0.0, -500.0], [0.0, 2500.0, -500.0]])
    hidden, free = compared(shots, sample, places, space=space)
    assert free.unseen == 0
    # seen from above, the beam passes the pillar's axis by its radius or less
    points = poses_of(shots)[:, :2]
    towards = (points - places[0, :2]) / np.linalg.norm(points - places[0, :2], axis=1)[:, None]
    aside = np.abs(towards[:, 1] * (1200.0 - 2500.0))
    assert hidden.unseen == (aside < 60.0).sum() > 5
    assert hidden.position_std_mm > free.position_std_mm
