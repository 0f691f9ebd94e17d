"""Summaries of a study: sizes of errors and honesty of σ; how often verdicts are wrong."""

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.errors import ShotsMissing
from campaigns.estimation.estimators import Estimator, Weights
from campaigns.estimation.information import CONFIDENCE, STATED_DOF, coverage_factor
from campaigns.studies.study import CampaignEstimate, CampaignRow, StudySetup, chunks

LEAST_CAMPAIGNS = 2
QUANTILES = (0.5, 0.95)
CHUNK = 5000
"""Campaigns that are looked at at once: some 20 MB."""
FALSE_ALARM = 0.01
"""Chance that any parameter of an honest study lies outside its `Chance`."""


@dataclass(frozen=True, slots=True)
class ParameterSummary:
    """Errors of one parameter over all campaigns, in file units (mm or deg)."""

    name: str
    bias: float
    """Mean error."""
    std: float
    """Standard deviation of the errors."""
    stated_std: float
    """Root mean square of the stated ones."""
    covered: float
    """Share of 95 % intervals that hold the true value."""
    bound_std: float
    """Root mean square of the Cramér-Rao bounds."""
    variance_over_bound: float
    """Variance of errors over the bound of each campaign; 1 is all that the data hold."""

    @property
    def ratio(self) -> float:
        """Empirical over stated; 1 is honest."""
        return self.std / self.stated_std


@dataclass(frozen=True, slots=True)
class Chance:
    """Limits in which an honest study's figures lie, of all parameters, 99 times of 100."""

    ratio: tuple[float, float]
    covered: tuple[float, float]
    variance_over_bound: tuple[float, float]
    """Variance over the bound (Cramér and Rao), of an estimator that reaches it."""


@dataclass(frozen=True, slots=True)
class StudySummary:
    """Errors over all campaigns that ended with an estimate."""

    campaigns: int
    failed: int
    parameters: tuple[ParameterSummary, ...]
    chance: Chance
    unseen_mean_mm: tuple[float, ...] | None
    """Quantiles 0.5 and 0.95 over campaigns; None without hold-out pairs."""
    unseen_max_mm: tuple[float, ...] | None

    def __repr__(self) -> str:
        ratios = [each.ratio for each in self.parameters]
        return (
            f"<StudySummary: {self.campaigns} campaigns, {self.failed} failed, empirical over "
            f"stated σ {min(ratios):.2f} to {max(ratios):.2f}>"
        )

    @property
    def too_sure(self) -> tuple[ParameterSummary, ...]:
        """Parameters whose stated σ is smaller than their errors say, beyond chance."""
        ratio, covered = self.chance.ratio[1], self.chance.covered[0]
        return tuple(p for p in self.parameters if p.ratio > ratio or p.covered < covered)

    @property
    def too_unsure(self) -> tuple[ParameterSummary, ...]:
        """Parameters whose stated σ is larger than their errors say, beyond chance."""
        ratio, covered = self.chance.ratio[0], self.chance.covered[1]
        return tuple(p for p in self.parameters if p.ratio < ratio or p.covered > covered)


def summarise(setup: StudySetup, rows: Iterable[CampaignRow]) -> StudySummary:
    """Summary of a study; raises `ShotsMissing` when fewer than two campaigns gave an estimate.

    Rows are taken some at a time; of all campaigns at once only errors of hold-out distances.
    """
    count, reasons, parts, unseen_mm = 0, set[str](), list[Array](), list[Array]()
    for some in chunks(rows, CHUNK):
        count += len(some)
        reasons |= {row.failure for row in some if row.failure}
        if found := estimates(some):
            parts.append(_part(setup, found))
            ends = [(one.unseen_mean_mm, one.unseen_max_mm) for one in found]
            unseen_mm.append(np.array(ends, dtype=np.float64))
    known = sum(map(len, unseen_mm))
    if known < LEAST_CAMPAIGNS:
        raise ShotsMissing(
            f"{known} of {count} campaigns could be identified",
            remedy=f"ask for more campaigns, or look into: {'; '.join(sorted(reasons)) or '-'}",
        )
    of_mean, of_max = map(_quantiles, np.concatenate(unseen_mm).T)
    parameters = _parameters(setup, np.array(parts))
    return StudySummary(known, count - known, parameters, chance(setup, known), of_mean, of_max)


