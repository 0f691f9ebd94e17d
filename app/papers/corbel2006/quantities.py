"""Quantities that are computed of a seed's result, by the names by which printed.py calls them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median
from typing import Literal

from app.papers.corbel2006.trials import Stage, TrialResult
from campaigns.arrays import AXES

Unit = Literal["mm", "deg", "%"]
OfStage = Callable[[Stage], float]


@dataclass(frozen=True, slots=True)
class Quantity:
    """Figure of a seed, and how it is written."""

    of: Callable[[TrialResult], float]
    unit: Unit = "mm"
    decimals: int = 2


def largest(errors_mm: Sequence[float]) -> float:
    """Size of the largest error."""
    return max(map(abs, errors_mm))


def gain_percent(of: OfStage, result: TrialResult) -> float:
    """Share of itself by which a figure has become smaller."""
    return 100.0 * (1.0 - of(result.after) / of(result.before))


def straightness_mm(axis: str, stage: Stage) -> float:
    """Straightness of the line along an axis."""
    return stage.straightness_mm[axis]


def _stages(name: str, of: OfStage) -> Iterator[tuple[str, Quantity]]:
    yield f"{name}, before", Quantity(lambda result: of(result.before))
    yield f"{name}, after", Quantity(lambda result: of(result.after))
    yield f"{name}, gain", Quantity(partial(gain_percent, of), "%", 0)


QUANTITIES = {
    "fitted pairs, before": Quantity(lambda result: largest(result.fitted.before_mm)),
    "fitted pairs, after": Quantity(lambda result: largest(result.fitted.after_mm), decimals=3),
    "unseen pairs, after": Quantity(lambda result: largest(result.unseen.after_mm), decimals=3),
    "worst of 18 lengths": Quantity(lambda result: max(result.missed("mm")), decimals=3),
    "middle one of 18 lengths": Quantity(lambda result: median(result.missed("mm")), decimals=3),
    "worst of 4 angles": Quantity(lambda result: max(result.missed("deg")), "deg", 4),
    "middle one of 4 angles": Quantity(lambda result: median(result.missed("deg")), "deg", 4),
    "radius of the sphere": Quantity(lambda result: result.before.radius_mm),
    "RP as ISO 9283 forms it": Quantity(lambda result: result.before.rp_mm),
    **dict(_stages("rotation", lambda stage: stage.rotation_mm)),
    **{
        name: quantity
        for axis in AXES
        for name, quantity in _stages(f"along {axis}", partial(straightness_mm, axis))
    },
    **dict(_stages("mean", lambda stage: stage.distance_mean_mm)),
    **dict(_stages("max", lambda stage: stage.distance_max_mm)),
    **dict(_stages("frame: mean", lambda stage: stage.frame_mean_mm)),
    **dict(_stages("frame: max", lambda stage: stage.frame_max_mm)),
}
