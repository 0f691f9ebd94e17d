"""Tables on the model: its parameters, how surely they are known, what is left over.

The terminal shows some of them too, so nothing here needs matplotlib.
"""

from collections.abc import Iterator

from campaigns.estimation.information import Correlation
from campaigns.evaluation.decision import COVERAGE
from campaigns.evaluation.diagnostics import PPM, Doubt
from campaigns.evaluation.gains import NO_CHANGE
from campaigns.evaluation.residual_budget import ResidualBudget
from campaigns.files.table import Column, words
from campaigns.identification.known_lengths import KnownLengths, MeasuredKnownLength
from campaigns.identification.result import (
    ComparedModel,
    IdentificationResult,
    IdentifiedParameter,
    PositionStd,
)
from campaigns.mechanisms.parameters import ParameterSpace

DECIMALS = 4
"""Of parameters, and of what models leave."""
STRONGEST = 8
Named = tuple[str, IdentifiedParameter]


def parameters(interval: float | None, space: ParameterSpace) -> tuple[Column[Named], ...]:
    """Columns of parameters. `interval`: half-width of 95 % intervals in σ; None: not known."""
    return (
        words("parameter", lambda row: space[row[0]].label),
        words("unit", lambda row: space[row[0]].sign.strip()),
        *values(interval),
        Column("Δ ÷ σ", lambda row: _change_in_sigma(row[1]), decimals=1, signed=True),
        words("", lambda row: _shown(row[1], interval)),
    )


def values(interval: float | None) -> tuple[Column[Named], ...]:
    """Columns of parameters' values: nominal, identified, Δ, σ, ± 95 % with what is common."""

    def delta(row: Named) -> float | str:
        return row[1].delta if row[1].free else "held"

    def half_width(row: Named) -> float | None:
        std = _total_std(row[1])
        return None if std is None or interval is None else interval * std

    return (
        Column("nominal", lambda row: row[1].nominal, decimals=DECIMALS),
        Column("identified", lambda row: row[1].value, decimals=DECIMALS),
        Column("Δ", delta, decimals=DECIMALS, signed=True),
        Column("σ", lambda row: _std(row[1]), decimals=DECIMALS),
        Column("± 95 %", half_width, decimals=DECIMALS),
    )


DOUBTS: tuple[Column[Doubt], ...] = (
    words("doubt", lambda doubt: doubt.name),
    words("finding", lambda doubt: doubt.says),
    words("numbers", lambda doubt: _numbers_of(doubt)),
    words("what follows", lambda doubt: _consequence(doubt)),
)

MODELS: tuple[Column[ComparedModel], ...] = (
    words("model", lambda model: model.name),
    Column("parameters", lambda model: model.parameters),
    Column("BIC", lambda model: model.bic, decimals=0),
    Column("hold-out rms", lambda model: model.unseen_rms_mm, "mm", DECIMALS),
    words("", lambda model: model.outcome),
)

CORRELATIONS: tuple[Column[Correlation], ...] = (
    words("", lambda each: each.a),
    words("", lambda each: each.b),
    Column("ρ", lambda each: each.value, decimals=2, signed=True),
)


def budget(left: ResidualBudget) -> tuple[Column[tuple[str, float | str]], ...]:
    """Columns of residuals and their known causes."""
    return words(f"one {left.of}, 1 σ", lambda row: row[0]), Column("", lambda row: row[1], "mm")


def budget_rows(left: ResidualBudget) -> tuple[tuple[str, float | str], ...]:
    """Residuals and their known causes, mm."""
    repeated = left.repeatability_mm
    return (
        (f"residuals of the fitted {left.of}s, √(Σ r² / ν)", left.residual_mm),
        ("the tracker's stated uncertainty alone", left.instrument_mm),
        ("the robot's repeatability alone", "not measured" if repeated is None else repeated),
        ("left beyond the larger of the two", left.unexplained_mm),
    )


KNOWN_LENGTHS: tuple[Column[MeasuredKnownLength], ...] = (
    words("known length", lambda each: each.name),
    Column("pair", lambda each: each.pair),
    Column("known", lambda each: each.known_mm, "mm"),
    Column("measured", lambda each: each.measured_mm, "mm"),
    Column("residual", lambda each: each.residual_mm, "mm", DECIMALS, signed=True),
    Column("σ", lambda each: each.std_mm, "mm", DECIMALS),
)


def scale_in_words(found: KnownLengths) -> str:
    """The tracker's scale by known lengths."""
    ppm, std = PPM * found.scale.share, PPM * found.scale.std
    return f"the tracker's scale by known lengths: {ppm:+.1f} ± {std:.1f} ppm (1 σ)"


def positions_in_words(found: PositionStd) -> tuple[str, ...]:
    """Uncertainty of positions: of the random part, and of the whole."""
    random = (
        f"predicted error of position (1 σ): {found.mean:.4f} mm on average over the workspace, "
        f"{found.max:.4f} mm at most"
    )
    if found.left_out:
        random += f", but for {found.left_out} of its poses, which this robot cannot take"
    if found.total_mean is None or found.total_max is None:
        return (random,)
    parts = ", ".join(f"{name} {mm:.4f}" for name, mm in found.common.items())
    mean, most = COVERAGE * found.total_mean, COVERAGE * found.total_max
    whole = f"U of position (k = 2), errors common to all shots included: {mean:.4f} mm on average"
    return (
        random,
        f"{whole}, {most:.4f} mm at most",
        f"errors common to all shots (1 σ, mm): {parts}",
    )


def uncertainty_in_words(found: IdentificationResult) -> Iterator[str]:
    """Sentences on how well parameters and positions are known, without capitals and full stops."""
    if found.chi2 is not None:
        yield found.chi2.says
    if found.position_std_mm is not None:
        yield from positions_in_words(found.position_std_mm)


def interval_in_words(interval: float | None) -> str:
    """How 95 % intervals are formed of σ; empty where nothing tells them."""
    if interval is None:
        return ""
    why = "" if interval < COVERAGE else ", Student's factor: σ themselves are known a little only"
    return f"95 % intervals are ± {interval:.2f} σ{why}; σ includes errors common to all shots"


def _numbers_of(doubt: Doubt) -> str:
    return ", ".join(
        f"{name} {each}" if isinstance(each, str) else f"{name} {each:.4g}".replace("-", "−")
        for name, each in doubt.numbers.items()
    )


def _consequence(doubt: Doubt) -> str:
    if doubt.accepted:
        return "accepted all the same"
    return "no effect" if doubt.decision is None else f"verdict: {doubt.decision}"


def _std(found: IdentifiedParameter) -> float | None:
    return found.std if found.free else None


def _total_std(found: IdentifiedParameter) -> float | None:
    return _std(found) if found.total_std is None else found.total_std


def _shown(found: IdentifiedParameter, interval: float | None) -> str:
    if (std := _total_std(found)) is None:
        return ""
    return NO_CHANGE if abs(found.delta) <= max(COVERAGE, interval or 0.0) * std else ""


def _change_in_sigma(found: IdentifiedParameter) -> float | None:
    std = _std(found)
    return found.delta / std if std else None
