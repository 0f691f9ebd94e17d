"""An identification as one JSON document: what `identify --json` prints and the journal keeps."""

import math
from dataclasses import asdict

from pydantic import JsonValue

from campaigns.identify import BeforeAfter, Identification

SCHEMA = "pkmcal/identification/1"


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
        "parameters": {
            parameter.name: {
                "nominal": parameter.nominal,
                "value": parameter.value,
                "delta": parameter.delta,
                "std": parameter.std,
                "free": parameter.free,
            }
            for parameter in found.parameters
        },
        "residuals_mm": _before_after(found.residuals),
        "unseen_mm": None if found.unseen is None else _before_after(found.unseen),
        "excluded": [{"pair": left.pair, "reason": left.reason} for left in found.excluded],
        "unobservable": [list(names) for names in found.unobservable],
        "verdict": found.verdict,
        "reasons": list(found.reasons),
        "seconds": seconds,
    }


def _before_after(errors: BeforeAfter) -> dict[str, JsonValue]:
    return {"before": asdict(errors.before), "after": asdict(errors.after)}
