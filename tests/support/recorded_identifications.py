"""Findings of identifications as journals hold them, made by hand."""

SPREAD = {"mean_abs": 1.0, "rms": 1.5, "max_abs": 3.0}
PROVENANCE = {
    "series": 1,
    "shots": 160,
    "robot_digest": "c" * 64,
    "plan_digest": "a" * 64,
    "journal_digest": "b" * 64,
    "journal_records": 500,
    "at_utc": "2026-03-02T08:00:00Z",
}


def body(parameters: dict[str, dict[str, object]], /, **changes: object) -> dict[str, object]:
    """Body of a finding that passed."""
    found = {
        "schema": "pkmcal/identification/2",
        "model": "full",
        "converged": True,
        "iterations": 9,
        "parameters": parameters,
        "excluded": [],
        "residuals_mm": {"before": SPREAD, "after": SPREAD},
        "unseen_mm": {"before": SPREAD, "after": SPREAD},
        "verdict": "pass",
        "reasons": ["hold-out pairs: better"],
        "seconds": 0.1,
    }
    return found | PROVENANCE | changes
