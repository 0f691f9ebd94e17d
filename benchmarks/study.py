"""Simulated campaigns a second: on one core by estimator and shots, and with more workers.

python benchmarks/study.py [--campaigns N] [--workers N] [--json]

Exit code 1 when 60 pairs by distances are slower than 100 campaigns a second on one core, or the
workers reach less than 0.9 of their number's gain; for that, so many cores have to be free.
"""

import argparse
import json
import os
import sys
import time
from collections.abc import Sequence

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported: the figures are for one core a worker, as the program itself keeps to

import numpy as np

from app.study.setup import study_tasks, uncertainty_of
from app.study.workers import local_results
from campaigns.numerics.frames import Transform
from campaigns.numerics.geometry import FREE_BY_DEFAULT
from campaigns.plan_file import PlannedShot
from campaigns.planning import PlanRequest, View, joints_of, make_plan, numeric_geometry, pairs_of
from campaigns.robot import find_robot
from campaigns.shot_sets import ShotSet
from campaigns.study import Estimator, PairedShots, StudySetup, StudyTask, run_task
from drivers.values import Pose
from sim.scenario import load_scenario

SCENARIO = load_scenario("paper-simulation")
VIEW = View((2500.0, 0.0, -575.0), (1.0, 0.0, 0.0), np.pi)
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
ONE_CORE = 200
"""Campaigns for a figure of one core."""
HEADLINE: tuple[Estimator, int] = ("distances", 120)
CASES: tuple[tuple[Estimator, int], ...] = (
    ("distances", 60),
    ("distances", 120),
    ("distances", 240),
    ("points", 60),
    ("points", 120),
    ("points", 240),
)
LEAST_PER_S = 100.0
LEAST_GAIN_A_WORKER = 0.9


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--campaigns", type=int, default=4000, help="to compare workers by")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    per_s = {case: one_core_per_s(*case) for case in CASES}
    gain = workers_gain(asked.campaigns, asked.workers)
    if asked.json:
        named = {f"{estimator}_{shots}_shots": rate for (estimator, shots), rate in per_s.items()}
        print(json.dumps({"campaigns_per_s": named, "workers": asked.workers, "gain": gain}))
    else:
        for (estimator, shots), rate in per_s.items():
            print(f"{estimator:10} {shots:4} shots {rate:7.0f} campaigns/s on one core")
        print(f"{asked.workers} workers: {gain:.2f} times as fast as one")
    fast = per_s[HEADLINE] >= LEAST_PER_S and gain >= LEAST_GAIN_A_WORKER * asked.workers
    return 0 if fast else 1


def one_core_per_s(estimator: Estimator, shots: int) -> float:
    """By this process's own time, which others on the same core do not count in."""
    (*tasks,) = study_tasks(setup_of(estimator, shots), SCENARIO, range(ONE_CORE))
    began_s = time.process_time()
    for task in tasks:
        run_task(task)
    return ONE_CORE / (time.process_time() - began_s)


def workers_gain(campaigns: int, workers: int) -> float:
    """How many times faster than one, starting the processes included."""
    tasks = list(study_tasks(setup_of(*HEADLINE), SCENARIO, range(campaigns)))
    return wall_s(tasks, 1) / wall_s(tasks, workers)


def wall_s(tasks: Sequence[StudyTask], workers: int) -> float:
    began_s = time.perf_counter()
    for _ in local_results(tasks, workers):
        pass
    return time.perf_counter() - began_s


def setup_of(estimator: Estimator, shots: int) -> StudySetup:
    robot = find_robot("par4-prototype").robot
    request = PlanRequest(shots, 20, 2, CENTRE)
    plan = make_plan(robot, VIEW, request, np.random.default_rng(1))
    return StudySetup(
        numeric_geometry(robot),
        FREE_BY_DEFAULT,
        estimator,
        paired(plan, ShotSet.IDENTIFICATION),
        paired(plan, ShotSet.VALIDATION),
        Transform(np.eye(3), -np.array(VIEW.tracker_mm)),
        uncertainty_of(SCENARIO.tracker.noise),
        seed=1,
    )


def paired(plan: Sequence[PlannedShot], purpose: ShotSet) -> PairedShots:
    shots = [shot for shot in plan if shot.purpose is purpose]
    return PairedShots(joints_of(shots), pairs_of(shots, purpose))


if __name__ == "__main__":
    sys.exit(main())
