"""What identification costs: one robot's, and the fit while measuring.

python -m benchmarks.identification [--rounds N] [--json]

Processor time of one core in the least disturbed of some rounds. Milliseconds of both estimators on
60 measured pairs, medians of 21, and of the full model, with unequal rods and tilted axes, beside
the 22 parameters; the shots are those of tests/data/vectors/table1-tracker-noise.csv.

Exit code 1 when a solution misses its limit.
"""

import statistics
from collections.abc import Iterator
from functools import partial

from benchmarks.shared.measured_robot import MeasuredRobot, by_distances, by_points, measured_robot
from benchmarks.shared.prototype import FREE, FREE_PLACES, NOMINAL, SPACE
from benchmarks.shared.rounds import contestant, least_s, take_turns, timed_s
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.estimation.incremental_fit import IncrementalGaussNewton

REPEATS = 21
RUNNING_AT = (20, 60, 160)
FULL = SPACE.places(SPACE.free_in_full)
FULL_OVER_USUAL = 1.6
LIMITS_MS = {"60 distances": 4.0, "120 points": 8.0}


def measure(rounds: int) -> Report:
    robot = measured_robot()
    return Report([*solving(robot, rounds), *running(robot)])


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


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, rounds=3))
