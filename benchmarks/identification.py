"""What identification costs: one robot's, the fit while measuring, and campaigns of a study.

python -m benchmarks.identification [--rounds N] [--json]

Processor time of one core in the least disturbed of some rounds. Milliseconds of both estimators on
60 measured pairs, medians of 21, and of the full model, with unequal rods and tilted axes, beside
the 22 parameters; the shots are those of tests/data/vectors/table1-tracker-noise.csv.

Then simulated campaigns a second, by estimator and number of pairs: by distances alone 22
parameters need more than 22 pairs; by points fewer do. Of 60 pairs also by the full model. Where
numba is installed (`[fast]`) those of 22 parameters also by compiled loops, compiled before
anything is measured, and how many times as fast these are: the median of the rounds. What several
workers gain: benchmarks.study_workers. Exit code 1 when a
solution misses its limit, or 60 pairs by distances are slower than 100 campaigns a second.
"""

import math
import statistics
from collections.abc import Iterator
from functools import partial
from types import ModuleType

from benchmarks.shared.measured_robot import MeasuredRobot, by_distances, by_points, measured_robot
from benchmarks.shared.prototype import FREE, FREE_PLACES, NOMINAL, SPACE
from benchmarks.shared.rounds import Contestant, contestant, least_s, ratio, take_turns, timed_s
from benchmarks.shared.studies import tasks_of
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.incremental_fit import IncrementalGaussNewton
from campaigns.estimation.residual_stacks import closure_kernel
from campaigns.studies.estimates import estimated

REPEATS = 21
RUNNING_AT = (20, 60, 160)
FULL = SPACE.places(SPACE.free_in_full)
FULL_OVER_USUAL = 1.6
LIMITS_MS = {"60 distances": 4.0, "120 points": 8.0}
CAMPAIGNS = 400
"""Each round, of each case."""
CASES = (
    *((Estimator.DISTANCES, pairs) for pairs in (30, 60, 120)),
    *((Estimator.POINTS, pairs) for pairs in (20, 40, 60, 120)),
)
LEAST_PER_S = {"60 pairs by distances": 100.0}
COMPILED = ", compiled"


def measure(rounds: int) -> Report:
    robot = measured_robot()
    return Report([*solving(robot, rounds), *running(robot), *studying(rounds)])


def solving(robot: MeasuredRobot, rounds: int) -> Iterator[Figure]:
    estimators = by_distances, by_points
    solves = [partial(solve, robot, free) for free in (FREE_PLACES, FULL) for solve in estimators]
    taken = take_turns([contestant(solve, REPEATS) for solve in solves], rounds)
    usual, full = map(least_s, taken[: len(estimators)]), map(least_s, taken[len(estimators) :])
    for (name, limit), own_s, full_s in zip(LIMITS_MS.items(), usual, full, strict=True):
        yield Figure(f"solution of {name}", 1e3 * own_s, "ms", highest=limit)
        label = f"full model over the 22, {name}"
        yield Figure(label, full_s / own_s, highest=FULL_OVER_USUAL)


def running(robot: MeasuredRobot) -> Iterator[Figure]:
    """What one more shot costs, as the median of the shots around each of `RUNNING_AT`."""
    fit, half, costs_ms = IncrementalGaussNewton(NOMINAL, FREE), REPEATS // 2, []
    for shot in range(max(RUNNING_AT) + half + 1):
        row = shot % len(robot.joints)  # the file has fewer shots: they come round again
        costs_ms.append(1e3 * timed_s(partial(fit.add, robot.joints[row], robot.points_mm[row])))
    for at in RUNNING_AT:
        some = costs_ms[max(0, at - half) : at + half + 1]
        yield Figure(f"one more shot after {at}", statistics.median(some), "ms")


def studying(rounds: int) -> Iterator[Figure]:
    """Campaigns a second, and how many times as many compiled loops do."""
    kernel, contestants = closure_kernel(NOMINAL), dict[str, Contestant[None]]()
    for estimator, pairs in CASES:
        name = f"{pairs} pairs by {estimator}"
        contestants[name] = campaigns_of(estimator, pairs)
        if kernel is not None:
            contestants[name + COMPILED] = campaigns_of(estimator, pairs, kernel=kernel)
            contestants[name + COMPILED]()  # compiles
    for estimator in Estimator:
        name = f"60 pairs by {estimator}, full model"
        contestants[name] = campaigns_of(estimator, 60, SPACE.free_in_full)
    taken = dict(zip(contestants, take_turns([*contestants.values()], rounds), strict=True))
    for name, runs in taken.items():
        least = LEAST_PER_S.get(name, -math.inf)
        yield Figure(name, 1.0 / least_s(runs), "campaigns/s", lowest=least)
        if name + COMPILED in taken:
            times, _, _ = ratio(runs, taken[name + COMPILED])
            yield Figure(f"{name + COMPILED}, over NumPy", times)


def campaigns_of(
    estimator: Estimator, pairs: int, free: tuple[str, ...] = FREE, kernel: ModuleType | None = None
) -> Contestant[None]:
    """Its cost is that of one campaign."""
    tasks = tasks_of(estimator, pairs, CAMPAIGNS, free, is_long=kernel is not None)

    def work() -> None:
        for task in tasks:
            estimated(task, kernel)

    return contestant(work, 1, parts=CAMPAIGNS)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, rounds=3))
