"""Runs a study: what is missing goes to the workers, what comes back goes into the table."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from app.errors import UsageInvalid
from app.study.setup import study_tasks
from app.study.workers import Lost, Result, cluster_results, local_results
from campaigns.study import CampaignOutcome, StudySetup, StudyTask
from campaigns.study_table import StudyTable
from sim.scenario_schema import Scenario

SCHEDULER = ("tcp://", "tls://", "ucx://")
TELL_EVERY_S = 2.0

Tell = Callable[[str], None]


@dataclass(frozen=True, slots=True, eq=False)
class Studied:
    """All outcomes, by number, and what was lost on the way."""

    outcomes: tuple[CampaignOutcome, ...]
    lost: tuple[Lost, ...]
    computed: int
    """How many of them were not in the table before."""
    seconds: float


def run_study(
    setup: StudySetup,
    scenario: Scenario,
    table: StudyTable,
    wanted: range,
    workers: str,
    tell: Tell,
) -> Studied:
    """Compute what the table lacks of the wanted campaigns, and sort the table at the end.

    Raises `UsageInvalid`, `OutputExists` and `WriteFailed`; what had come back until then is kept.
    """
    results_of = workers_of(workers)
    known = table.read()
    tasks = list(study_tasks(setup, scenario, (n for n in wanted if n not in known)))
    results = results_of(tasks)
    table.write(known)
    began, lost = len(known), []
    pace = _Pace(sum(len(task.numbers) for task in tasks), tell)
    for result in results:
        if isinstance(result, Lost):
            lost.append(result)
            continue
        table.append(result)
        known |= {outcome.number: outcome for outcome in result}
        pace.done(len(known) - began)
    table.write(known)
    outcomes = tuple(known[number] for number in wanted if number in known)
    return Studied(outcomes, tuple(lost), len(known) - began, pace.seconds)


def workers_of(text: str) -> Callable[[Sequence[StudyTask]], Iterator[Result]]:
    """Local processes for a number, a cluster for its scheduler's address.

    Raises `UsageInvalid` for anything else.
    """
    if text.startswith(SCHEDULER):
        return lambda tasks: cluster_results(tasks, text)
    if text.isascii() and text.isdecimal() and int(text) > 0:
        return lambda tasks: local_results(tasks, int(text))
    raise UsageInvalid(
        f"--workers is '{text}'",
        remedy="give a number of local processes, or the scheduler's address as tcp://HOST:PORT",
    )


class _Pace:
    """Tells now and then how far it is."""

    def __init__(self, total: int, tell: Tell) -> None:
        self._total = total
        self._tell = tell
        self._began_s = self._told_s = time.monotonic()

    @property
    def seconds(self) -> float:
        """Since the beginning."""
        return time.monotonic() - self._began_s

    def done(self, count: int) -> None:
        """So many are."""
        now_s = time.monotonic()
        if now_s - self._told_s < TELL_EVERY_S and count < self._total:
            return
        self._told_s = now_s
        rate = count / max(self.seconds, 1e-9)
        left_s = (self._total - count) / rate
        self._tell(f"{count}/{self._total} campaigns · {rate:.0f}/s · {left_s:.0f} s left")
