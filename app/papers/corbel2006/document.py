"""The comparison as one JSON document."""

from collections.abc import Sequence

from app.papers.corbel2006.comparison import Comparison, ParameterRow, Row
from app.papers.corbel2006.quantities import Group
from app.papers.corbel2006.runner import Failure
from app.papers.corbel2006.summary import Distribution
from app.papers.corbel2006.verdict import Verdict

SCHEMA = "pkmcal/reproduction/1"


def document_of(
    comparison: Comparison, verdict: Verdict, failures: Sequence[Failure]
) -> dict[str, object]:
    """All rows; what is not printed, asked or known is null."""
    return {
        "schema": SCHEMA,
        "seeds": verdict.seeds,
        "verdict": verdict.decision,
        "headline": verdict.headline,
        "figures": [
            _figure(compared.group, row) for compared in comparison.groups for row in compared.rows
        ],
        "table_2": [_parameter(row) for row in comparison.parameters],
        "failed": [
            {"experiment": f.trial.experiment.name, "seed": f.trial.seed, "reason": f.reason}
            for f in failures
        ],
    }


def _figure(group: Group, row: Row) -> dict[str, object]:
    quantity = row.quantity
    printed, asked = quantity.printed, quantity.asked
    return {
        "group": group.title,
        "experiment": group.experiment.name,
        "name": quantity.name,
        "unit": quantity.unit,
        "paper": None if printed is None else {"text": printed.text, "place": printed.place},
        "ours": _distribution(row.ours),
        "agrees": row.agrees,
        "reason": None if row.reason is None else row.reason.value,
        "asked": None if asked is None else {"low": asked.low, "high": asked.high},
        "passed": row.passed,
    }


def _parameter(row: ParameterRow) -> dict[str, object]:
    return {"name": row.name, "paper": row.printed, "ours": _distribution(row.ours), "std": row.std}


def _distribution(ours: Distribution) -> dict[str, object]:
    return {"median": ours.median, "low": ours.low, "high": ours.high, "seeds": ours.n}
