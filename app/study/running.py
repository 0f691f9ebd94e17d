"""Simulates what the table of a study lacks, and keeps what comes back."""

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

from app.progress import CountedWork
from app.study.setup import Study
from app.study.workers import Numbers, Parts, Simulate
from campaigns.errors import ShotsMissing
from campaigns.studies.study import CampaignRow
from campaigns.studies.summary import StudySummary, summarise
from campaigns.studies.table import StudyTable

CAMPAIGNS_A_PART = 25


@dataclass(frozen=True, slots=True, eq=False)
class Studied:
    """A study's campaigns, and how many were lost on the way."""

    study: Study
    rows: Sequence[CampaignRow]
    computed: int
    """Number of campaigns that were not in the table before."""
    lost: int
    reasons: tuple[str, ...]
    """Why some were lost, each reason once."""

    def summary(self) -> StudySummary:
        """Raises `ShotsMissing` when too few campaigns gave an estimate."""
        try:
            return summarise(self.study.parameters, self.rows)
        except ShotsMissing as error:
            if not self.lost:
                raise
            problem = f"{error.problem}, {self.lost} were lost"
            raise ShotsMissing(problem, remedy=f"look into: {'; '.join(self.reasons)}") from error


def run_study(
    study: Study,
    table: StudyTable,
    wanted: range,
    compute: Callable[[Simulate, Sequence[Numbers]], Parts],
    counting: Callable[[int, int], CountedWork],
) -> Studied:
    """Simulate what a table lacks of the wanted campaigns.

    `compute` yields parts as they are simulated; `counting` shows how many of how many campaigns
    are done. Raise `OutputExists` and `WriteFailed`; what had come back until then is kept.
    """
    table.read()
    left = [number for number in wanted if number not in table.by_number]
    parts = [left[at : at + CAMPAIGNS_A_PART] for at in range(0, len(left), CAMPAIGNS_A_PART)]
    counted, lost, reasons = counting(len(wanted), len(wanted) - len(left)), 0, dict[str, None]()
    with closing(compute(study.simulate, parts)) as results, counted:
        table.write()
        for part in results:
            if part.lost:
                lost += len(parts[part.place])
                reasons[part.lost] = None
                counted.news = f"{lost} lost"
            table.add(part.rows)
            counted.advance(len(parts[part.place]))
    table.write()
    rows = [table.by_number[number] for number in wanted if number in table.by_number]
    return Studied(study, rows, len(left) - lost, lost, (*reasons,))
