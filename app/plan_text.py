"""Predicted uncertainty of a plan, said to people and to programs."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from operator import itemgetter

from app.console import WARNING, Terminal
from app.progress import interval
from campaigns.design.restricted_space import Refusals, RestrictedSpace
from campaigns.design.sample_size import diminishing_returns_from
from campaigns.design.tours import EVEN_SHARE
from campaigns.estimation.information import Uncertainty
from campaigns.evaluation.decision import COVERAGE
from campaigns.planning.plan_check import CheckedPlan
from campaigns.planning.predicted_uncertainty import Forecast
from campaigns.workflow.planning import PlannedCampaign

ONE_SIDED = 0.85
"""Share of approaches from one side from which on backlash and joint offset look alike."""

BARELY_PPM = 100.0
"""σ of an encoder's ratio from which on wrong ratios of usual size hide."""

Row = tuple[str, ...]


def show_forecast(terminal: Terminal, planned: PlannedCampaign) -> None:
    """All of it, for people."""
    predicted = planned.forecast.predicted
    units = zip(predicted.std().items(), predicted.units, strict=True)
    rows = [(name, _with_unit(value, unit)) for (name, value), unit in units]
    terminal.table("Predicted uncertainty", ("parameter", "predicted σ"), rows)
    for line in told_lines(planned.forecast):
        terminal.say(line)
    for line in warnings(planned.forecast):
        terminal.say(line, WARNING)
    if planned.curve:
        columns = ("", "worst length", "worst angle", "position, mean")
        terminal.table("Predicted uncertainty by number of shots", columns, _curve_rows(planned))
        terminal.say(paying_line(planned.curve))


def told_lines(forecast: Forecast) -> Iterator[str]:
    """The worst parameters, positions, observability, approaches."""
    predicted, seen = forecast.predicted, forecast.seen
    if predicted.full_rank and seen is not None:
        yield ", ".join(_worst(predicted))
        std_mm = forecast.position_std_mm
        yield (
            f"positions in the workspace ±{std_mm.mean():.4f} mm on average, "
            f"±{std_mm.max():.4f} mm at most (1 σ)"
        )
        if (total_mm := forecast.total_position_std_mm) is not None:
            yield (
                "their U (k = 2), errors common to all shots included: "
                f"{COVERAGE * total_mm.mean():.4f} mm on average, "
                f"{COVERAGE * total_mm.max():.4f} mm at most"
            )
        indices = ", ".join(f"{name} {value:.3g}" for name, value in seen.indices.items())
        yield f"observability: condition {seen.condition:.0f}, {indices}"
    shares = ", ".join(f"{share:.0%}" for share in forecast.from_below)
    last = len(forecast.from_below) - 1
    yield f"shots to which joints 0 to {last} come from smaller values: {shares}"
    low, high = EVEN_SHARE
    uneven = [f"{n}" for n, each in enumerate(forecast.from_below) if not low <= each <= high]
    if uneven:
        joints = ", ".join(uneven)
        yield f"outside {low:.0%} to {high:.0%}, backlash is determined less well: joints {joints}"
    if forecast.ratio_std_ppm > BARELY_PPM:
        size = (
            f"to ±{forecast.ratio_std_ppm:.0f} ppm"
            if forecast.ratio_std_ppm < math.inf
            else "not at all"
        )
        yield f"an encoder's ratio, if freed, is barely determined: {size} (joints' span)"


def warnings(forecast: Forecast) -> Iterator[str]:
    """What speaks against measuring by this plan."""
    if not forecast.predicted.full_rank:
        count = len(forecast.predicted.names)
        yield f"too few shots to determine all {count} parameters: plan more, or --fix some"
    for joint, share in enumerate(forecast.from_below):
        if max(share, 1.0 - share) > ONE_SIDED:
            side = "smaller" if share > ONE_SIDED else "larger"
            yield (
                f"joint {joint} comes from {side} values to {max(share, 1.0 - share):.0%} of the "
                "shots: its backlash would pass for a joint offset; try another --seed"
            )


def paying_line(curve: Sequence[Forecast]) -> str:
    """When more shots stop paying."""
    shots = [at.shots for at in curve]
    lengths = [at.predicted.largest("mm") for at in curve]
    angles = [at.predicted.largest("deg") for at in curve]
    enough = diminishing_returns_from(shots, lengths if max(lengths) > 0.0 else angles)
    return (
        f"beyond about {enough} shots more of them only average: four times as many for half the σ"
    )


