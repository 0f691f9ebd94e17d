"""Errors of the estimates of a study's campaigns, its combinations side by side."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from app.console import WARNING, Terminal
from app.study.running import Studied
from app.study.setup import Combination
from app.study.summary_texts import NAMED, PERCENT, common_document, labels_of, shortcomings
from campaigns.arrays import Array
from campaigns.errors import ShotsMissing
from campaigns.files.table import Column, csv_table
from campaigns.studies.summary import ParameterSummary, StudySummary, summarise

QUANTILES = ("median", "q95")
EXPLAINED = (
    "ratio: σ found over σ stated; 95 %: share of intervals that hold the truth; "
    "bound: variance found over the least that the shots allow (Cramér-Rao)"
)


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A combination's campaigns, what they show, and how they stand to the first of its scenario.

    `unseen_relative` is the median of (mean unseen error / the first's of the same number): the
    same robot and the same draws of noise, so chance counts for little.
    """

    studied: Studied
    label: str
    """What tells it from the others."""
    summary: StudySummary
    unseen_relative: float | None

    @property
    def combination(self) -> Combination:
        """Which one it is."""
        return self.studied.combination

    def worst(self, unit: str) -> float | None:
        """Largest standard deviation found of a unit, mm or deg; None when none was free."""
        space = self.combination.setup.nominal.mechanism.parameters
        own = (p.std for p in self.summary.parameters if space[p.name].unit == unit)
        return max(own, default=None)

    def extremes(self, of: Callable[[ParameterSummary], float]) -> tuple[float, float]:
        """Least and largest of a figure over all parameters."""
        values = [of(p) for p in self.summary.parameters]
        return min(values), max(values)

    @property
    def ratios(self) -> tuple[float, float]:
        """Least and largest σ found over σ stated."""
        return self.extremes(lambda p: p.ratio)

    @property
    def covered(self) -> tuple[float, float]:
        """Least and largest share of 95 % intervals that hold the truth."""
        return self.extremes(lambda p: p.covered)

    @property
    def variance_over_bound(self) -> float:
        """The largest."""
        return self.extremes(lambda p: p.variance_over_bound)[1]

    def unseen(self, which: str, quantile: str) -> float | None:
        """Quantile over campaigns of the mean or max error of hold-out distances; None without."""
        found = {"mean": self.summary.unseen_mean_mm, "max": self.summary.unseen_max_mm}[which]
        return None if found is None else found[QUANTILES.index(quantile)]


def compare(studied: Sequence[Studied]) -> tuple[Compared, ...]:
    """Raises `ShotsMissing`, naming the combination of which too few campaigns gave an answer."""
    first_of: dict[str, Studied] = {}
    for one in studied:
        first_of.setdefault(one.combination.scenario.name, one)
    labels = labels_of([(*one.combination.words.values(),) for one in studied])
    return tuple(
        Compared(
            one,
            label,
            _summary(one),
            _unseen_relative(one, first_of[one.combination.scenario.name]),
        )
        for label, one in zip(labels, studied, strict=True)
    )


def _summary(studied: Studied) -> StudySummary:
    try:
        return summarise(studied.combination.setup, studied.rows)
    except ShotsMissing as error:
        problem, remedy = f"{studied.combination}: {error.problem}", error.remedy
        if studied.lost:
            problem += f", {studied.lost} were lost"
            remedy = f"look into: {'; '.join(studied.reasons)}"
        raise ShotsMissing(problem, remedy=remedy) from error


def _unseen_relative(one: Studied, first: Studied) -> float | None:
    (mine, mine_mm), (others, others_mm) = _unseen_by_number(one), _unseen_by_number(first)
    _, own, their = np.intersect1d(mine, others, assume_unique=True, return_indices=True)
    return float(np.median(mine_mm[own] / others_mm[their])) if len(own) else None


def _unseen_by_number(studied: Studied) -> tuple[Array, Array]:
    """Numbers of campaigns with mean unseen errors above zero, and these."""
    found = (
        (row.campaign, row.estimate.unseen_mean_mm)
        for row in studied.rows
        if row.estimate is not None and row.estimate.unseen_mean_mm
    )
    numbers, means_mm = np.fromiter(found, dtype=(np.float64, 2)).T
    return numbers, means_mm


def _word(name: str) -> Column[Compared]:
    return Column(name, lambda one: one.combination.words[name], kind="words")


COMPARISON: tuple[Column[Compared], ...] = (
    *map(_word, ("plan", "scenario", "estimator", "model")),
    Column("campaigns", lambda one: one.summary.campaigns),
    Column("failed", lambda one: one.summary.failed),
    Column("worst_length_mm", lambda one: one.worst("mm")),
    Column("worst_angle_deg", lambda one: one.worst("deg")),
    Column("ratio_least", lambda one: one.ratios[0]),
    Column("ratio_most", lambda one: one.ratios[1]),
    Column("covered_95_least", lambda one: one.covered[0]),
    Column("covered_95_most", lambda one: one.covered[1]),
    Column("variance_over_bound_most", lambda one: one.variance_over_bound),
    Column("unseen_mean_median_mm", lambda one: one.unseen("mean", "median")),
    Column("unseen_mean_q95_mm", lambda one: one.unseen("mean", "q95")),
    Column("unseen_max_median_mm", lambda one: one.unseen("max", "median")),
    Column("unseen_max_q95_mm", lambda one: one.unseen("max", "q95")),
    Column("unseen_relative", lambda one: one.unseen_relative),
)
"""comparison.csv, a row a combination."""

