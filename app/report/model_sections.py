"""Rows of the tables on the model: its parameters, how surely they are known, what is left over.

The terminal shows some of them too, so nothing here needs matplotlib.
"""

from campaigns.evaluation.decision import COVERAGE
from campaigns.evaluation.doubts import Doubt
from campaigns.evaluation.gains import NO_CHANGE
from campaigns.evaluation.residual_budget import ResidualBudget
from campaigns.files.table import NOTHING, Row, number
from campaigns.identification.result import ComparedModel, Covariance, IdentifiedParameter

PARAMETER_DECIMALS = 4
STRONGEST = 8


def parameter_rows(
    parameters: dict[str, IdentifiedParameter], interval: float | None
) -> tuple[Row, ...]:
    """Rows of parameters: name, unit, old, new, Δ, σ, ± 95 %, Δ ÷ σ, whether that shows a change.

    `interval`: half-width of 95 % intervals in σ; None where nothing tells it.
    """
    return tuple(
        (
            *_name_and_unit(name),
            *parameter_cells(found),
            interval_cell(found, interval),
            _change_in_sigma(found),
            _shown(found, interval),
        )
        for name, found in parameters.items()
    )


def interval_cell(found: IdentifiedParameter, interval: float | None) -> str:
    """Half-width of a parameter's 95 % interval."""
    if not found.free or found.std is None or interval is None:
        return NOTHING
    return number(interval * found.std, PARAMETER_DECIMALS)


def interval_in_words(interval: float | None) -> str:
    """How 95 % intervals are formed of σ; empty where nothing tells them."""
    if interval is None:
        return ""
    why = "" if interval < COVERAGE else ", Student's factor: σ themselves are known a little only"
    return f"95 % intervals are ± {interval:.2f} σ{why}"


def doubt_rows(doubts: tuple[Doubt, ...]) -> tuple[Row, ...]:
    """Rows of doubts: name, sentence, numbers, what follows."""
    return tuple(
        (doubt.name, doubt.says, _numbers_of(doubt), _consequence(doubt)) for doubt in doubts
    )


def parameter_cells(found: IdentifiedParameter) -> Row:
    """Cells of a parameter: old, new, Δ, σ; the last two only if it was looked for."""
    values = [number(value, PARAMETER_DECIMALS) for value in (found.nominal, found.value)]
    if not found.free:
        return *values, "held", NOTHING
    delta = number(found.delta, PARAMETER_DECIMALS, signed=True)
    return *values, delta, number(found.std, PARAMETER_DECIMALS)


def model_rows(models: tuple[ComparedModel, ...]) -> tuple[Row, ...]:
    """Rows of compared models: name, parameters, BIC, rms of unseen pairs, outcome."""
    return tuple(
        (
            model.name,
            str(model.parameters),
            number(model.bic, 0),
            number(model.unseen_rms_mm, PARAMETER_DECIMALS),
            model.outcome,
        )
        for model in models
    )


def correlation_rows(known: Covariance) -> tuple[Row, ...]:
    """Rows of the strongest correlations: two parameters and their ρ."""
    return tuple(
        (each.a, each.b, number(each.value, 2, signed=True)) for each in known.strongest(STRONGEST)
    )


def budget_rows(left: ResidualBudget) -> tuple[Row, ...]:
    """Rows of residuals and their known causes, mm."""
    repeated = left.repeatability_mm
    return (
        (f"residuals of the fitted {left.of}s, √(Σ r² / ν)", number(left.residual_mm)),
        ("the tracker's stated uncertainty alone", number(left.instrument_mm)),
        (
            "the robot's repeatability alone",
            "not measured" if repeated is None else number(repeated),
        ),
        ("left beyond the larger of the two", number(left.unexplained_mm)),
    )


def _numbers_of(doubt: Doubt) -> str:
    return ", ".join(
        f"{name} {each}" if isinstance(each, str) else f"{name} {each:.4g}".replace("-", "−")
        for name, each in doubt.numbers.items()
    )


def _consequence(doubt: Doubt) -> str:
    if doubt.accepted:
        return "accepted all the same"
    return "told only" if doubt.decision is None else f"verdict: {doubt.decision}"


def _shown(found: IdentifiedParameter, interval: float | None) -> str:
    if not found.free or found.std is None:
        return ""
    expanded = max(COVERAGE, interval or 0.0) * found.std
    return NO_CHANGE if abs(found.delta) <= expanded else ""


def _name_and_unit(name: str) -> Row:
    stem, _, unit = name.rpartition("_")
    return stem, {"deg": "°"}.get(unit, unit)


def _change_in_sigma(found: IdentifiedParameter) -> str:
    return number(found.delta / found.std, 1, signed=True) if found.free and found.std else NOTHING
