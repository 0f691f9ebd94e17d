"""Ours beside the paper's: every figure over all seeds, and what follows."""

from collections.abc import Sequence
from dataclasses import dataclass

from app.papers.corbel2006.experiments import PROTOTYPE
from app.papers.corbel2006.groups import GROUPS
from app.papers.corbel2006.printed import TABLE_II
from app.papers.corbel2006.quantities import Group, Quantity
from app.papers.corbel2006.reasons import Reason
from app.papers.corbel2006.summary import Distribution, distribution
from app.papers.corbel2006.trials import TrialResult


@dataclass(frozen=True, slots=True)
class Row:
    """One figure: the paper's and ours."""

    quantity: Quantity
    values: tuple[float, ...]
    """By seed."""
    ours: Distribution

    @property
    def agrees(self) -> bool | None:
        """Whether what is printed lies within our spread; None where nothing is printed."""
        if self.quantity.printed is None:
            return None
        return self.quantity.printed.allows(self.ours.low, self.ours.high)

    @property
    def reason(self) -> Reason | None:
        """Why it differs; None where it does not, or where nobody knows."""
        return self.quantity.reason if self.agrees is False else None

    @property
    def passed(self) -> bool | None:
        """Whether the median is as asked; None where nothing is asked."""
        asked = self.quantity.asked
        return None if asked is None else asked.holds(self.ours.median)


@dataclass(frozen=True, slots=True)
class ComparedGroup:
    """The rows of a group."""

    group: Group
    rows: tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """A line of Table II: the printed estimate, which is the simulated truth, and our estimates."""

    name: str
    printed: float
    ours: Distribution
    std: float | None
    """Median of the standard deviations that the identifications state."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Everything, as far as there are seeds."""

    groups: tuple[ComparedGroup, ...]
    parameters: tuple[ParameterRow, ...]

    @property
    def asked(self) -> tuple[tuple[Group, Row], ...]:
        """The rows of which something is asked."""
        return tuple(
            (compared.group, row)
            for compared in self.groups
            for row in compared.rows
            if row.passed is not None
        )

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Those that are needed, in the order of the rows."""
        found = (row.reason for compared in self.groups for row in compared.rows)
        return tuple(dict.fromkeys(reason for reason in found if reason is not None))


def compare(results: Sequence[TrialResult]) -> Comparison:
    """Summarise; a group whose experiment has no seed is left out."""
    compared = []
    for group in GROUPS:
        own = of_experiment(results, group.experiment.name)
        if own:
            rows = tuple(_row(quantity, own) for quantity in group.quantities)
            compared.append(ComparedGroup(group, rows))
    return Comparison(tuple(compared), _parameter_rows(results))


def of_experiment(results: Sequence[TrialResult], name: str) -> list[TrialResult]:
    """The seeds of one experiment."""
    return [result for result in results if result.experiment == name]


def _row(quantity: Quantity, results: Sequence[TrialResult]) -> Row:
    values = tuple(quantity.of(result) for result in results)
    return Row(quantity, values, distribution(values))


def _parameter_rows(results: Sequence[TrialResult]) -> tuple[ParameterRow, ...]:
    own = of_experiment(results, PROTOTYPE.name)
    if not own:
        return ()
    return tuple(_parameter_row(name, value, own) for name, value in TABLE_II.items())


def _parameter_row(name: str, printed: float, own: Sequence[TrialResult]) -> ParameterRow:
    estimates = [result.parameters[name] for result in own]
    stated = [estimate.std for estimate in estimates if estimate.std is not None]
    return ParameterRow(
        name,
        printed,
        distribution([estimate.estimated_error for estimate in estimates]),
        distribution(stated).median if stated else None,
    )
