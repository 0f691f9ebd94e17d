"""How many measurements are enough: the least that meet a goal, and when more stop paying."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.numerics.candidates import Candidates
from campaigns.numerics.criteria import Criterion
from campaigns.numerics.design import Design, grown_design, least_count, optimal_design
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.statistics import covariance

AVERAGING = 1.1
"""More measurements only average when σ √N is within this factor of the least."""


@dataclass(frozen=True, slots=True, eq=False)
class CurvePoint:
    """A design of some size, and what it tells of the parameters that are known worst."""

    design: Design
    worst_length_mm: float
    worst_angle_rad: float

    @property
    def count(self) -> int:
        """How many measurements it has."""
        return len(self.design.chosen)


@dataclass(frozen=True, slots=True, eq=False)
class Enough:
    """The least design found that meets the goal, and all that were tried, by size."""

    least: CurvePoint
    curve: tuple[CurvePoint, ...]


class GoalOutOfReach(ValueError):
    """Even the largest design allowed does not meet the goal; `best_mm` is the σ it gives."""

    def __init__(self, best: CurvePoint, goal_mm: float) -> None:
        super().__init__(
            f"{best.count} measurements give σ {best.worst_length_mm:.4f} mm for the worst length, "
            f"goal {goal_mm:g} mm"
        )
        self.best_mm = best.worst_length_mm


def design_curve(
    candidates: Candidates, criterion: Criterion, counts: Iterable[int], rng: np.random.Generator
) -> Iterator[CurvePoint]:
    """Designs of each of the increasing `counts`, all but the first grown from the one before.

    Raises as `optimal_design`.
    """
    design: Design | None = None
    for count in counts:
        if design is None:
            design = optimal_design(candidates, criterion, count, rng)
        else:
            design = grown_design(candidates, criterion, design.chosen, count)
        yield _judged(candidates, design)


def averaging_from(curve: Sequence[CurvePoint]) -> int:
    """The count from which more measurements only average: four times as many for half the σ."""
    scaled = np.array([point.worst_length_mm * np.sqrt(point.count) for point in curve])
    return curve[int(np.argmax(scaled <= AVERAGING * scaled.min()))].count


def smallest_design(
    candidates: Candidates,
    criterion: Criterion,
    goal_mm: float,
    most: int,
    step: int,
    rng: np.random.Generator,
) -> Enough:
    """The least multiple of `step`, up to `most`, at which every length's σ meets the goal.

    By doubling, then by the law that σ falls as 1/√N. Raises `GoalOutOfReach`, and as
    `optimal_design`.
    """
    fewest = step * math.ceil(least_count(candidates) / step)
    tried: list[CurvePoint] = []
    for point in design_curve(candidates, criterion, _doubled(fewest, most), rng):
        tried.append(point)
        if point.worst_length_mm <= goal_mm:
            break
    else:
        raise GoalOutOfReach(tried[-1], goal_mm)
    low, good = tried[-2:] if len(tried) > 1 else (tried[0], tried[0])
    while good.count - low.count > step:
        count = _between(low, good, goal_mm, step)
        design = grown_design(candidates, criterion, low.design.chosen, count)
        tried.append(point := _judged(candidates, design))
        low, good = (low, point) if point.worst_length_mm <= goal_mm else (point, good)
    return Enough(good, tuple(sorted(tried, key=lambda point: point.count)))


def _between(low: CurvePoint, good: CurvePoint, goal_mm: float, step: int) -> int:
    """A count between one that fails and one that is good, where σ ~ 1/√N should just do."""
    expected = low.count * (low.worst_length_mm / goal_mm) ** 2
    return min(max(step * math.ceil(expected / step), low.count + step), good.count - step)


def _doubled(fewest: int, most: int) -> Iterator[int]:
    """`fewest`, twice that and so on, and at the end `most`."""
    count = fewest
    while count < most:
        yield count
        count *= 2
    yield most


def _judged(candidates: Candidates, design: Design) -> CurvePoint:
    return CurvePoint(design, *worst_std(candidates, design.chosen))


def worst_std(candidates: Candidates, chosen: Index) -> tuple[float, float]:
    """Largest σ of a length in mm and of an angle in rad; zero where there are none."""
    std = np.sqrt(np.diag(covariance(candidates.jacobian(chosen))))[: candidates.parameters]
    angle = np.array([name.endswith("_deg") for name in candidates.names])
    return _largest(std[~angle]), _largest(std[angle])


def _largest(values: Array) -> float:
    return float(values.max(initial=0.0))
