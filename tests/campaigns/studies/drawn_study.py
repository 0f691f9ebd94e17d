"""The study that tests draw campaigns of: 60 shots of the prototype."""

from functools import cache

import numpy as np

from campaigns.api import sample_workspace
from campaigns.fit.rigid_transforms import from_paper_angles
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.identification.options import IdentificationOptions
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.robots.robot import find_robot
from campaigns.studies.study import StudySetup, planned_shots
from drivers.values import Pose

ROBOT = find_robot("par4-prototype").robot
TRACKER = from_paper_angles(np.array([0.02, -0.03, 2.1]), np.array([2500.0, 400.0, 0.0]))


@cache
def study_setup():
    view = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), np.radians(25.0))
    request = PlanRequest(60, 5, 2, Pose(0.0, 0.0, -575.0, 0.0))
    shots = make_plan(ROBOT, view, request, np.random.default_rng(1))
    return StudySetup(
        nominal=ROBOT.kinematics,
        shots=planned_shots(shots),
        options=IdentificationOptions(instrument=TrackerUncertainty(0.009, 0.0, 0.009, 0.0)),
        tracker_from_base=TRACKER,
        workspace=sample_workspace(ROBOT, 60),
        seed=3,
    )
