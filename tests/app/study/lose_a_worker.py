"""Forty campaigns, one of which kills whoever computes it: local processes, or a Dask cluster.

Says as JSON which campaigns came back, and which were lost. In a process of its own, since the
machinery that watches over workers lives until the end of the one that started it.
"""

import json
import sys

import numpy as np
from poisoned_work import work

from app.study.workers import Lost, cluster_results, local_results
from campaigns.study import StudyTask


def told(results):
    back, lost = [], []
    for result in results:
        if isinstance(result, Lost):
            lost += result.numbers
        else:
            back += [outcome.number for outcome in result]
    return {"back": sorted(back), "lost": lost}


def main():
    tasks = [StudyTask(None, (n, n + 1), np.empty((2, 29))) for n in range(0, 40, 2)]
    if sys.argv[1] == "local":
        document = told(local_results(tasks, 2, work))
    else:
        from distributed import LocalCluster

        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
            document = told(cluster_results(tasks, cluster.scheduler_address, work))
    sys.stdout.write(json.dumps(document))


if __name__ == "__main__":
    main()
