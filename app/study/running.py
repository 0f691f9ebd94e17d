"""Runs a study: what is missing goes to the workers, what comes back goes into the tables."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass

from app.progress import CountedWork
from app.study.combinations import Combination
from app.study.results import Lost, Result, ResultsOf
from app.study.setup import study_tasks
from campaigns.studies.study import CampaignOutcome, StudyTask

Counting = Callable[[int, int], CountedWork]
"""Shows how far it is, for so many campaigns in all and so many done before."""
Known = dict[int, CampaignOutcome]
"""Outcomes by number."""


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


@dataclass(frozen=True, slots=True, eq=False)
class _Job:
    """A task, and in which combination's table its outcomes belong."""

    combination: int
    task: StudyTask


def run_study(
    combinations: Sequence[Combination], wanted: range, results_of: ResultsOf, counting: Counting
) -> tuple[Studied, ...]:
    """Compute what the tables lack of the wanted campaigns, and sort the tables at the end.

    Raises `OptionsInvalid`, `OutputExists` and `WriteFailed`; what had come back until then is
    kept.
    """
    known = [combination.table.read() for combination in combinations]
    begun = [len(each) for each in known]
    jobs = list(_jobs(combinations, known, wanted))
    results = results_of([job.task for job in jobs])
    _write(combinations, known)
    total, missing = len(combinations) * len(wanted), sum(len(job.task.numbers) for job in jobs)
    with closing(results), counting(total, total - missing) as counted:
        lost = list(_kept(results, jobs, combinations, known, counted))
    _write(combinations, known)
    return tuple(
        Studied(
            combination,
            tuple(known[place][number] for number in wanted if number in known[place]),
            len(known[place]) - begun[place],
            *_lost_of(place, jobs, lost),
        )
        for place, combination in enumerate(combinations)
    )


def _kept(
    results: Iterator[Result],
    jobs: Sequence[_Job],
    combinations: Sequence[Combination],
    known: Sequence[Known],
    counted: CountedWork,
) -> Iterator[Lost]:
    """Write what comes into tables, as it comes; gives what is lost."""
    for result in results:
        task, place = jobs[result.place].task, jobs[result.place].combination
        if isinstance(result, Lost):
            yield result
        else:
            combinations[place].table.append(result.outcomes)
            known[place].update((outcome.number, outcome) for outcome in result.outcomes)
        counted.advance(len(task.numbers))


def _jobs(
    combinations: Sequence[Combination], known: Sequence[Known], wanted: range
) -> Iterator[_Job]:
    for place, (combination, there) in enumerate(zip(combinations, known, strict=True)):
        missing = (number for number in wanted if number not in there)
        for task in study_tasks(combination.setup, combination.scenario, missing):
            yield _Job(place, task)


def _write(combinations: Sequence[Combination], known: Sequence[Known]) -> None:
    for combination, outcomes in zip(combinations, known, strict=True):
        combination.table.write(outcomes)


def _lost_of(place: int, jobs: Sequence[_Job], lost: Sequence[Lost]) -> tuple[int, tuple[str, ...]]:
    """How many campaigns of a combination were lost, and why."""
    own = [each for each in lost if jobs[each.place].combination == place]
    campaigns = sum(len(jobs[each.place].task.numbers) for each in own)
    return campaigns, tuple(dict.fromkeys(each.reason for each in own))
