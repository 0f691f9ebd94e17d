"""Wrong passes: how often a "pass" is wrong over judged campaigns, and causes are named."""

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.studies.judged import EffectOutcome, JudgedCampaign


@dataclass(frozen=True, slots=True)
class WrongPasses:
    """Counts of campaigns of one effect, and the honesty of their σ."""

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
    """Passed with either."""
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


def wrong_passes(outcomes: Sequence[EffectOutcome]) -> WrongPasses:
    """Counts over all campaigns of an effect."""
    judged = [each.judged for each in outcomes if each.judged is not None]
    return WrongPasses(
        len(judged),
        len(outcomes) - len(judged),
        sum(each.passed for each in judged),
        sum(each.passed and each.off() for each in judged),
        sum(each.passed and each.worse for each in judged),
        sum(each.wrong for each in judged),
        sum(each.named for each in judged),
        sum(each.false_alarm for each in judged),
        errors_over_sigma(judged),
        covered(judged),
        statistics.median(each.position_mm for each in judged) if judged else None,
        dict(sorted(Counter(each.model for each in judged).items())),
    )


def by_kind(outcomes: Sequence[EffectOutcome]) -> dict[str, WrongPasses]:
    """Counts over the campaigns of each size of an effect, by its words."""
    kinds = dict.fromkeys(each.what for each in outcomes)
    return {kind: wrong_passes([each for each in outcomes if each.what == kind]) for kind in kinds}


def errors_over_sigma(judged: Sequence[JudgedCampaign]) -> float | None:
    """Root mean square of all errors over their σ; None where no σ is known."""
    squares = [(each.square_over_variance, each.known) for each in judged if each.known]
    return math.sqrt(_mean(squares)) if squares else None


def covered(judged: Sequence[JudgedCampaign]) -> float | None:
    """Share of all 95 % intervals that hold the truth; None where no σ is known."""
    shares = [(each.covered, each.known) for each in judged if each.known]
    return _mean(shares) if shares else None


def _mean(weighted: Sequence[tuple[float, int]]) -> float:
    values, weights = zip(*weighted, strict=True)
    return float(np.average(values, weights=weights))
