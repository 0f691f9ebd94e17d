"""Simulated campaigns a second of one core, by estimator and number of pairs.

python -m benchmarks.study [--rounds N] [--json]

Processor time of one core in the least disturbed of some rounds. By distances alone 22 parameters
need more than 22 pairs; by points fewer do. Exit code 1 when 60 pairs by distances are slower than
100 campaigns a second. What several workers gain: benchmarks.study_workers.
"""

import argparse
import json
import os
import sys
from collections.abc import Mapping

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported: the figures are for one core, as the program itself keeps to

from benchmarks.shared.rounds import Contestant, contestant, least_s, take_turns
from benchmarks.shared.studies import tasks_of
from campaigns.estimation.estimators import Estimator
from campaigns.studies.study import run_task

CAMPAIGNS = 100
"""Each round, of each case."""
Case = tuple[Estimator, int]
"""Estimator and pairs."""
HEADLINE: Case = (Estimator.DISTANCES, 60)
CASES: tuple[Case, ...] = (
    (Estimator.DISTANCES, 30),
    HEADLINE,
    (Estimator.DISTANCES, 120),
    (Estimator.POINTS, 20),
    (Estimator.POINTS, 40),
    (Estimator.POINTS, 60),
    (Estimator.POINTS, 120),
)
LEAST_PER_S = 100.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    taken = take_turns([campaigns_of(*case) for case in CASES], asked.rounds)
    per_s = {case: 1.0 / least_s(runs) for case, runs in zip(CASES, taken, strict=True)}
    if asked.json:
        named = {f"{estimator}_{pairs}_pairs": rate for (estimator, pairs), rate in per_s.items()}
        print(json.dumps({"campaigns_per_s": named, "least": {"distances_60_pairs": LEAST_PER_S}}))
    else:
        show(per_s)
    return int(per_s[HEADLINE] < LEAST_PER_S)


def campaigns_of(estimator: Estimator, pairs: int) -> Contestant[None]:
    """Its cost is that of one campaign."""
    tasks = tasks_of(estimator, pairs, CAMPAIGNS)

    def work() -> None:
        for task in tasks:
            run_task(task)

    return contestant(work, 1, parts=CAMPAIGNS)


def show(per_s: Mapping[Case, float]) -> None:
    for case, rate in per_s.items():
        estimator, pairs = case
        least = f", at least {LEAST_PER_S:g}" if case == HEADLINE else ""
        print(f"{estimator:10} {pairs:4} pairs {rate:7.0f} campaigns/s of one core{least}")


if __name__ == "__main__":
    sys.exit(main())
