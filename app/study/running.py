"""Runs what tables of results lack: it goes to workers, and what comes back is kept."""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Generic

from app.progress import CountedWork
from app.study.results import Task, Work, Workers
from campaigns.studies.engine import ResultTable, Row


@dataclass(frozen=True, slots=True, eq=False)
class Job(Generic[Task, Row]):
    """Task, the table in which its rows belong, and how many they are to be."""

    table: ResultTable[Row]
    task: Task
    count: int = 1


def run_jobs(
    jobs: Sequence[Job[Task, Row]],
    work: Work[Task, Row],
    workers: Workers,
    tables: Sequence[ResultTable[Row]],
    counted: CountedWork,
) -> tuple[tuple[Job[Task, Row], str], ...]:
    """Compute jobs, keep rows as they come, sort the tables at the end; gives what is lost, why.

    Raises `WriteFailed`; what had come back until then is kept.
    """
    lost: list[tuple[Job[Task, Row], str]] = []
    results = workers([job.task for job in jobs], work=work)
    with closing(results), counted:
        for table in tables:
            table.write()
        for result in results:
            job = jobs[result.place]
            if result.lost:
                lost.append((job, result.lost))
                counted.news = f"{sum(job.count for job, _ in lost)} lost"
            job.table.add(result.rows)
            counted.advance(job.count)
    for table in tables:
        table.write()
    return tuple(lost)