def estimates(rows: Iterable[CampaignRow]) -> list[CampaignEstimate]:
    """Estimates of the campaigns that have one."""
    return [row.estimate for row in rows if row.estimate is not None]


def interval_factor(setup: StudySetup) -> float:
    """Half-width of a 95 % interval in stated standard deviations.

    Student's where the variance is the residuals' own, normal where the tracker's is known.
    """
    return coverage_factor(setup.dof + STATED_DOF if _variance_is_estimated(setup) else None)


def _effective_dof(setup: StudySetup) -> float:
    """Degrees of freedom of a variance that scatters like the stated one (Satterthwaite 1946).

    In a study the noise is what is stated: the part that comes from there does not scatter.
    """
    return (setup.dof + STATED_DOF) ** 2 / setup.dof


def _variance_is_estimated(setup: StudySetup) -> bool:
    """Case that σ come from the residuals of distances."""
    return setup.estimator is Estimator.DISTANCES and setup.options.weights is Weights.EQUAL


def normal_scores(setup: StudySetup, rows: Iterable[CampaignRow]) -> Array:
    """Errors over their stated σ, (C, F): standard normal when those are honest.

    What would be Student's distribution is carried over to the normal one, quantile by quantile.
    """
    found = estimates(rows)
    scores = np.array([one.errors for one in found]) / np.array([one.std for one in found])
    if _variance_is_estimated(setup):
        tails = scipy.special.stdtr(_effective_dof(setup), -np.abs(scores))
        return np.asarray(-np.sign(scores) * scipy.special.ndtri(tails))
    return np.asarray(scores)


def chance(setup: StudySetup, campaigns: int) -> Chance:
    """Chance in so many campaigns of an honest study, by the normal approximation for σ."""
    tail = FALSE_ALARM / (2.0 * len(setup.free))
    spread = -float(scipy.special.ndtri(tail)) / math.sqrt(2.0 * campaigns)
    variance, held = 2.0 * spread, CONFIDENCE
    if _variance_is_estimated(setup):
        spread *= math.sqrt(1.0 + 1.0 / _effective_dof(setup))  # the stated σ scatter too
        held = 1.0 - 2.0 * float(
            scipy.special.stdtr(_effective_dof(setup), -interval_factor(setup))
        )
    few, many = (float(scipy.special.bdtrik(p, campaigns, held)) for p in (tail, 1.0 - tail))
    return Chance(
        (1.0 - spread, 1.0 + spread),
        (math.floor(few) / campaigns, math.ceil(many) / campaigns),
        (1.0 - variance, 1.0 + variance),
    )


def _part(setup: StudySetup, found: Sequence[CampaignEstimate]) -> Array:
    """Sums over some campaigns, (8, F), that those over all are formed of.

    Their number; of errors the mean and the squares about it; stated variances; intervals that hold
    the truth; squared bounds; of errors over the bound the mean and the squares about it.
    """
    errors, stated, bound = (
        np.array(values)
        for values in zip(*((one.errors, one.std, one.bound) for one in found), strict=True)
    )
    over_bound = errors / bound
    return np.array(
        [
            np.full(errors.shape[1], len(errors)),
            errors.mean(axis=0),
            len(errors) * errors.var(axis=0),
            np.sum(stated**2, axis=0),
            np.sum(np.abs(errors) <= interval_factor(setup) * stated, axis=0),
            np.sum(bound**2, axis=0),
            over_bound.mean(axis=0),
            len(errors) * over_bound.var(axis=0),
        ]
    )


