"""An identification as one JSON document: what `identify --json` prints and the journal keeps."""

import math
from dataclasses import asdict, dataclass

from pydantic import JsonValue

from campaigns.identify import BeforeAfter, Identification

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
    """The document; `seconds` is what the solution took. An infinite condition is null."""
    return {
        "schema": SCHEMA,
        "estimator": found.estimator,
        "converged": found.converged,
        "iterations": found.iterations,
        "rank": found.rank,
        "condition": found.condition if math.isfinite(found.condition) else None,
        "dof": found.dof,
        "parameters": _parameters(found),
        "residuals_mm": _before_after(found.residuals),
        "unseen_mm": None if found.unseen is None else _before_after(found.unseen),
        "excluded": [{"pair": left.pair, "reason": left.reason} for left in found.excluded],
        "unobservable": [list(names) for names in found.unobservable],
        "verdict": found.verdict,
        "reasons": list(found.reasons),
        "seconds": seconds,
    }


def _parameters(found: Identification) -> dict[str, JsonValue]:
    """By name, each as a `ParameterEntry`."""
    return {
        p.name: asdict(ParameterEntry(p.nominal, p.value, p.delta, p.std, p.free))
        for p in found.parameters
    }


def _before_after(errors: BeforeAfter) -> dict[str, JsonValue]:
    return {"before": asdict(errors.before), "after": asdict(errors.after)}
