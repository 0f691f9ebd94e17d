"""The study that tests draw campaigns of: 80 shots, 22 parameters."""

import numpy as np
from par4_space import SPACE

from campaigns.api import sample_workspace
from campaigns.estimation.rigid_transforms import Transform, small_rotation
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.robots.robot import find_robot
from campaigns.studies.study import StudySetup, identification_shots, planned_shots
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
NOMINAL = ROBOT.kinematics
FREE = SPACE.places(SPACE.free_by_default)
STD = np.where(SPACE.is_angle[FREE], np.radians(0.1), 0.5)
TRACKER = Transform(small_rotation(np.array([2.1, 0.02, -0.03]))[0], np.array([2500.0, 400.0, 0.0]))


def plan():
    """Shots to identify from."""
    view = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
    request = PlanRequest(80, 5, 2, Pose(0.0, 0.0, -575.0, 0.0))
    return identification_shots(make_plan(ROBOT, view, request, np.random.default_rng(1)))


def setup_of(shots, instrument):
    return StudySetup(
        nominal=NOMINAL,
        shots=planned_shots(shots),
        free=SPACE.free_by_default,
        instrument=instrument,
        tracker_from_base=TRACKER,
        workspace=sample_workspace(ROBOT),
        seed=3,
    )


def robots(count, seed=5):
    """Parameter vectors (count, G) of true robots."""
    p = np.tile(NOMINAL.p, (count, 1))
    p[:, FREE] += STD * np.random.default_rng(seed).standard_normal((count, len(FREE)))
    return p
