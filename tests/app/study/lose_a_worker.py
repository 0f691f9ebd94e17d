"""A study, and forty campaigns one of which kills whoever computes it, by processes or a cluster.

Says as JSON how the study ended, which of the forty came back, and which were lost. In a process of
its own, since the machinery that watches over workers lives until the end of the one that began it.

    lose_a_worker.py local|cluster CAMPAIGN TABLES
"""

import json
import sys

import numpy as np
from poisoned_work import work

from app.main import run_command
from app.study.workers import workers_of
from campaigns.studies.study import StudyTask

COUNT = 60
"""Campaigns of the study: three tasks."""


def told(workers):
    tasks = [StudyTask(None, (n, n + 1), np.empty((2, 29))) for n in range(0, 40, 2)]
    back, lost, reasons = [], [], []
    for result in workers_of(workers)(tasks, work=work):
        back += [row.campaign for row in result.rows]
        if result.lost:
            lost += tasks[result.place].numbers
            reasons.append(result.lost)
    return {"back": sorted(back), "lost": sorted(lost), "reasons": sorted(reasons)}


def both(workers):
    folder, tables = sys.argv[2:]
    options = ("--campaigns", str(COUNT), "--workers", workers, "--to", tables)
    code = run_command(["study", folder, *options])
    return {"code": code, "told": told(workers)}


def main():
    document = both("2") if sys.argv[1] == "local" else on_a_cluster()
    sys.stderr.write(json.dumps(document) + "\n")


def on_a_cluster():
    """Workers that have died once each are perhaps not started again: one is left in any case."""
    import dask
    from distributed import LocalCluster

    dask.config.set({"distributed.scheduler.allowed-failures": 0})
    room = {"n_workers": 3, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with LocalCluster(**room) as cluster:
        return both(cluster.scheduler_address)


if __name__ == "__main__":
    main()
