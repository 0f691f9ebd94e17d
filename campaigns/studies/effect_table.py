"""Table of judged campaigns, a row each."""

import hashlib
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from typing import Any

from campaigns.errors import OutputExists
from campaigns.files.csv_file import CsvForm, CsvRow, csv_text, number_text, parse_csv
from campaigns.studies.effects import KINDS
from campaigns.studies.judged import EffectOutcome, EffectSetup, JudgedCampaign
from campaigns.studies.store import ANOTHER, ResultTable

WORDS = ("verdict", "model", "doubts", "change")
COUNTS = ("known", "missing", "too_many")
MARKS = ("named", "false_alarm")
JUDGED = tuple(each.name for each in fields(JudgedCampaign))
COLUMNS = ("study", "campaign", "what", "failure", *JUDGED)


def effect_digest(setup: EffectSetup, effect: str, truth: str) -> str:
    """Twelve characters that differ between studies; `truth` says how robots are drawn."""
    kinds = ", ".join(map(repr, KINDS[effect]))
    poses = hashlib.sha256(setup.workspace.tobytes()).hexdigest()
    return setup.study.digest(f"{truth} {effect}: {kinds} {poses} {setup.model}")


@dataclass(frozen=True, slots=True)
class EffectTable(ResultTable[int, EffectOutcome]):
    """CSV file of one effect's campaigns; `study` tells it from others."""

    study: str

    def key_of(self, outcome: EffectOutcome) -> int:
        """Number of the campaign."""
        return outcome.number

    def header(self) -> str:
        """Line with the columns' names."""
        return csv_text(COLUMNS, ())

    def lines_of(self, outcomes: Iterable[EffectOutcome]) -> str:
        """Rows without a header."""
        return csv_text(COLUMNS, map(self._row_of, outcomes)).partition("\n")[2]

    def parsed(self, text: str) -> Iterable[EffectOutcome]:
        """Outcomes of a table of this study; raises `OutputExists`."""
        if text.partition("\n")[0].split(",") != list(COLUMNS):
            problem = "is no table of a study of effects by this version"
            raise OutputExists(f"{self.path}: {problem}", remedy=ANOTHER)
        form = CsvForm(COLUMNS, (), OutputExists)
        return map(self._outcome_of, parse_csv(text, str(self.path), form))

    def _row_of(self, outcome: EffectOutcome) -> list[str]:
        judged = outcome.judged
        texts = [""] * len(JUDGED)
        if judged is not None:
            texts = [_text(name, getattr(judged, name)) for name in JUDGED]
        return [self.study, str(outcome.number), outcome.what, outcome.failure, *texts]

    def _outcome_of(self, row: CsvRow) -> EffectOutcome:
        if row.text("study") != self.study:
            raise row.wrong(
                "belongs to another study: other plan, robots, noise, effect, estimator, model or "
                "seed",
                remedy=ANOTHER,
            )
        number, what, failure = row.whole_number("campaign"), row.text("what"), row.text("failure")
        if failure:
            return EffectOutcome(number, what, None, failure)
        # Any: which type each field has, its name says and mypy cannot know
        values: dict[str, Any] = {name: _value(row, name) for name in JUDGED}
        return EffectOutcome(number, what, JudgedCampaign(**values))


def _text(name: str, value: object) -> str:
    if name == "doubts":
        return " ".join(value) if isinstance(value, tuple) else ""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        return "" if math.isnan(value) else number_text(value)
    return str(value)


def _value(row: CsvRow, name: str) -> object:
    if name == "doubts":
        return tuple(row.text(name).split())
    if name in WORDS:
        return row.text(name)
    if name in COUNTS:
        return row.whole_number(name)
    if name in MARKS:
        return bool(row.whole_number(name))
    return row.number(name) if row.text(name) else math.nan
