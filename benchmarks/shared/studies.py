"""The studies that throughput is measured by: par4-prototype by the paper's simulation."""

import numpy as np

from app.study.setup import study_tasks, uncertainty_of
from benchmarks.shared.prototype import CENTRE, EVERYWHERE, FREE, ROBOT
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.rigid_transforms import Transform
from campaigns.identification.options import IdentificationOptions
from campaigns.planning.plans import PlanRequest, make_plan
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.study import StudySetup, StudyTask, planned_shots
from sim.scenarios.scenario import load_scenario

SCENARIO = load_scenario("paper-simulation")
UNSEEN_PAIRS, DRIFT_SHOTS = 20, 2


def tasks_of(estimator: Estimator, pairs: int, campaigns: int) -> list[StudyTask]:
    """So many campaigns of a study with so many fitted pairs."""
    request = PlanRequest(2 * pairs, UNSEEN_PAIRS, DRIFT_SHOTS, CENTRE)
    plan = make_plan(ROBOT, EVERYWHERE, request, np.random.default_rng(1))
    instrument = uncertainty_of(SCENARIO.tracker.noise)
    setup = StudySetup(
        nominal=ROBOT.kinematics,
        shots=planned_shots([shot for shot in plan if shot.purpose is not ShotSet.DRIFT]),
        free=FREE,
        options=IdentificationOptions(estimator=estimator, instrument=instrument),
        tracker_from_base=Transform(np.eye(3), -np.array(EVERYWHERE.tracker_mm)),
        seed=1,
    )
    return list(study_tasks(setup, SCENARIO, range(campaigns)))
