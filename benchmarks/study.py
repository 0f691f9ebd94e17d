"""Simulated campaigns a second of one core, by estimator and number of pairs.

python -m benchmarks.study [--rounds N] [--json]

Processor time of one core in the least disturbed of some rounds. By distances alone 22 parameters
need more than 22 pairs; by points fewer do. Exit code 1 when 60 pairs by distances are slower than
100 campaigns a second. What several workers gain: benchmarks.study_workers.
"""

from benchmarks.shared.rounds import Contestant, contestant, least_s, take_turns
from benchmarks.shared.studies import tasks_of
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.estimation.estimators import Estimator
from campaigns.studies.engine import run_task

CAMPAIGNS = 100
"""Each round, of each case."""
HEADLINE = (Estimator.DISTANCES, 60)
CASES = (
    *((Estimator.DISTANCES, pairs) for pairs in (30, 60, 120)),
    *((Estimator.POINTS, pairs) for pairs in (20, 40, 60, 120)),
)
LEAST_PER_S = {HEADLINE: 100.0}


def measure(rounds: int) -> Report:
    taken = take_turns([campaigns_of(*case) for case in CASES], rounds)
    return Report(
        [
            Figure(
                f"{pairs} pairs by {estimator}",
                1.0 / least_s(runs),
                "campaigns/s",
                lowest=LEAST_PER_S.get((estimator, pairs), float("-inf")),
            )
            for (estimator, pairs), runs in zip(CASES, taken, strict=True)
        ]
    )


def campaigns_of(estimator: Estimator, pairs: int) -> Contestant[None]:
    """Its cost is that of one campaign."""
    tasks = tasks_of(estimator, pairs, CAMPAIGNS)

    def work() -> None:
        for task in tasks:
            run_task(task)

    return contestant(work, 1, parts=CAMPAIGNS)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, rounds=3))
