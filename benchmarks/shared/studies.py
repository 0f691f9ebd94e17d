"""The studies that throughput is measured by: par4-prototype by the paper's simulation."""

import numpy as np

from app.study.setup import study_tasks, uncertainty_of
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.rigid_transforms import Transform
from campaigns.identification.options import IdentificationOptions
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.robots.robot import find_robot
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.study import StudySetup, StudyTask, planned_shots
from drivers.values import Pose
from sim.scenarios.scenario import load_scenario

SCENARIO = load_scenario("paper-simulation")
VIEW = View((2500.0, 0.0, -575.0), (1.0, 0.0, 0.0), np.pi)
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
UNSEEN_PAIRS, DRIFT_SHOTS = 20, 2


def tasks_of(estimator: Estimator, pairs: int, campaigns: int) -> list[StudyTask]:
    """So many campaigns of a study with so many fitted pairs."""
    return list(study_tasks(_setup(estimator, pairs), SCENARIO, range(campaigns)))


def _setup(estimator: Estimator, pairs: int) -> StudySetup:
    robot = find_robot("par4-prototype").robot
    request = PlanRequest(2 * pairs, UNSEEN_PAIRS, DRIFT_SHOTS, CENTRE)
    plan = make_plan(robot, VIEW, request, np.random.default_rng(1))
    instrument = uncertainty_of(SCENARIO.tracker.noise)
    return StudySetup(
        nominal=robot.kinematics,
        shots=planned_shots([shot for shot in plan if shot.purpose is not ShotSet.DRIFT]),
        free=robot.mechanism.parameters.free_by_default,
        options=IdentificationOptions(estimator=estimator, instrument=instrument),
        tracker_from_base=Transform(np.eye(3), -np.array(VIEW.tracker_mm)),
        seed=1,
    )
