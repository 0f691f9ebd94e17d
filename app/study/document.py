"""The study as one JSON document."""

import json
from collections.abc import Sequence

from app.study.comparison import Compared
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.summary import ParameterSummary

SCHEMA = "pkmcal/study/1"


def study_document(compared: Sequence[Compared], seed: int, seconds: float) -> dict[str, object]:
    """Everything; what there is not is null."""
    return {
        "schema": SCHEMA,
        "seed": seed,
        "combinations": [_combination(one) for one in compared],
        "computed": sum(one.studied.computed for one in compared),
        "lost": sum(one.studied.lost for one in compared),
        "seconds": seconds,
    }


def document_text(document: dict[str, object]) -> str:
    """As it is kept."""
    return json.dumps(document, allow_nan=False, indent=1) + "\n"


def _combination(one: Compared) -> dict[str, object]:
    plan, scenario, estimator, model = one.combination.words
    setup, summary, studied = one.combination.setup, one.summary, one.studied
    return {
        "plan": plan,
        "scenario": scenario,
        "estimator": estimator,
        "model": model,
        "shots": len(setup.fitted),
        "pairs": len(setup.shots.whole_pairs(ShotSet.IDENTIFICATION).rows),
        "study": one.combination.table.study,
        "campaigns": summary.campaigns,
        "failed": summary.failed,
        "lost": studied.lost,
        "computed": studied.computed,
        "parameters": {p.name: _parameter(p) for p in summary.parameters},
        "chance": {
            "ratio": summary.chance.ratio,
            "covered_95": summary.chance.covered,
            "variance_over_bound": summary.chance.variance_over_bound,
        },
        "unseen_mean_mm": _quantiles(summary.unseen_mean_mm),
        "unseen_max_mm": _quantiles(summary.unseen_max_mm),
        "unseen_relative": one.unseen_relative,
        "path": str(one.combination.table.path),
    }


def _parameter(p: ParameterSummary) -> dict[str, float]:
    return {
        "bias": p.bias,
        "std": p.std,
        "stated_std": p.stated_std,
        "ratio": p.ratio,
        "covered_95": p.covered,
        "bound_std": p.bound_std,
        "variance_over_bound": p.variance_over_bound,
    }


def _quantiles(values: tuple[float, ...] | None) -> dict[str, float] | None:
    return None if values is None else dict(zip(("median", "q95"), values, strict=True))
