"""Tables of results: rows are appended as they come and sorted at the end."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import OutputExists, WriteFailed
from campaigns.files.csv_file import CsvForm, CsvRow, csv_text, number_text, parse_csv
from campaigns.files.text_file import read_text, replace_text
from campaigns.studies.study import CampaignEstimate, CampaignOutcome
from drivers.bounded_files import MEGABYTE, is_there

UNSEEN_COLUMNS = ("unseen_mean_mm", "unseen_max_mm")
MOST_BYTES = 50 * MEGABYTE
MOST_LINES = 200_000
"""Of a table: some 40 000 campaigns with two dozen parameters each."""
ANOTHER = "name another folder with --to, or move this file away"
KINDS = ("error ", "std ", "bound ")
"""Before a parameter's name, in whose unit the value is."""


class _Ordered(Protocol):
    def __lt__(self, other: Any, /) -> bool: ...


Key = TypeVar("Key", bound=_Ordered)
Outcome = TypeVar("Outcome")


@dataclass(frozen=True, slots=True)
class ResultTable(ABC, Generic[Key, Outcome]):
    """File of results by key, in whose form whoever says `lines_of` and `parsed` writes them."""

    path: Path

    def read(self) -> dict[Key, Outcome]:
        """Results that are there already, the last one of each key, but for a row that was cut off.

        Raises `OutputExists` for a file that holds anything else.
        """
        if not is_there(self.path):
            return {}
        text = read_text(self.path, OutputExists, if_missing="name another", most_bytes=MOST_BYTES)
        whole = text[: text.rfind("\n") + 1]
        return {self.key_of(outcome): outcome for outcome in self.parsed(whole)}

    def append(self, outcomes: Iterable[Outcome]) -> None:
        """Addition of rows to what was written; raises `WriteFailed`."""
        try:
            with self.path.open("a", encoding="utf-8", newline="") as file:
                file.write(self.lines_of(outcomes))
        except OSError as error:
            raise WriteFailed(
                f"{self.path}: cannot be written ({error.strerror})",
                remedy="free space on the disk, then give the same command again: it goes on",
            ) from error

    def write(self, outcomes: Mapping[Key, Outcome]) -> None:
        """Rewriting of all rows, by key; raises `WriteFailed`."""
        rows = (outcomes[key] for key in sorted(outcomes))
        replace_text(self.path, self.header() + self.lines_of(rows))

    def header(self) -> str:
        """Lines before the rows."""
        return ""

    @abstractmethod
    def key_of(self, outcome: Outcome) -> Key:
        """Key of a result."""

    @abstractmethod
    def lines_of(self, outcomes: Iterable[Outcome]) -> str:
        """Rows as text, a line each."""

    @abstractmethod
    def parsed(self, text: str) -> Iterable[Outcome]:
        """Results of whole lines, the header's among them; raises `OutputExists`."""


@dataclass(frozen=True, slots=True)
class StudyTable(ResultTable[int, CampaignOutcome]):
    """CSV file of one study, a row a campaign; `study` tells it from others."""

    study: str
    free: tuple[str, ...]

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        values = (f"{kind}{name}" for kind in KINDS for name in self.free)
        return ("study", "campaign", "failure", *UNSEEN_COLUMNS, *values)

    def key_of(self, outcome: CampaignOutcome) -> int:
        """Number of the campaign."""
        return outcome.number

    def header(self) -> str:
        """Line with the columns' names."""
        return csv_text(self.columns, ())

    def lines_of(self, outcomes: Iterable[CampaignOutcome]) -> str:
        """Rows without a header."""
        return csv_text(self.columns, map(self._row_of, outcomes)).partition("\n")[2]

    def parsed(self, text: str) -> Iterable[CampaignOutcome]:
        """Outcomes of a table of this study; raises `OutputExists`."""
        self._check_header(text.partition("\n")[0])
        form = CsvForm(self.columns, (), OutputExists, MOST_LINES)
        return map(self._outcome_of, parse_csv(text, str(self.path), form))

    def _check_header(self, header: str) -> None:
        """Before every column is looked at: other parameters mean another study."""
        if header.split(",") == list(self.columns):
            return
        is_study = header.startswith(",".join(self.columns[:3]))
        what = "belongs to a study of other parameters" if is_study else "is no table of a study"
        raise OutputExists(f"{self.path}: {what}", remedy=ANOTHER)

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
                "belongs to another study: other plan, robots, noise, estimator, model or seed",
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
