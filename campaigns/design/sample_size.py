"""Sample size: the fewest measurements that meet a goal, and where more stop paying."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import count as counted_from

import numpy as np

from campaigns.arrays import Index
from campaigns.design import exchange
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import Criterion
from campaigns.estimation.information import covariance

DIMINISHING_RETURNS_RATIO = 1.1
"""Factor of the least σ √N within which more measurements only average."""
CURVE_STEP = math.sqrt(2.0)
"""Factor from one number on a curve to the next."""


@dataclass(frozen=True, slots=True, eq=False)
class DesignPoint:
    """A design of some size, and what it tells of the parameters that are known worst."""

    chosen: Index
    """Rows of its candidates, (N,)."""
    worst_length_mm: float

    @property
    def count(self) -> int:
        """Number of its measurements."""
        return len(self.chosen)


class GoalOutOfReach(ValueError):
    """Even the `best` of the designs allowed, the largest, does not meet the goal."""

    def __init__(self, best: DesignPoint, goal_mm: float) -> None:
        super().__init__(
            f"{best.count} measurements give σ {best.worst_length_mm:.4f} mm for the worst length, "
            f"goal {goal_mm:g} mm"
        )
        self.best = best


def design_curve(
    candidates: Candidates,
    criterion: Criterion,
    counts: Iterable[int],
    rng: np.random.Generator,
    chosen: Index | None = None,
) -> Iterator[DesignPoint]:
    """Designs of each of the increasing `counts`, each grown from the one before.

    The first is grown from `chosen`, if there are such. Growth is quick, and gives a σ within some
    percent of an exchanged design's. Raises as `optimal_design`.
    """
    for count in counts:
        if chosen is None:
            chosen = exchange.optimal_design(candidates, criterion, count, rng, starts=1).chosen
        else:
            chosen = exchange.augment_quickly(candidates, criterion, chosen, count)
        yield evaluate(candidates, chosen)


def curve_counts(fewest: int, most: int, step: int) -> Iterator[int]:
    """Multiples of `step`, from `fewest` to `most`, each about 1.4 times the one before."""
    for power in counted_from():
        count = step * math.ceil(fewest * CURVE_STEP**power / step - 0.5)
        if count > most:
            return
        yield count


def diminishing_returns_from(counts: Sequence[int], std: Sequence[float]) -> int:
    """The number from which more measurements only average: four times as many for half the σ."""
    scaled = np.array(std) * np.sqrt(counts)
    return counts[int(np.argmax(scaled <= DIMINISHING_RETURNS_RATIO * scaled.min()))]


def minimal_design(
    candidates: Candidates,
    criterion: Criterion,
    goal_mm: float,
    most: int,
    step: int,
    rng: np.random.Generator,
) -> DesignPoint:
    """The least multiple of `step`, up to `most`, at which every length's σ meets the goal.

    By doubling, then by the law that σ falls as 1/√N. Raises `GoalOutOfReach`, and as
    `optimal_design`.
    """
    fewest = minimum_count(candidates, step)
    tried: list[DesignPoint] = []
    for point in design_curve(candidates, criterion, _doubled(fewest, most), rng):
        tried.append(point)
        if point.worst_length_mm <= goal_mm:
            break
    else:
        raise GoalOutOfReach(tried[-1], goal_mm)
    low, good = tried[-2:] if len(tried) > 1 else (tried[0], tried[0])
    while good.count - low.count > step:
        count = _between(low, good, goal_mm, step)
        design = exchange.augment_design(candidates, criterion, low.chosen, count)
        point = evaluate(candidates, design.chosen)
        low, good = (low, point) if point.worst_length_mm <= goal_mm else (point, good)
    return good


def minimum_count(candidates: Candidates, step: int) -> int:
    """The least multiple of `step` that tells all unknowns apart; raises `Unobservable`."""
    return step * math.ceil(exchange.minimum_measurements(candidates) / step)


def _between(low: DesignPoint, good: DesignPoint, goal_mm: float, step: int) -> int:
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


def evaluate(candidates: Candidates, chosen: Index) -> DesignPoint:
    """Design of the chosen candidates, with the σ of the length known worst, zero without any."""
    std = np.sqrt(np.diag(covariance(candidates.jacobian(chosen))))
    length_mm = float(std[: candidates.parameters][candidates.is_length].max(initial=0.0))
    return DesignPoint(chosen, length_mm)
