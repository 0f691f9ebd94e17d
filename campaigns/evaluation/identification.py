"""Verdict on an identification: whether its result may be used, and why."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import scipy

from campaigns.arrays import Array
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import ChiSquareTest, HoldOut
from campaigns.estimation.least_squares import Solution
from campaigns.estimation.variance_components import VarianceComponents
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.diagnostics import Doubt
from campaigns.evaluation.gains import NO_CHANGE
from campaigns.evaluation.summary import BeforeAfter
from campaigns.mechanisms.parameters import ParameterSpace

NOTHING_UNSEEN, TOO_FEW, UNTOLD, PRIOR, MANY_LEFT_OUT, LOST, WORSE = (
    "nothing-unseen",
    "too-few-shots",
    "untold-parameters",
    "contradicted-prior",
    "many-outliers",
    "unseen-not-taken",
    "unseen-worse",
)
"""Names of what stands against a result beside diagnostics."""
Combination = tuple[str, ...]
"""Parameters that move together without any effect on what was measured."""

NOTHING_SHOWN = (
    "no validation pairs: nothing shows that the result holds elsewhere; `identify --hold-out 20%` "
    "keeps some of the shots for it"
)
NO_SIGMA = (
    "the uncertainty of the parameters is unknown: measure more than there are parameters, or "
    "identify from their coordinates, --estimator points"
)
PLAY = "play in the gears"
MANY_OUTLIERS = 0.1
"""With a larger share of outliers they are no single mistakes."""
WORSE_BEYOND = 0.95
"""Chance that hold-out pairs of equal models stay below."""
FEWEST_PAIRS = 3
"""By which chance can be told; with fewer the mean counts."""
WORTHLESS = {"mm": 5.0, "deg": 3.0, "ppm": 3000.0}
"""A σ of which the nominal value is a better guess than the identified one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentificationEvidence:
    """Evidence on which a verdict rests."""

    space: ParameterSpace
    kind: str
    """What was fitted, in the plural."""
    fit: Solution
    unobservable: tuple[Combination, ...]
    outliers: float
    """Their share in what was to be fitted."""
    residuals: BeforeAfter
    std: dict[str, float]
    """σ by name, mm and deg, of what is known."""
    contradicted: tuple[str, ...]
    """Priors that the shots contradict, in words."""
    unseen: BeforeAfter | None
    is_worse: bool
    """Whether hold-out pairs got worse beyond chance."""
    doubts: tuple[Doubt, ...]
    lost: tuple[str, ...]
    """Hold-out pairs that the identified robot cannot take, in words."""
    region: str | None = None
    """Part of the workspace that it is valid for, in words."""


def identification_verdict(
    evidence: IdentificationEvidence,
) -> tuple[Decision, tuple[str, ...], tuple[str, ...]]:
    """Decision whether the result may be used; the reasons against it, or for it, in words.

    Last the names of what stands against it: of diagnostics, or those above.
    """
    against = tuple(_reasons_against(evidence))
    if against:
        return "fail", tuple(says for _, says in against), tuple(name for name, _ in against)
    if evidence.unseen is None:
        return "not decided", (NOTHING_SHOWN,), (NOTHING_UNSEEN,)
    if not evidence.std:
        return "not decided", (NO_SIGMA,), (TOO_FEW,)
    open_ones = tuple(each for each in evidence.doubts if each.affects_verdict)
    if open_ones:
        names = tuple(each.name for each in open_ones)
        return "not decided", tuple(each.says for each in open_ones), names
    before, after = evidence.unseen.before, evidence.unseen.after
    gain = (
        f"hold-out pairs: mean {before.mean_abs:.3f} → {after.mean_abs:.3f} mm, "
        f"max {before.max_abs:.3f} → {after.max_abs:.3f} mm"
    )
    if after.rms > before.rms:
        gain += f" ({NO_CHANGE})"
    left = evidence.residuals
    fitted = f"fitted {evidence.kind}: rms {left.before.rms:.3f} → {left.after.rms:.4f} mm"
    region = (evidence.region,) if evidence.region else ()
    return "pass", (gain, fitted, *region), ()


