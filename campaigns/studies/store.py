"""The table of a study: one row a campaign, written as they come and sorted at the end."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import OutputExists, WriteFailed
from campaigns.files.csv_file import CsvForm, CsvRow, csv_text, number_text, parse_csv
from campaigns.files.text_file import read_text, replace_text
from campaigns.studies.study import CampaignEstimate, CampaignOutcome

UNSEEN_COLUMNS = ("unseen_mean_mm", "unseen_max_mm")
ANOTHER = "name another folder with --to, or move this file away"
KINDS = ("error ", "std ", "bound ")
"""Before a parameter's name, in whose unit the value is."""


@dataclass(frozen=True, slots=True)
class StudyTable:
    """Where the rows of one study are kept; `study` tells it from others."""

    path: Path
    study: str
    free: tuple[str, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """The header."""
        values = (f"{kind}{name}" for kind in KINDS for name in self.free)
        return ("study", "campaign", "failure", *UNSEEN_COLUMNS, *values)

    def read(self) -> dict[int, CampaignOutcome]:
        """What is there already, by campaign, but for a row that was cut off.

        Raises `OutputExists` for a file that holds anything else.
        """
        if not self.path.exists():
            return {}
        text = read_text(self.path, OutputExists, if_missing="name another")
        whole = text[: text.rfind("\n") + 1]
        self._check_header(whole.partition("\n")[0])
        form = CsvForm(self.columns, (), OutputExists)
        outcomes = (self._outcome_of(row) for row in parse_csv(whole, str(self.path), form))
        return {outcome.number: outcome for outcome in outcomes}

    def _check_header(self, header: str) -> None:
        """Before every column is looked at: other parameters mean another study."""
        if header.split(",") == list(self.columns):
            return
        is_study = header.startswith(",".join(self.columns[:3]))
        what = "belongs to a study of other parameters" if is_study else "is no table of a study"
        raise OutputExists(f"{self.path}: {what}", remedy=ANOTHER)

    def append(self, outcomes: Iterable[CampaignOutcome]) -> None:
        """Add rows to what was written; raises `WriteFailed`."""
        text = csv_text(self.columns, map(self._row_of, outcomes)).split("\n", maxsplit=1)[1]
        try:
            with self.path.open("a", encoding="utf-8", newline="") as file:
                file.write(text)
        except OSError as error:
            raise WriteFailed(
                f"{self.path}: cannot be written ({error.strerror})",
                remedy="free space on the disk, then start the same study again: it goes on",
            ) from error

    def write(self, outcomes: Mapping[int, CampaignOutcome]) -> None:
        """Write all rows anew, by number; raises `WriteFailed`."""
        rows = (self._row_of(outcomes[number]) for number in sorted(outcomes))
        replace_text(self.path, csv_text(self.columns, rows))

    def _row_of(self, outcome: CampaignOutcome) -> list[str]:
        texts = [""] * (len(UNSEEN_COLUMNS) + len(KINDS) * len(self.free))
        if outcome.estimate is not None:
            found = outcome.estimate
            unseen = np.array([found.unseen_mean_mm, found.unseen_max_mm])
            values = np.concatenate([unseen, found.errors, found.std, found.bound]).tolist()
            texts = ["" if math.isnan(value) else number_text(value) for value in values]
        return [self.study, str(outcome.number), outcome.failure, *texts]

    def _outcome_of(self, row: CsvRow) -> CampaignOutcome:
        if row.text("study") != self.study:
            raise row.wrong(
                "belongs to another study: other plan, robots, noise, estimator or seed",
                remedy=ANOTHER,
            )
        number, failure = row.whole_number("campaign"), row.text("failure")
        return CampaignOutcome(number, None if failure else self._estimate_of(row), failure)

    def _estimate_of(self, row: CsvRow) -> CampaignEstimate:
        mean, most = (
            row.number(column) if row.text(column) else float("nan") for column in UNSEEN_COLUMNS
        )
        errors, std, bound = (self._values(row, kind) for kind in KINDS)
        return CampaignEstimate(errors, std, bound, mean, most)

    def _values(self, row: CsvRow, kind: str) -> Array:
        return np.array([row.number(f"{kind}{name}") for name in self.free])
