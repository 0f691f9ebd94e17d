"""What an identification is worth, in words: scatter, reasons, verdict."""

from collections.abc import Iterator
from dataclasses import dataclass

from campaigns.estimation.estimate import ChiSquareTest
from campaigns.estimation.estimators import Estimator, LossShape
from campaigns.estimation.least_squares import Solution
from campaigns.identification.result import (
    BeforeAfter,
    Combination,
    Excluded,
    IdentificationRequest,
    OutlierResidual,
    Verdict,
)

NOTHING_SHOWN = "no validation pairs: nothing shows that the result holds elsewhere"
MANY_OUTLIERS = 0.1
"""With a larger share of outliers they are no single mistakes."""


def noise_in_words(noise: ChiSquareTest, request: IdentificationRequest) -> str:
    """Whether the scatter is as the tracker states, and what follows for σ."""
    if noise.ratio is None:
        return "no degrees of freedom: nothing shows whether the shots scatter as stated"
    test = f"χ² {noise.chi2:.0f} with {noise.dof} degrees of freedom"
    scatter = _scatter_in_words(noise, noise.ratio)
    if noise.scale is None:
        return f"{scatter} ({test}); too little is left of them to tell any σ"
    if request.estimator is Estimator.DISTANCES:
        return f"{scatter} ({test}); σ come from the scatter"
    if request.loss.shape is not LossShape.LINEAR:
        return f"{scatter} ({test}); σ are {noise.scale:.2g} times what is stated, by the loss"
    if noise.believable:
        return f"{scatter} ({test}); σ come from what it states"
    if noise.scale > 1.0:
        return (
            f"{scatter} ({test}): σ are multiplied by {_by(noise.scale, noise.ratio)} "
            "(repeatability, backlash or a model error)"
        )
    return f"{scatter} ({test}): its statement is careful, σ are left as they are"


def _by(scale: float, ratio: float) -> str:
    """Priors have a part in χ², but not in what σ are multiplied by."""
    return "it" if abs(scale - ratio) < 0.05 * ratio else f"{scale:.2g}"


def _scatter_in_words(noise: ChiSquareTest, ratio: float) -> str:
    if noise.believable:
        return "the shots scatter as the tracker states"
    return f"the scatter is {ratio:.2g} times what the tracker states"


def combination_in_words(names: Combination) -> str:
    """What became of parameters that nothing tells."""
    if len(names) == 1:
        return f"nothing tells {names[0]}: held at nominal"
    return f"{', '.join(names)} move together here: held at nominal along that combination"


def outlier_reason(misfit: OutlierResidual) -> str:
    """Why a shot or a pair was left out."""
    return (
        f"{misfit.size_mm:.3f} mm off what the others say: {misfit.size_sigma:.1f} σ, "
        f"limit {misfit.limit_sigma:.1f} σ"
    )


@dataclass(frozen=True, slots=True)
class VerdictEvidence:
    """What a verdict rests on."""

    kind: str
    """What was fitted, in the plural."""
    fit: Solution
    unobservable: tuple[Combination, ...]
    outliers: float
    """Their share in what was to be fitted."""
    residuals: BeforeAfter
    barely_known: tuple[tuple[str, float], ...]
    """Parameters that the shots hardly tell, with σ in file units."""
    contradicted: tuple[str, ...]
    """Priors that the shots contradict, in words."""
    unseen: BeforeAfter | None
    lost: tuple[Excluded, ...]
    """Unseen pairs that the identified robot cannot take."""


def identification_verdict(judged: VerdictEvidence) -> tuple[Verdict, tuple[str, ...]]:
    """Whether the result may be used; the reasons against it, or for it."""
    against = tuple(_reasons_against(judged))
    if against:
        return "fail", against
    if judged.unseen is None:
        return "not decided", (NOTHING_SHOWN,)
    before, after = judged.unseen.before, judged.unseen.after
    gain = (
        f"unseen pairs: mean {before.mean_abs:.3f} → {after.mean_abs:.3f} mm, "
        f"max {before.max_abs:.3f} → {after.max_abs:.3f} mm"
    )
    left = judged.residuals
    fitted = f"fitted {judged.kind}: rms {left.before.rms:.3f} → {left.after.rms:.4f} mm"
    return "pass", (gain, fitted)


def _reasons_against(judged: VerdictEvidence) -> Iterator[str]:
    """Why the result must not be used."""
    if not judged.fit.converged:
        yield judged.fit.message
    for names in judged.unobservable:
        prefix = "the data cannot tell apart: " if len(names) > 1 else ""
        yield f"{prefix}{combination_in_words(names)}"
    if judged.barely_known:
        name, std = max(judged.barely_known, key=lambda each: each[1])
        unit = "deg" if name.endswith("_deg") else "mm"
        yield (
            f"the data hardly tell {name}, ±{std:.3g} {unit}: measure at more different poses and "
            "angles θ, or hold it with --fix"
        )
    yield from judged.contradicted
    if judged.outliers > MANY_OUTLIERS:
        yield (
            f"{100.0 * judged.outliers:.0f} % of the {judged.kind} were left out, "
            f"limit {100.0 * MANY_OUTLIERS:.0f} %: so many are no single mistakes"
        )
    for each in judged.lost:
        yield f"unseen {each.what}: {each.reason}"
    errors = judged.unseen
    if errors is not None and not errors.after.rms <= errors.before.rms:
        yield f"unseen pairs got worse: rms {errors.before.rms:.4f} → {errors.after.rms:.4f} mm"
