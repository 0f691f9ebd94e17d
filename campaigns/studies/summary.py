"""Summaries of a study: sizes of errors and honesty of σ; how often verdicts are wrong."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
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


OF_A_VERDICT = np.dtype(
    [(each, bool) for each in ("passed", "off", "worse", "wrong", "named", "alarm")]
    + [(each, float) for each in ("square", "covered", "known", "position_mm")]
)
"""What is kept of each verdict while they are read: 38 bytes."""


def verdict_statistics(rows: Iterable[CampaignRow]) -> VerdictStatistics:
    """Counts over campaigns, of which there may be more than fit into memory."""
    kept, failed = Counter[str](), 0

    def numbers() -> Iterator[tuple[float | None, ...]]:
        nonlocal failed
        for row in rows:
            if (each := row.verdict) is None:
                failed += 1
                continue
            kept[each.model] += 1
            off, worse = each.passed and each.off(), each.passed and each.worse
            alarms = each.named, each.false_alarm
            known = each.square_over_variance, each.covered, each.known, each.position_mm
            yield each.passed, off, worse, each.falsely_accepted, *alarms, *known

    found = np.fromiter(numbers(), dtype=OF_A_VERDICT)
    square = _mean(found["square"], found["known"])
    return VerdictStatistics(
        campaigns=len(found),
        failed=failed,
        passed=int(found["passed"].sum()),
        off=int(found["off"].sum()),
        worse=int(found["worse"].sum()),
        wrong=int(found["wrong"].sum()),
        named=int(found["named"].sum()),
        false_alarms=int(found["alarm"].sum()),
        errors_over_sigma=None if square is None else math.sqrt(square),
        covered=_mean(found["covered"], found["known"]),
        position_mm=float(np.median(found["position_mm"])) if len(found) else None,
        kept=dict(sorted(kept.items())),
    )


def _mean(values: Array, weights: Array) -> float | None:
    """Weighted mean of what is known, which is not NaN; None without any."""
    known = ~np.isnan(values) & (weights > 0.0)
    return float(np.average(values[known], weights=weights[known])) if known.any() else None
