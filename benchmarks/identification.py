"""What identification costs: both estimators on 60 measured pairs, and the fit while measuring.

The full model, with unequal rods and tilted axes, beside the 22 parameters.

python -m benchmarks.identification [--rounds N] [--json]

Milliseconds of one core: medians of 21, of the least disturbed of some rounds. The shots are those
of tests/data/vectors/table1-tracker-noise.csv. Exit code 1 when a solution misses its limit.
"""

import statistics
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


def solving(robot: MeasuredRobot, rounds: int) -> list[Figure]:
    estimators = by_distances, by_points
    solves = [partial(solve, robot, free) for free in (FREE_PLACES, FULL) for solve in estimators]
    taken_ms = [
        1e3 * least_s(runs)
        for runs in take_turns([contestant(solve, REPEATS) for solve in solves], rounds)
    ]
    usual, full = taken_ms[: len(estimators)], taken_ms[len(estimators) :]
    return [
        *(
            Figure(f"solution of {name}", ms, "ms", highest=limit)
            for (name, limit), ms in zip(LIMITS_MS.items(), usual, strict=True)
        ),
        *(
            Figure(f"full model over the 22, {name}", more / ms, highest=FULL_OVER_USUAL)
            for name, more, ms in zip(LIMITS_MS, full, usual, strict=True)
        ),
    ]


def running(robot: MeasuredRobot) -> list[Figure]:
    """What one more shot costs, as the median of the shots around each of `RUNNING_AT`."""
    fit, half, costs_ms = IncrementalGaussNewton(NOMINAL, FREE), REPEATS // 2, []
    for shot in range(max(RUNNING_AT) + half + 1):
        row = shot % len(robot.joints)  # the file has fewer shots: they come round again
        costs_ms.append(1e3 * timed_s(partial(fit.add, robot.joints[row], robot.points_mm[row])))
    around = {at: costs_ms[max(0, at - half) : at + half + 1] for at in RUNNING_AT}
    return [
        Figure(f"one more shot after {at}", statistics.median(some), "ms")
        for at, some in around.items()
    ]


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, rounds=5))
