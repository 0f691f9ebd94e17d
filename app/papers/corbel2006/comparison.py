"""Comparison of ours with the paper's figures over all seeds: what differs, and the verdict."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby
from string import ascii_lowercase
from typing import Literal, Self

import numpy as np

from app.papers.corbel2006.printed import GROUPS, TABLE_II, Figure, Group, allowed
from app.papers.corbel2006.quantities import QUANTITIES, Quantity
from app.papers.corbel2006.trials import PROTOTYPE, Experiment, Trial, TrialResult
from campaigns.files.table import number

SCHEMA = "pkmcal/reproduction/1"
LOW, HIGH = 5.0, 95.0
"""Percentiles between which the spread is told."""
ENOUGH_SEEDS = 20
"""Of each experiment, for a median that can be relied on."""
UNEXPLAINED = "?"
SIGNS = {"mm": "", "deg": "°", "%": " %"}

Failed = tuple[Trial, str]
"""A trial that gave no result, and why."""


@dataclass(frozen=True, slots=True)
class Distribution:
    """Median over seeds, and the percentiles `LOW` and `HIGH`."""

    median: float
    low: float
    high: float
    seeds: int

    @classmethod
    def of(cls, values: Sequence[float]) -> Self:
        """Summary of values; raises `ValueError` for none."""
        if not len(values):
            raise ValueError("no values to summarise")
        low, median, high = np.percentile(values, (LOW, 50.0, HIGH)).tolist()
        return cls(median, low, high, len(values))


@dataclass(frozen=True, slots=True)
class Row:
    """One figure: the paper's and ours."""

    group: Group
    figure: Figure
    values: tuple[float, ...]
    """By seed."""
    ours: Distribution

    @property
    def quantity(self) -> Quantity:
        """How it is computed and written."""
        return QUANTITIES[self.figure.quantity]

    @property
    def agrees(self) -> bool | None:
        """Whether what is printed lies within our spread; None where nothing is printed."""
        if not self.figure.printed:
            return None
        low, high = allowed(self.figure.printed)
        return self.ours.low <= high and self.ours.high >= low

    @property
    def reason(self) -> str:
        """Why it differs; empty where it does not, or where nobody knows."""
        return self.figure.reason if self.agrees is False else ""

    @property
    def passed(self) -> bool | None:
        """Whether the median is as asked; None where nothing is asked."""
        if not self.figure.asked:
            return None
        low, high = allowed(self.figure.asked)
        return low <= self.ours.median <= high

    def written(self, text: str | float) -> str:
        """Words or a value of this figure with its unit's sign; nothing for no words."""
        told = text if isinstance(text, str) else number(text, self.quantity.decimals)
        return told and told + SIGNS[self.quantity.unit]

    def document(self) -> dict[str, object]:
        """Figure as `--json` tells it: what is not printed, asked or known is null."""
        words, asked = self.figure.printed, self.figure.asked
        return {
            "group": self.group.title,
            "experiment": self.group.experiment.name,
            "name": self.figure.name,
            "unit": self.quantity.unit,
            "paper": {"text": words, "place": self.group.place} if words else None,
            "ours": asdict(self.ours),
            "agrees": self.agrees,
            "reason": self.reason or None,
            "asked": dict(zip(("low", "high"), allowed(asked), strict=True)) if asked else None,
            "passed": self.passed,
        }


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """Line of Table II: the printed estimate, which is the simulated truth, and our estimates."""

    name: str
    paper: float
    ours: Distribution
    std: float | None
    """Median of the standard deviations that the identifications state."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """All figures, as far as there are seeds; `seeds` of each experiment were asked for."""

    seeds: int
    rows: tuple[Row, ...]
    parameters: tuple[ParameterRow, ...]
    failed: tuple[Failed, ...]

    @property
    def groups(self) -> tuple[tuple[Group, tuple[Row, ...]], ...]:
        """Rows by group, in the paper's order."""
        return tuple((group, tuple(rows)) for group, rows in groupby(self.rows, lambda r: r.group))

    @property
    def asked(self) -> tuple[Row, ...]:
        """Rows of which something is asked."""
        return tuple(row for row in self.rows if row.passed is not None)

    @property
    def missed(self) -> tuple[Row, ...]:
        """Rows whose median is not as asked."""
        return tuple(row for row in self.rows if row.passed is False)

    @property
    def reasons(self) -> dict[str, str]:
        """Reasons that are needed, by letter, in the order of the rows."""
        needed = dict.fromkeys(row.reason for row in self.rows if row.reason)
        return dict(zip(ascii_lowercase, needed, strict=False))

    def letter(self, row: Row) -> str:
        """The reason's letter; nothing where the paper's figure lies within our spread."""
        if row.agrees is not False:
            return ""
        letters = (letter for letter, reason in self.reasons.items() if reason == row.reason)
        return next(letters, UNEXPLAINED)

    @property
    def decision(self) -> Literal["pass", "fail"]:
        """Pass only when every median of which something is asked is so, and no seed failed."""
        return "pass" if self.asked and not self.missed and not self.failed else "fail"

    @property
    def headline(self) -> str:
        """How many medians are as asked."""
        asked = len(self.asked)
        return f"{asked - len(self.missed)} of {asked} medians are as asked."

    @property
    def lines(self) -> tuple[str, ...]:
        """What speaks against it, a line each."""
        return (*map(self._missed, self.missed), *self._failures(), *self._few_seeds())

    def _missed(self, row: Row) -> str:
        ours, asked = row.written(row.ours.median), row.written(row.figure.asked)
        letter = self.letter(row)
        why = f"; why:\N{NO-BREAK SPACE}{letter}" if letter else ""
        return f"missed: {row.group.title}: {row.figure.name} {ours}, asked {asked}{why}"

    def _failures(self) -> Iterator[str]:
        """Seeds that failed, those with the same reason together."""
        kinds = sorted((trial.experiment.name, why, trial.seed) for trial, why in self.failed)
        for (experiment, why), alike in groupby(kinds, lambda kind: kind[:2]):
            seeds = ", ".join(str(seed) for *_, seed in alike)
            yield f"failed: {experiment}, seed {seeds}: {why}"

    def _few_seeds(self) -> Iterator[str]:
        if self.seeds < ENOUGH_SEEDS:
            yield (
                f"{self.seeds} seeds of each are a look and no proof; `pkmcal reproduce` takes "
                f"{ENOUGH_SEEDS}."
            )

    def document(self) -> dict[str, object]:
        """Comparison as `--json` tells it."""
        return {
            "schema": SCHEMA,
            "seeds": self.seeds,
            "verdict": self.decision,
            "headline": self.headline,
            "figures": [row.document() for row in self.rows],
            "table_2": [asdict(row) for row in self.parameters],
            "failed": [
                {"experiment": trial.experiment.name, "seed": trial.seed, "reason": why}
                for trial, why in self.failed
            ],
        }