def forecast_document(planned: PlannedCampaign) -> dict[str, object]:
    """All of it, for programs."""
    forecast = planned.forecast
    predicted, seen = forecast.predicted, forecast.seen
    total_mm = forecast.total_position_std_mm
    assert seen is not None, "it is a plan's"
    assert total_mm is not None, "it is a plan's"
    return {
        "placement": planned.placement,
        "model": planned.model.value,
        "seed": planned.seed,
        "predicted_std": {name: finite(std) for name, std in predicted.std().items()},
        "predicted_total_std": {name: finite(std) for name, std in predicted.total_std().items()},
        "worst": {
            "length_mm": finite(predicted.largest("mm")),
            "angle_deg": finite(predicted.largest("deg")),
        },
        "position_error_mm": {
            "mean": finite(float(forecast.position_std_mm.mean())),
            "max": finite(float(forecast.position_std_mm.max())),
            "total_mean": finite(float(total_mm.mean())),
            "total_max": finite(float(total_mm.max())),
        },
        "observability": seen.indices | {"condition": finite(seen.condition)},
        "from_below": list(forecast.from_below),
        "curve": [_point(at) for at in planned.curve] or None,
    }


def finite(value: float) -> float | None:
    """The value; None, which JSON knows, for what is not known."""
    return value if value < math.inf else None


def _curve_rows(planned: PlannedCampaign) -> list[Row]:
    own = planned.forecast.shots
    return [
        (
            f"{at.shots} shots{', this plan' if at.shots == own else ''}",
            f"{at.predicted.largest('mm'):.4f} mm",
            f"{at.predicted.largest('deg'):.4f} deg",
            f"{at.position_std_mm.mean():.4f} mm",
        )
        for at in planned.curve
    ]


def _point(at: Forecast) -> dict[str, float]:
    return {
        "shots": at.shots,
        "length_mm": at.predicted.largest("mm"),
        "angle_deg": at.predicted.largest("deg"),
        "position_mm": float(at.position_std_mm.mean()),
    }


def _worst(predicted: Uncertainty) -> Iterator[str]:
    """The length and the angle that are known worst, where there are such."""
    every = tuple(zip(predicted.std().items(), predicted.units, strict=True))
    for kind, unit in (("length", "mm"), ("angle", "deg")):
        own = [(std, name) for (name, std), each in every if each == unit]
        if own:
            std, worst = max(own, key=itemgetter(0))
            yield f"worst {kind} {worst} ±{_with_unit(std, unit)}"


def _with_unit(std: float, unit: str) -> str:
    return f"{std:.4f} {unit}" if std < math.inf else "unknown"


def refusals_lines(space: RestrictedSpace, refusals: Refusals) -> Iterator[str]:
    """How far walls are kept off, how many candidates the space refuses, which zone how many."""
    yield (
        f"space: walls are kept off the measured point by the plate's radius of "
        f"{space.plate_radius_mm:g} mm and a margin of {space.margin_mm:g} mm"
    )
    by_zone = [f"{count} by {name}" for name, count in refusals.by_zone if count]
    zones = f": {', '.join(by_zone)}" if by_zone else ""
    yield (
        f"{refusals.refused} of {refusals.tried} candidates that could be measured "
        f"are refused ({refusals.refused / refusals.tried:.0%}){zones}"
    )


def plate_warning(space: RestrictedSpace) -> str:
    """What speaks against walls kept off a plate that nobody has measured; empty: nothing."""
    if not space.is_restricted or space.plate_radius_mm > 0.0:
        return ""
    return (
        "the robot file does not say how far the plate reaches from the measured point: walls are "
        "kept off that point only; give space.plate_radius_mm in campaign.yaml"
    )


def plan_line(checked: CheckedPlan) -> str:
    """What a plan holds and takes, in one line."""
    counts = Counter(shot.purpose.value for shot in checked.shots)
    sets = ", ".join(f"{count} {purpose}" for purpose, count in counts.items())
    took = interval((checked.seconds, checked.seconds))
    return f"{len(checked.shots)} shots ({sets}), about {took}"
