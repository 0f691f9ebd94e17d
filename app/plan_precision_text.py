"""What a plan will tell, said to people and to programs."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from app.console import WARNING
from campaigns.design.sample_size import diminishing_returns_from
from campaigns.estimation.estimators import Estimator
from campaigns.planning.predicted_precision import (
    PlanPrecision,
    PrecisionCurvePoint,
    PredictedPrecision,
)

if TYPE_CHECKING:
    from app.console import Terminal

ONE_SIDED = 0.85
"""Share of approaches from one side from which on backlash and joint offset look alike."""

Row = tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class PlanForecast:
    """What a plan will tell, and how it was made."""

    foresight: PlanPrecision
    curve: tuple[PrecisionCurvePoint, ...]
    """What other numbers of shots would tell; empty where shots were not chosen."""
    estimator: Estimator
    placement: str
    criterion: str | None
    seed: int


def show_precision(terminal: "Terminal", forecast: PlanForecast) -> None:
    """All of it, for people."""
    std = forecast.foresight.expected.std_in_file_units
    rows = [(name, _with_unit(name, value)) for name, value in std.items()]
    title = f"What the plan will tell, by {forecast.estimator}"
    terminal.table(title, ("parameter", "predicted σ"), rows)
    for line in told_lines(forecast.foresight):
        terminal.say(line)
    for line in warnings(forecast.foresight):
        terminal.say(line, WARNING)
    if forecast.curve:
        columns = ("", "worst length", "worst angle", "position, mean")
        terminal.table("What other numbers of shots would tell", columns, _curve_rows(forecast))
        terminal.say(paying_line(forecast.curve))


def told_lines(foresight: PlanPrecision) -> Iterator[str]:
    """The worst parameters, positions, observability, approaches."""
    expected, prediction = foresight.expected, foresight.prediction
    if expected.tells_all:
        yield ", ".join(_worst(expected))
        std_mm = foresight.position_std_mm
        yield (
            f"positions in the workspace ±{std_mm.mean():.4f} mm on average, "
            f"±{std_mm.max():.4f} mm at most"
        )
        indices = ", ".join(f"{name} {value:.3g}" for name, value in prediction.indices.items())
        yield f"observability: condition {prediction.condition:.0f}, {indices}"
    shares = ", ".join(f"{share:.0%}" for share in foresight.from_below)
    yield f"shots to which joints 0 to 3 come from smaller angles: {shares}"


def warnings(foresight: PlanPrecision) -> Iterator[str]:
    """What speaks against measuring by this plan."""
    if not foresight.expected.tells_all:
        count = len(foresight.expected.names)
        yield f"too few shots to tell all {count} parameters: plan more, or --fix some"
    for joint, share in enumerate(foresight.from_below):
        if max(share, 1.0 - share) > ONE_SIDED:
            side = "smaller" if share > ONE_SIDED else "larger"
            yield (
                f"joint {joint} comes from {side} angles to {max(share, 1.0 - share):.0%} of the "
                "shots: its backlash would pass for a joint offset; try another --seed"
            )


def paying_line(curve: Sequence[PrecisionCurvePoint]) -> str:
    """When more shots stop paying."""
    shots = [at.expected.shots for at in curve]
    lengths = [at.expected.worst_length_mm for at in curve]
    angles = [at.expected.worst_angle_rad for at in curve]
    enough = diminishing_returns_from(shots, lengths if max(lengths) > 0.0 else angles)
    return (
        f"beyond about {enough} shots more of them only average: four times as many for half the σ"
    )


def precision_document(forecast: PlanForecast) -> dict[str, object]:
    """All of it, for programs."""
    foresight = forecast.foresight
    expected, prediction = foresight.expected, foresight.prediction
    return {
        "placement": forecast.placement,
        "estimator": forecast.estimator.value,
        "criterion": forecast.criterion,
        "seed": forecast.seed,
        "predicted_std": {name: finite(std) for name, std in expected.std_in_file_units.items()},
        "worst": {
            "length_mm": finite(expected.worst_length_mm),
            "angle_deg": finite(math.degrees(expected.worst_angle_rad)),
        },
        "position_error_mm": {
            "mean": finite(float(foresight.position_std_mm.mean())),
            "max": finite(float(foresight.position_std_mm.max())),
        },
        "observability": prediction.indices | {"condition": finite(prediction.condition)},
        "from_below": list(foresight.from_below),
        "curve": [_point(at) for at in forecast.curve] or None,
    }


def finite(value: float) -> float | None:
    """The value; None, which JSON knows, for what is not known."""
    return value if value < math.inf else None


def _curve_rows(forecast: PlanForecast) -> list[Row]:
    own = forecast.foresight.expected.shots
    return [
        (
            f"{at.expected.shots} shots{', this plan' if at.expected.shots == own else ''}",
            f"{at.expected.worst_length_mm:.4f} mm",
            f"{math.degrees(at.expected.worst_angle_rad):.4f} deg",
            f"{at.position_mm:.4f} mm",
        )
        for at in forecast.curve
    ]


def _point(at: PrecisionCurvePoint) -> dict[str, float]:
    return {
        "shots": at.expected.shots,
        "length_mm": at.expected.worst_length_mm,
        "angle_deg": math.degrees(at.expected.worst_angle_rad),
        "position_mm": at.position_mm,
    }


def _worst(expected: PredictedPrecision) -> Iterator[str]:
    """The length and the angle that are known worst, where there are such."""
    std = expected.std_in_file_units
    for kind, unit in (("length", "mm"), ("angle", "deg")):
        named = [name for name in std if name.endswith(f"_{unit}")]
        if named:
            worst = max(named, key=std.__getitem__)
            yield f"worst {kind} {worst} ±{_with_unit(worst, std[worst])}"


def _with_unit(name: str, std: float) -> str:
    return f"{std:.4f} {name.rsplit('_', 1)[1]}" if std < math.inf else "unknown"
