"""Runs what tables of results lack: it goes to workers, and what comes back is kept."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Generic

from app.progress import CountedWork
from app.study.results import Portion, Task, Work, Workers
from app.study.setup import Combination, numbers_of_tasks, simulated
from campaigns.studies.engine import ResultTable, Row
from campaigns.studies.study import CampaignRow

Counting = Callable[[int, int], CountedWork]
"""Shows how far it is, for so many campaigns or seeds in all and so many done before."""


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

    Raises `OptionsInvalid` before anything is written, and `WriteFailed`; what had come back until
    then is kept.
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


@dataclass(frozen=True, slots=True, eq=False)
class Studied:
    """The wanted campaigns of a combination, and how many were lost on the way."""

    combination: Combination
    wanted: range
    computed: int
    """How many of them were not in the table before."""
    lost: int
    reasons: tuple[str, ...]
    """Why, each one once."""

    @property
    def rows(self) -> Iterator[CampaignRow]:
        """Rows by number, each read from the table when it is asked for."""
        return self.rows_of(self.wanted)

    def rows_of(self, numbers: Iterable[int]) -> Iterator[CampaignRow]:
        """Rows of these campaigns as far as there are any, as `rows`."""
        table = self.combination.table
        return table.rows(number for number in numbers if number in table.places)


def run_study(
    combinations: Sequence[Combination], wanted: range, workers: Workers, counting: Counting
) -> tuple[Studied, ...]:
    """Compute what the tables lack of the wanted campaigns.

    Raises `OptionsInvalid`, `OutputExists` and `WriteFailed`; what had come back until then is
    kept.
    """
    tables = [combination.table for combination in combinations]
    begun = [len(table.read()) for table in tables]
    jobs = [
        Job(each.table, Portion(common, some), len(some))
        for each in combinations
        for common in [(each.setup, each.scenario)]
        for some in numbers_of_tasks(each.setup, (n for n in wanted if n not in each.table.places))
    ]
    total = len(combinations) * len(wanted)
    counted = counting(total, total - sum(job.count for job in jobs))
    lost = run_jobs(jobs, simulated, workers, tables, counted)
    studied = []
    for each, before in zip(combinations, begun, strict=True):
        own = [(job.count, reason) for job, reason in lost if job.table is each.table]
        studied.append(
            Studied(
                each,
                wanted,
                len(each.table.places) - before,
                sum(count for count, _ in own),
                tuple(dict.fromkeys(reason for _, reason in own)),
            )
        )
    return tuple(studied)