def noise_in_words(
    noise: ChiSquareTest, estimator: Estimator, *, by_scatter: bool = True, robot: str = ""
) -> str:
    """Words on the scatter, stated or not, and what follows for σ."""
    if noise.birge_ratio is None:
        return "no degrees of freedom: nothing shows whether the shots scatter as stated"
    test = f"χ² {noise.chi2:.0f} with {noise.dof} degrees of freedom"
    scatter = _scatter_in_words(noise, noise.birge_ratio)
    if noise.sigma0 is None:
        return f"{scatter} ({test}); too few are left to state any σ"
    if estimator is Estimator.DISTANCES and by_scatter:
        also = " and from what it states" if noise.consistent else ""
        return f"{scatter} ({test}); σ come from the scatter{also}"
    if robot:
        more = f", and are multiplied by {noise.sigma0:.2g}" if noise.sigma0 > 1.0 else ""
        if noise.consistent:
            scatter = f"{scatter} and the robot scatters"
        elif estimator is Estimator.DISTANCES:
            scatter = f"{scatter} and the robot's own scatter make"
        return f"{scatter} ({test}): {robot}; σ include it{more}"
    if noise.consistent:
        return f"{scatter} ({test}); σ come from what it states"
    if noise.sigma0 > 1.0:
        return (
            f"{scatter} ({test}): σ are multiplied by {_by(noise.sigma0, noise.birge_ratio)} "
            "(repeatability, backlash or a model error)"
        )
    return f"{scatter} ({test}): its statement is careful, σ are left as they are"


def combination_in_words(names: Combination) -> str:
    """Words on parameters that no shot determines."""
    if len(names) == 1:
        return f"no shot determines {names[0]}: fixed at nominal"
    return f"{', '.join(names)} move together here: fixed at nominal along that combination"


def _by(sigma0: float, ratio: float) -> str:
    """Priors have a part in χ², but not in what σ are multiplied by."""
    return "it" if abs(sigma0 - ratio) < 0.05 * ratio else f"{sigma0:.2g}"


def _scatter_in_words(noise: ChiSquareTest, ratio: float) -> str:
    if noise.consistent:
        return "the shots scatter as the tracker states"
    return f"the scatter is {ratio:.2g} times what the tracker states"


def _reasons_against(evidence: IdentificationEvidence) -> Iterator[tuple[str, str]]:
    """Why the result must not be used: name and words."""
    if not evidence.fit.converged:
        yield TOO_FEW, evidence.fit.message
    for names in evidence.unobservable:
        prefix = "the data cannot tell apart: " if len(names) > 1 else ""
        yield UNTOLD, f"{prefix}{combination_in_words(names)}"
    space, std = evidence.space, evidence.std
    parts = {name: std[name] / WORTHLESS[space[name].unit] for name in std}
    barely_known = {name: std[name] for name in std if parts[name] > 1.0}
    if barely_known:
        name = max(barely_known, key=parts.__getitem__)
        worst = f"±{barely_known[name]:.3g} {space[name].unit}"
        more = "measure at more different poses, or fix it with --fix"
        yield UNTOLD, f"the data barely determine {name}, {worst}: {more}"
    yield from (
        (each.name, each.says)
        for each in evidence.doubts
        if each.affects_verdict and each.decision == "fail"
    )
    yield from ((PRIOR, says) for says in evidence.contradicted)
    if evidence.outliers > MANY_OUTLIERS:
        share = f"{100.0 * evidence.outliers:.0f} % of the {evidence.kind} were left out"
        limit = f"limit {100.0 * MANY_OUTLIERS:.0f} %"
        yield MANY_LEFT_OUT, f"{share}, {limit}: so many are no single mistakes"
    yield from ((LOST, says) for says in evidence.lost)
    errors = evidence.unseen
    if errors is not None and evidence.is_worse:
        worse = f"rms {errors.before.rms:.4f} → {errors.after.rms:.4f} mm"
        yield WORSE, f"hold-out pairs got worse: {worse}"


def worse_beyond_chance(before_mm: Array, after_mm: Array, tested: HoldOut | None) -> bool:
    """Whether errors of hold-out pairs (M,) grew, pair by pair and beyond chance (Student's).

    And are larger than σ say (`tested`, of those after): that shows that the model is wrong. Of a
    robot that is as its nominal parameters say nothing is to be gained, and noise in the fit costs
    a little.
    """
    more = after_mm**2 - before_mm**2
    count, mean = len(more), float(more.mean())
    if count < FEWEST_PAIRS:
        return mean > 0.0
    if tested and tested.believable:
        return False  # few pairs cannot tell: they are as far off as the model says
    factor = float(scipy.special.stdtrit(count - 1, WORSE_BEYOND))
    return mean > factor * float(more.std(ddof=1)) / math.sqrt(count)


def scatter_in_words(components: VarianceComponents, unit: str, scale: float) -> str:
    """The robot's own scatter, in the joints' file unit."""
    told = []
    if components.point_mm > 0.0:
        told.append(
            f"the point scatters by {components.point_mm:.3g} ± {components.point_mm_std:.1g} mm "
            "beside the tracker (repeatability)"
        )
    if components.joint > 0.0:
        value, std = components.joint / scale, components.joint_std / scale
        if unit == "deg":
            told.append(f"the joints scatter by {60.0 * value:.2g} ± {60.0 * std:.1g}′: {PLAY}")
        else:
            told.append(f"the joints scatter by {value:.2g} ± {std:.1g} mm: {PLAY}")
    return "; ".join(told)
