"""Simulated campaigns a second of one core, by estimator and number of pairs.

python -m benchmarks.study [--rounds N] [--json]

Processor time of one core in the least disturbed of some rounds. By distances alone 22 parameters
need more than 22 pairs; by points fewer do. Where numba is installed (`[fast]`) also by compiled
loops, compiled before anything is measured, and how many times as fast these are: the median of the
rounds. Exit code 1 when 60 pairs by distances are slower than 100 campaigns a second. What several
workers gain: benchmarks.study_workers.
"""

from types import ModuleType

from benchmarks.shared.prototype import NOMINAL
from benchmarks.shared.rounds import Contestant, Run, contestant, least_s, ratio, take_turns
from benchmarks.shared.studies import tasks_of
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.residual_stacks import closure_kernel
from campaigns.studies.estimates import estimated

CAMPAIGNS = 400
"""Each round, of each case."""
HEADLINE = (Estimator.DISTANCES, 60)
CASES = (
    *((Estimator.DISTANCES, pairs) for pairs in (30, 60, 120)),
    *((Estimator.POINTS, pairs) for pairs in (20, 40, 60, 120)),
)
LEAST_PER_S = {HEADLINE: 100.0}


def measure(rounds: int) -> Report:
    kernel = closure_kernel(NOMINAL)
    ways = [None] if kernel is None else [None, kernel]
    contestants = [campaigns_of(*case, way) for case in CASES for way in ways]
    for contender in contestants if kernel else ():
        contender()  # compiles
    taken = take_turns(contestants, rounds)
    by_case = [taken[place : place + len(ways)] for place in range(0, len(taken), len(ways))]
    return Report([each for case in zip(CASES, by_case, strict=True) for each in figures(*case)])


def figures(case: tuple[Estimator, int], taken: list[list[Run[None]]]) -> list[Figure]:
    """Rates by NumPy and compiled, and their ratio."""
    name, least = f"{case[1]} pairs by {case[0]}", LEAST_PER_S.get(case, float("-inf"))
    by_numpy, *compiled = taken
    found = [Figure(name, 1.0 / least_s(by_numpy), "campaigns/s", lowest=least)]
    for runs in compiled:
        found.append(Figure(f"{name}, compiled", 1.0 / least_s(runs), "campaigns/s"))
        found.append(Figure(f"{name}, compiled", ratio(by_numpy, runs)[0], "× as fast"))
    return found


def campaigns_of(estimator: Estimator, pairs: int, kernel: ModuleType | None) -> Contestant[None]:
    """Its cost is that of one campaign."""
    tasks = tasks_of(estimator, pairs, CAMPAIGNS, is_long=kernel is not None)

    def work() -> None:
        for task in tasks:
            estimated(task, kernel)

    return contestant(work, 1, parts=CAMPAIGNS)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, rounds=3))
