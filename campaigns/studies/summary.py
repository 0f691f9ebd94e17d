"""Summary of a study: sizes of errors, and whether the stated σ are true.

For each parameter two figures compare errors with their stated σ: the ratio of their standard
deviation to the stated one (1 is honest), and the share of 95 % intervals that hold the truth. With
N campaigns both scatter by chance, so they are judged by limits in which all parameters of an
honest study lie in 99 % of studies.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import Array, Mask
from campaigns.errors import ShotsMissing
from campaigns.kinematics.axes import Interval
from campaigns.studies.study import CampaignEstimate, CampaignRow

CONFIDENCE = 0.95
COVERAGE_95 = 1.96
"""Half-width of 95 % intervals in σ."""
LEAST_CAMPAIGNS = 2
FALSE_ALARM = 0.01
"""Probability that at least one parameter of an honest study lies outside the limits of chance."""
UNSEEN_STD = 1e-9
"""Stated σ below which a parameter never moved, mm, deg or ppm: what rounding leaves of one that no
shot shows."""


@dataclass(frozen=True, slots=True)
class ParameterSummary:
    """Errors of one parameter over all campaigns, in file units (mm or deg)."""

    name: str
    bias: float
    """Mean error."""
    std: float
    """Standard deviation of the errors."""
    stated_std: float
    """Root mean square of the stated standard deviations."""
    covered: float
    """Share of 95 % intervals that hold the true value."""

    @property
    def ratio(self) -> float:
        """Empirical over stated standard deviation; 1 is honest."""
        return self.std / self.stated_std


@dataclass(frozen=True, slots=True)
class StudySummary:
    """Errors over all campaigns that ended with an estimate."""

    campaigns: int
    """Number of campaigns with an estimate."""
    failed: int
    """Number of campaigns without an estimate."""
    parameters: tuple[ParameterSummary, ...]
    """Bias, empirical and stated σ, their ratio and coverage of each free parameter that a shot
    shows."""
    unseen: tuple[str, ...]
    """Names of the parameters that no shot of any campaign shows: they never moved."""
    chance: Mapping[str, Interval]
    """Limits in which an honest study's figures lie, by `chance`."""
    position_mm: float
    """Real error of positions over the workspace, root mean square over the campaigns."""
    stated_mm: float
    """Stated error of positions over the workspace, root mean square over the campaigns."""

    def __repr__(self) -> str:
        ratios = [parameter.ratio for parameter in self.parameters]
        return (
            f"<StudySummary: {self.campaigns} campaigns, {self.failed} failed, empirical over "
            f"stated σ {min(ratios):.2f} to {max(ratios):.2f}>"
        )

    @property
    def too_sure(self) -> tuple[ParameterSummary, ...]:
        """Parameters whose stated σ is too small for their errors, beyond chance."""
        ratio, covered = self.chance["ratio"][1], self.chance["covered_95"][0]
        return tuple(p for p in self.parameters if p.ratio > ratio or p.covered < covered)

    @property
    def too_unsure(self) -> tuple[ParameterSummary, ...]:
        """Parameters whose stated σ is too large for their errors, beyond chance."""
        ratio, covered = self.chance["ratio"][0], self.chance["covered_95"][1]
        return tuple(p for p in self.parameters if p.ratio < ratio or p.covered > covered)


def summarise(free: Sequence[str], rows: Iterable[CampaignRow]) -> StudySummary:
    """Summarise the campaigns of a study with these free parameters.

    Raise `ShotsMissing` if fewer than two campaigns gave an estimate.
    """
    rows = tuple(rows)
    identified = estimates(rows)
    if len(identified) < LEAST_CAMPAIGNS:
        reasons = sorted({row.failure for row in rows if row.failure})
        raise ShotsMissing(
            f"{len(identified)} of {len(rows)} campaigns could be identified",
            remedy=f"ask for more campaigns, or look into: {'; '.join(reasons) or '-'}",
        )
    # Rows are campaigns, columns parameters. σ are averaged as variances, and so are positions.
    errors = np.array([estimate.errors for estimate in identified])
    stated = np.array([estimate.std for estimate in identified])
    seen = _seen(stated)
    columns = (
        errors.mean(axis=0),
        errors.std(axis=0, ddof=1),
        np.sqrt(np.mean(stated**2, axis=0)),
        np.mean(np.abs(errors) <= COVERAGE_95 * stated, axis=0),
    )
    positions = np.array([(row.position_mm, row.stated_mm) for row in identified])
    position_mm, stated_mm = np.sqrt(np.mean(positions**2, axis=0)).tolist()
    figures = np.column_stack(columns)
    return StudySummary(
        campaigns=len(identified),
        failed=len(rows) - len(identified),
        parameters=tuple(
            ParameterSummary(free[place], *figures[place].tolist())
            for place in np.flatnonzero(seen).tolist()
        ),
        unseen=tuple(free[place] for place in np.flatnonzero(~seen).tolist()),
        chance=chance(int(seen.sum()), len(identified)),
        position_mm=position_mm,
        stated_mm=stated_mm,
    )


def estimates(rows: Iterable[CampaignRow]) -> list[CampaignEstimate]:
    """Return the estimates of the campaigns that have one."""
    return [row.estimate for row in rows if row.estimate is not None]


def normal_scores(rows: Iterable[CampaignRow]) -> Array:
    """Return errors over their stated σ, (C, F): standard normal if the stated σ are true.

    Columns are the parameters that a shot shows.
    """
    identified = estimates(rows)
    errors = np.array([row.errors for row in identified])
    stated = np.array([row.std for row in identified])
    seen = _seen(stated)
    return np.asarray(errors[:, seen] / stated[:, seen])


def _seen(stated: Array) -> Mask:
    """Return which columns of stated σ (C, F) belong to parameters that a shot shows, (F,)."""
    return np.asarray(stated.max(axis=0) > UNSEEN_STD)


def chance(parameters: int, campaigns: int) -> dict[str, Interval]:
    """Return the limits in which all parameters of an honest study lie in 99 % of studies.

    `ratio` is by the normal approximation for σ, `covered_95` by the binomial distribution.
    """
    # Bonferroni: each parameter gets its part of the false alarms, on each side a half of that.
    # A standard deviation from C values scatters by about 1 / √(2 C) of itself; the number of
    # intervals that hold the truth is binomial, with the limits rounded outwards to whole counts.
    tail = FALSE_ALARM / (2.0 * parameters)
    spread = -float(scipy.special.ndtri(tail)) / math.sqrt(2.0 * campaigns)
    few, many = (float(scipy.special.bdtrik(p, campaigns, CONFIDENCE)) for p in (tail, 1.0 - tail))
    return {
        "ratio": (1.0 - spread, 1.0 + spread),
        "covered_95": (math.floor(few) / campaigns, math.ceil(many) / campaigns),
    }
