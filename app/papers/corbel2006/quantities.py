"""A figure that is set beside the paper's: where it comes from, what is printed and asked."""

from collections.abc import Callable
from dataclasses import dataclass
from statistics import median
from typing import Literal

from app.papers.corbel2006.experiments import Experiment
from app.papers.corbel2006.printed import Printed
from app.papers.corbel2006.reasons import Reason
from app.papers.corbel2006.trials import Stage, TrialResult

Value = Callable[[TrialResult], float]
OfStage = Callable[[Stage], float]


@dataclass(frozen=True, slots=True)
class Asked:
    """Lowest and highest median that is asked of us."""

    low: float
    high: float

    def holds(self, value: float) -> bool:
        """Whether a median is within."""
        return self.low <= value <= self.high

    def __str__(self) -> str:
        return f"{self.low:g} to {self.high:g}" if self.low else f"≤ {self.high:g}"


def at_most(limit: float) -> Asked:
    """Anything up to a limit."""
    return Asked(0.0, limit)


@dataclass(frozen=True, slots=True)
class Quantity:
    """One figure of one seed."""

    name: str
    of: Value
    printed: Printed | None = None
    reason: Reason | None = None
    """Why it differs from what is printed, if it does."""
    asked: Asked | None = None
    unit: Literal["mm", "deg", "%"] = "mm"
    decimals: int = 2


@dataclass(frozen=True, slots=True)
class Group:
    """Figures that the paper gives together."""

    title: str
    experiment: Experiment
    quantities: tuple[Quantity, ...]


def before(of: OfStage) -> Value:
    """A figure of the validation before calibration."""
    return lambda result: of(result.before)


def after(of: OfStage) -> Value:
    """A figure of the validation after calibration."""
    return lambda result: of(result.after)


def gain_percent(of: OfStage) -> Value:
    """By how much of itself a figure has become smaller."""
    return lambda result: 100.0 * (1.0 - of(result.after) / of(result.before))


def straightness(axis: str) -> OfStage:
    """Of the line along an axis."""
    return lambda stage: stage.straightness_mm[axis]


def largest_of(errors_mm: Callable[[TrialResult], tuple[float, ...]]) -> Value:
    """The largest error of distance."""
    return lambda result: max(map(abs, errors_mm(result)))


def worst_missed(unit: str) -> Value:
    """By how much the worst parameter of a unit, mm or deg, is missed."""
    return lambda result: max(result.missed(unit))


def middle_missed(unit: str) -> Value:
    """By how much the middle one of the parameters of a unit, mm or deg, is missed."""
    return lambda result: median(result.missed(unit))
