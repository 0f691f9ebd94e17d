"""An identification as one JSON document: what `identify --json` prints and the journal keeps.

Lengths are in mm, angles in deg. A number that does not exist or is infinite is null.
"""

import math
from dataclasses import asdict, dataclass

import numpy as np
from pydantic import JsonValue

from campaigns.identification.identified import BeforeAfter, Covariance, Excluded, Identification
from campaigns.numerics.estimate import Noise
from campaigns.numerics.frames import Transform, paper_angles_rad

SCHEMA = "pkmcal/identification/1"


@dataclass(frozen=True, slots=True)
class ParameterEntry:
    """One parameter, in mm or deg."""

    nominal: float
    value: float
    delta: float
    std: float | None
    free: bool


def identification_document(found: Identification, seconds: float) -> dict[str, JsonValue]:
    """The document; `seconds` is what the solution took."""
    return {
        "schema": SCHEMA,
        **_asked(found),
        "converged": found.converged,
        "iterations": found.iterations,
        "rank": found.rank,
        "condition": _finite(found.condition),
        "dof": found.dof,
        "parameters": _parameters(found),
        "residuals_mm": _before_after(found.residuals),
        "unseen_mm": None if found.unseen is None else _before_after(found.unseen),
        "excluded": [_excluded(left) for left in found.excluded],
        "unobservable": [list(names) for names in found.unobservable],
        "known_by_priors_alone": [list(names) for names in found.by_priors_alone],
        "models": [asdict(model) for model in found.compared],
        "chi2": _chi2(found.noise, found.noise_in_words),
        "covariance": _covariance(found.covariance),
        "correlations": _correlations(found.covariance),
        "position_std_mm": None if found.position_std is None else asdict(found.position_std),
        "frame": None if found.tracker_from_base is None else _frame(found.tracker_from_base),
        "verdict": found.verdict,
        "reasons": list(found.reasons),
        "seconds": seconds,
    }


def _asked(found: Identification) -> dict[str, JsonValue]:
    """What was asked for."""
    request = found.request
    return {
        "estimator": request.estimator.value,
        "loss": {"shape": request.loss.shape.value, "scale": request.loss.scale},
        "outliers": request.outliers.value,
        "priors": {prior.name: prior.std for prior in request.knowledge.priors},
    }


def _parameters(found: Identification) -> dict[str, JsonValue]:
    """By name, each as a `ParameterEntry`."""
    return {
        p.name: asdict(ParameterEntry(p.nominal, p.value, p.delta, p.std, p.free))
        for p in found.parameters
    }


def _before_after(errors: BeforeAfter) -> dict[str, JsonValue]:
    return {"before": asdict(errors.before), "after": asdict(errors.after)}


def _excluded(left: Excluded) -> dict[str, JsonValue]:
    """The shot or the pair; the sizes only of an outlier."""
    named: dict[str, JsonValue] = {"pair": left.pair} if left.shot is None else {"shot": left.shot}
    return named | {"reason": left.reason} | (asdict(left.misfit) if left.misfit else {})


def _chi2(noise: Noise, in_words: str) -> dict[str, JsonValue]:
    return {
        "value": noise.chi2,
        "dof": noise.dof,
        "p": noise.p,
        "believable": noise.believable,
        "scale": noise.scale,
        "says": in_words,
    }


def _covariance(known: Covariance) -> dict[str, JsonValue]:
    return {"names": list(known.names), "matrix": known.matrix.tolist()}


def _correlations(known: Covariance) -> list[JsonValue]:
    return [
        {"a": each.first, "b": each.second, "value": each.value}
        for each in known.strong_correlations()
    ]


def _frame(tracker_from_base: Transform) -> dict[str, JsonValue]:
    """The translation, and the angles of the paper's eq. 23."""
    x_mm, y_mm, z_mm = tracker_from_base.translation_mm.tolist()
    phi, gamma, psi = np.degrees(paper_angles_rad(tracker_from_base)).tolist()
    return {
        "x_mm": x_mm,
        "y_mm": y_mm,
        "z_mm": z_mm,
        "phi_deg": phi,
        "gamma_deg": gamma,
        "psi_deg": psi,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
