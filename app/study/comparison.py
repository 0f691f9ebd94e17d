"""Combinations side by side: one line each, for the screen, the table and programs."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from app.study.combinations import Combination
from app.study.running import Studied
from campaigns.errors import ShotsMissing
from campaigns.files.csv_file import csv_text, number_text
from campaigns.studies.summary import ParameterSummary, StudySummary, summarise

COLUMNS = (
    *("plan", "scenario", "estimator", "model", "campaigns", "failed"),
    *("worst_length_mm", "worst_angle_deg", "ratio_least", "ratio_most"),
    *("covered_95_least", "covered_95_most", "variance_over_bound_most"),
    *("unseen_mean_median_mm", "unseen_mean_q95_mm", "unseen_max_median_mm", "unseen_max_q95_mm"),
    "unseen_relative",
)


@dataclass(frozen=True, slots=True, eq=False)
class Compared:
    """A combination's campaigns, what they show, and how they stand to the first of its scenario.

    `unseen_relative` is the median of (mean unseen error / the first's of the same number): the
    same robot and the same draws of noise, so chance counts for little.
    """

    studied: Studied
    summary: StudySummary
    unseen_relative: float | None

    @property
    def combination(self) -> Combination:
        """Which one it is."""
        return self.studied.combination

    @property
    def worst_length_mm(self) -> float | None:
        """Largest standard deviation found of a length; None when none was free."""
        return _worst(self.summary.parameters, "_mm")

    @property
    def worst_angle_deg(self) -> float | None:
        """Largest standard deviation found of an angle; None when none was free."""
        return _worst(self.summary.parameters, "_deg")

    @property
    def ratios(self) -> tuple[float, float]:
        """Least and largest σ found over σ stated."""
        return _range([p.ratio for p in self.summary.parameters])

    @property
    def covered(self) -> tuple[float, float]:
        """Least and largest share of 95 % intervals that hold the truth."""
        return _range([p.covered for p in self.summary.parameters])

    @property
    def unseen_mm(self) -> tuple[float, float] | None:
        """Mean error in half of the campaigns, largest in 95 % of them; None without such pairs."""
        mean, most = self.summary.unseen_mean_mm, self.summary.unseen_max_mm
        return None if mean is None or most is None else (mean[0], most[1])

    @property
    def variance_over_bound(self) -> float:
        """The largest."""
        return max(p.variance_over_bound for p in self.summary.parameters)


def compare(studied: Sequence[Studied]) -> tuple[Compared, ...]:
    """Raises `ShotsMissing`, naming the combination of which too few campaigns gave an answer."""
    first_of: dict[str, Studied] = {}
    for one in studied:
        first_of.setdefault(one.combination.scenario.name, one)
    return tuple(
        Compared(one, _summary(one), _unseen_relative(one, first_of[one.combination.scenario.name]))
        for one in studied
    )


def comparison_csv(compared: Sequence[Compared]) -> str:
    """One row a combination; what there is not is empty."""
    return csv_text(COLUMNS, map(_row, compared))


def _summary(studied: Studied) -> StudySummary:
    try:
        return summarise(studied.combination.setup, studied.outcomes)
    except ShotsMissing as error:
        problem, remedy = f"{studied.combination}: {error.problem}", error.remedy
        if studied.lost:
            problem += f", {studied.lost} were lost"
            remedy = f"look into: {'; '.join(studied.reasons)}"
        raise ShotsMissing(problem, remedy=remedy) from error


def _unseen_relative(one: Studied, first: Studied) -> float | None:
    mine, others = _unseen_by_number(one), _unseen_by_number(first)
    ratios = [mine[number] / others[number] for number in mine.keys() & others.keys()]
    return median(ratios) if ratios else None


def _unseen_by_number(studied: Studied) -> dict[int, float]:
    """Mean unseen errors above zero."""
    return {
        outcome.number: outcome.estimate.unseen_mean_mm
        for outcome in studied.outcomes
        if outcome.estimate is not None and outcome.estimate.unseen_mean_mm > 0.0
    }


def _row(one: Compared) -> list[str]:
    summary, none = one.summary, (None, None)
    values = (
        *(one.worst_length_mm, one.worst_angle_deg, *one.ratios, *one.covered),
        one.variance_over_bound,
        *(summary.unseen_mean_mm or none),
        *(summary.unseen_max_mm or none),
        one.unseen_relative,
    )
    counts = (str(summary.campaigns), str(summary.failed))
    texts = ("" if value is None else number_text(value) for value in values)
    return [*one.combination.words, *counts, *texts]


def _worst(parameters: Sequence[ParameterSummary], unit: str) -> float | None:
    return max((p.std for p in parameters if p.name.endswith(unit)), default=None)


def _range(values: Sequence[float]) -> tuple[float, float]:
    return min(values), max(values)