def _parameters(setup: StudySetup, parts: Array) -> tuple[ParameterSummary, ...]:
    """Of all campaigns, from parts of them (K, 8, F)."""
    count, errors, squares, stated, covered, bound, over, over_squares = parts.swapaxes(0, 1)
    total = count.sum(axis=0)
    bias, variance = _pooled(count, errors, squares)
    columns = np.column_stack(
        [
            bias,
            np.sqrt(variance),
            np.sqrt(stated.sum(axis=0) / total),
            covered.sum(axis=0) / total,
            np.sqrt(bound.sum(axis=0) / total),
            _pooled(count, over, over_squares)[1],
        ]
    )
    return tuple(
        ParameterSummary(name, *row) for name, row in zip(setup.free, columns.tolist(), strict=True)
    )


def _pooled(count: Array, means: Array, squares: Array) -> tuple[Array, Array]:
    """Mean and variance (F,) of samples told by means and sums of squares about them, (K, F).

    Chan, Golub and LeVeque (1983).
    """
    total = count.sum(axis=0)
    mean = (count * means).sum(axis=0) / total
    scatter = squares.sum(axis=0) + (count * (means - mean) ** 2).sum(axis=0)
    return mean, scatter / (total - 1.0)


def _quantiles(values_mm: Array) -> tuple[float, ...] | None:
    """None where campaigns lack a value."""
    known = not np.isnan(values_mm).any()
    return tuple(np.quantile(values_mm, QUANTILES).tolist()) if known else None


@dataclass(frozen=True, slots=True)
class VerdictStatistics:
    """Counts of campaigns in which something went wrong, and the honesty of their σ."""

    campaigns: int
    """With a verdict."""
    failed: int
    """Without: they cannot be identified, which is no pass."""
    passed: int
    off: int
    """Passed with a parameter too far off in its σ."""
    worse: int
    """Passed with positions worse than stated."""
    wrong: int
    """Falsely accepted: passed with either."""
    named: int
    """Cause named, arm and place with it."""
    false_alarms: int
    errors_over_sigma: float | None
    """Root mean square; None where no σ is known."""
    covered: float | None
    """Share of 95 % intervals that hold the truth."""
    position_mm: float | None
    """Real error of positions over the workspace, rms: in half of the campaigns."""
    kept: Mapping[str, int]
    """How often each model was kept."""

    @property
    def false_acceptance_rate(self) -> float:
        """Falsely accepted campaigns over all with a verdict; 0 without any."""
        return self.wrong / max(self.campaigns, 1)


def verdict_statistics(rows: Sequence[CampaignRow]) -> VerdictStatistics:
    """Counts over campaigns."""
    found = [row.verdict for row in rows if row.verdict is not None]
    squares = _mean([(each.square_over_variance, each.known) for each in found])
    return VerdictStatistics(
        campaigns=len(found),
        failed=len(rows) - len(found),
        passed=sum(each.passed for each in found),
        off=sum(each.passed and each.off() for each in found),
        worse=sum(each.passed and each.worse for each in found),
        wrong=sum(each.falsely_accepted for each in found),
        named=sum(each.named for each in found),
        false_alarms=sum(each.false_alarm for each in found),
        errors_over_sigma=None if squares is None else math.sqrt(squares),
        covered=_mean([(each.covered, each.known) for each in found]),
        position_mm=statistics.median(each.position_mm for each in found) if found else None,
        kept=dict(sorted(Counter(each.model for each in found).items())),
    )


def by_size(rows: Sequence[CampaignRow]) -> dict[str, VerdictStatistics]:
    """Counts over the campaigns of each size of what goes wrong, by its words."""
    sizes = dict.fromkeys(row.what for row in rows)
    return {size: verdict_statistics([row for row in rows if row.what == size]) for size in sizes}


def _mean(weighted: Sequence[tuple[float | None, int]]) -> float | None:
    """Weighted mean of what is known; None without any."""
    known = [(value, weight) for value, weight in weighted if value is not None and weight]
    if not known:
        return None
    values, weights = zip(*known, strict=True)
    return float(np.average(values, weights=weights))