PARAMETERS: tuple[Column[ParameterSummary], ...] = (
    Column("", lambda p: p.name, kind="words"),
    Column("bias", lambda p: p.bias, decimals=5, signed=True),
    Column("σ found", lambda p: p.std, decimals=5),
    Column("stated", lambda p: p.stated_std, decimals=5),
    Column("ratio", lambda p: p.ratio),
    Column("95 %", lambda p: PERCENT * p.covered, decimals=1),
    Column("bound", lambda p: p.variance_over_bound),
)
"""Of one combination, a row a parameter, mm and deg."""

HONESTY: tuple[Column[Compared], ...] = (
    Column("", lambda one: one.label, kind="words"),
    Column("worst mm", lambda one: one.worst("mm"), decimals=4),
    Column("worst deg", lambda one: one.worst("deg"), decimals=5),
    Column("ratio", lambda one: "–".join(f"{ratio:.3f}" for ratio in one.ratios)),
    Column("95 %", lambda one: "–".join(f"{PERCENT * share:.1f}" for share in one.covered)),
    Column("bound", lambda one: one.variance_over_bound),
)
"""Of several combinations the worst of each, or from the least to the most."""

UNSEEN: tuple[Column[Compared], ...] = (
    Column("", lambda one: one.label, kind="words"),
    Column("mean: half", lambda one: one.unseen("mean", "median"), decimals=4),
    Column("95 %", lambda one: one.unseen("mean", "q95"), decimals=4),
    Column("largest: half", lambda one: one.unseen("max", "median"), decimals=4),
    Column("95 %", lambda one: one.unseen("max", "q95"), decimals=4),
    Column("relative", lambda one: one.unseen_relative, decimals=2),
)


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Summary of campaigns in which nothing goes wrong: the errors of their estimates."""

    compared: tuple[Compared, ...]

    table_name, document_name = "comparison.csv", "study.json"
    """Files for programs."""

    def csv(self) -> str:
        """Table for programs."""
        return csv_table(COMPARISON, self.compared)

    def document(self) -> dict[str, object]:
        """What is in `pkmcal/study/1` of the combinations."""
        return {
            "schema": "pkmcal/study/1",
            "combinations": [_errors_document(one) for one in self.compared],
        }

    def show(self, terminal: Terminal) -> None:
        """Tables: of one combination every parameter, of several the worst of each; verdicts."""
        if len(self.compared) == 1:
            parameters = self.compared[0].summary.parameters
            terminal.rows("Errors of the parameters (mm, deg)", PARAMETERS, parameters)
        else:
            terminal.rows("Errors of the parameters", HONESTY, self.compared)
        terminal.note(EXPLAINED)
        if unseen := [one for one in self.compared if one.unseen("mean", "median") is not None]:
            terminal.rows("Errors of hold-out distances (mm)", UNSEEN, unseen)
        for one in self.compared:
            style = WARNING if one.summary.too_sure else ""
            terminal.say(f"{one.label}: {honesty(one.summary)}", style)
            for line in shortcomings(one.studied):
                terminal.say(f"{one.label}: {line}", WARNING)


def _errors_document(one: Compared) -> dict[str, object]:
    setup, summary = one.combination.setup, one.summary
    return {
        **common_document(one.studied),
        "shots": len(setup.fitted),
        "pairs": setup.pairs,
        "campaigns": summary.campaigns,
        "failed": summary.failed,
        "parameters": {
            p.name: {
                "bias": p.bias,
                "std": p.std,
                "stated_std": p.stated_std,
                "ratio": p.ratio,
                "covered_95": p.covered,
                "bound_std": p.bound_std,
                "variance_over_bound": p.variance_over_bound,
            }
            for p in summary.parameters
        },
        "chance": {
            "ratio": summary.chance.ratio,
            "covered_95": summary.chance.covered,
            "variance_over_bound": summary.chance.variance_over_bound,
        },
        **{
            f"unseen_{which}_mm": None
            if one.unseen(which, "median") is None
            else {name: one.unseen(which, name) for name in QUANTILES}
            for which in ("mean", "max")
        },
        "unseen_relative": one.unseen_relative,
    }


def honesty(summary: StudySummary) -> str:
    """What the study says of the stated σ, in a line."""
    if summary.too_sure:
        worst = sorted(summary.too_sure, key=lambda p: p.ratio, reverse=True)
        return f"stated σ are too small: {_named(worst)}"
    if summary.too_unsure:
        worst = sorted(summary.too_unsure, key=lambda p: p.ratio)
        return f"stated σ are larger than need be: {_named(worst)}"
    low, high = summary.chance.ratio
    return (
        f"stated σ are true, as far as {summary.campaigns} campaigns tell "
        f"(ratios from {max(low, 0.0):.3f} to {high:.3f} may be chance)"
    )


def _named(parameters: Sequence[ParameterSummary]) -> str:
    named = [f"{p.name} found {p.ratio:.2f} × stated" for p in parameters[:NAMED]]
    more = len(parameters) - len(named)
    return ", ".join([*named, *([f"and {more} more"] if more else [])])
