"""Runs what is missing in tables of results: it goes to workers, and what comes back is kept."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Generic

from app.progress import CountedWork
from app.study.combinations import Combination
from app.study.results import Lost, Outcome, Task, Work, Workers
from app.study.setup import study_tasks
from campaigns.studies.store import Key, ResultTable
from campaigns.studies.study import CampaignOutcome, StudyTask, run_task

Counting = Callable[[int, int], CountedWork]
"""Shows how far it is, for so many campaigns or seeds in all and so many done before."""


@dataclass(frozen=True, slots=True, eq=False)
class Job(Generic[Task]):
    """Task, in which of several tables its outcomes belong, and how many they are to be."""

    table: int
    task: Task
    count: int


def run_jobs(
    jobs: Sequence[Job[Task]],
    work: Work[Task, Outcome],
    workers: Workers,
    tables: Sequence[ResultTable[Key, Outcome]],
    known: Sequence[dict[Key, Outcome]],
    counted: CountedWork,
) -> tuple[tuple[Job[Task], str], ...]:
    """Compute jobs, keep outcomes as they come, sort the tables at the end; gives what is lost.

    `known` is what the tables hold, and is kept so. Raises `OptionsInvalid` before anything is
    written, and `WriteFailed`; what had come back until then is kept.
    """
    lost: list[tuple[Job[Task], str]] = []
    results = workers([job.task for job in jobs], work=work)
    with closing(results), counted:
        _write(tables, known)
        for result in results:
            job = jobs[result.place]
            if isinstance(result, Lost):
                lost.append((job, result.reason))
                counted.news = f"{sum(job.count for job, _ in lost)} lost"
            else:
                table = tables[job.table]
                table.append(result.outcomes)
                known[job.table].update((table.key_of(each), each) for each in result.outcomes)
            counted.advance(job.count)
    _write(tables, known)
    return tuple(lost)


def _write(
    tables: Sequence[ResultTable[Key, Outcome]], known: Sequence[dict[Key, Outcome]]
) -> None:
    for table, outcomes in zip(tables, known, strict=True):
        table.write(outcomes)


@dataclass(frozen=True, slots=True, eq=False)
class Studied:
    """All outcomes of a combination, by number, and how many were lost on the way."""

    combination: Combination
    outcomes: tuple[CampaignOutcome, ...]
    computed: int
    """How many of them were not in the table before."""
    lost: int
    reasons: tuple[str, ...]
    """Why, each one once."""


def run_study(
    combinations: Sequence[Combination], wanted: range, workers: Workers, counting: Counting
) -> tuple[Studied, ...]:
    """Compute what the tables lack of the wanted campaigns.

    Raises `OptionsInvalid`, `OutputExists` and `WriteFailed`; what had come back until then is
    kept.
    """
    tables = [combination.table for combination in combinations]
    known = [table.read() for table in tables]
    begun = [len(each) for each in known]
    jobs = list(_jobs(combinations, known, wanted))
    total = len(combinations) * len(wanted)
    counted = counting(total, total - sum(job.count for job in jobs))
    lost = run_jobs(jobs, run_task, workers, tables, known, counted)
    return tuple(
        Studied(
            combination,
            tuple(known[place][number] for number in wanted if number in known[place]),
            len(known[place]) - begun[place],
            sum(job.count for job, _ in lost if job.table == place),
            tuple(dict.fromkeys(reason for job, reason in lost if job.table == place)),
        )
        for place, combination in enumerate(combinations)
    )


def _jobs(
    combinations: Sequence[Combination], known: Sequence[dict[int, CampaignOutcome]], wanted: range
) -> Iterator[Job[StudyTask]]:
    for place, (combination, there) in enumerate(zip(combinations, known, strict=True)):
        missing = (number for number in wanted if number not in there)
        for task in study_tasks(combination.setup, combination.scenario, missing):
            yield Job(place, task, len(task.numbers))