def compare(
    results: Sequence[TrialResult], seeds: int, failed: Sequence[Failed] = ()
) -> Comparison:
    """Comparison of results; a group whose experiment has no seed is left out."""
    rows = tuple(
        _row(group, figure, own)
        for group in GROUPS
        if (own := of_experiment(results, group.experiment))
        for figure in group.figures
    )
    own = of_experiment(results, PROTOTYPE)
    parameters = tuple(_parameter(name, value, own) for name, value in TABLE_II.items() if own)
    return Comparison(seeds, rows, parameters, tuple(failed))


def of_experiment(
    results: Sequence[TrialResult], experiment: Experiment
) -> tuple[TrialResult, ...]:
    """Seeds of one experiment."""
    return tuple(result for result in results if result.experiment == experiment.name)


def _row(group: Group, figure: Figure, results: Sequence[TrialResult]) -> Row:
    values = tuple(QUANTITIES[figure.quantity].of(result) for result in results)
    return Row(group, figure, values, Distribution.of(values))


def _parameter(name: str, printed: float, own: Sequence[TrialResult]) -> ParameterRow:
    estimates = [result.parameters[name] for result in own]
    stated = [estimate.std for estimate in estimates if estimate.std is not None]
    ours = Distribution.of([estimate.estimated_error for estimate in estimates])
    return ParameterRow(name, printed, ours, Distribution.of(stated).median if stated else None)
