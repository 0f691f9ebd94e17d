"""What noise alone leaves: the paper's tests on a robot whose geometry is perfectly known.

Drawn, not measured: no cell, no identification. What a calibrated robot shows cannot be less.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app.papers.corbel2006 import printed
from app.papers.corbel2006.printed import Printed
from app.papers.corbel2006.summary import Distribution, distribution
from campaigns.arrays import Array
from campaigns.estimation.point_sets import (
    away_from_best_line,
    away_from_mean,
    farthest_apart,
    longest_mm,
)
from campaigns.mechanisms.par4 import PAR4
from campaigns.settings.sections import PlanConfig, ValidationConfig

DRAWS = 2000
SEED = 1


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """A test's figure by noise alone, in mm; `paper` is what was measured after calibration."""

    name: str
    noise: str
    draws_mm: Array
    paper: tuple[Printed, ...]

    @property
    def left(self) -> Distribution:
        """Summary of the draws."""
        return distribution(self.draws_mm.tolist())


def floors(rng: np.random.Generator, draws: int = DRAWS) -> tuple[Floor, ...]:
    """Of every test that the paper reports after calibration."""
    tests = ValidationConfig()
    repeated = "± 0.4/√3"
    unseen = PlanConfig().validation_pairs
    straightness = tuple(printed.STRAIGHTNESS_AFTER.values())

    def drawn(figure: Callable[[np.random.Generator], float]) -> Array:
        return np.array([figure(rng) for _ in range(draws)])

    return (
        Floor(
            "60 fitted pairs: largest error",
            "σ 0.015/√3",
            drawn(lambda rng: _fitted_pairs(rng, _tracked_pairs(rng, printed.PAIRS))),
            (printed.LARGEST_AFTER,),
        ),
        Floor(
            "60 fitted pairs: largest error",
            repeated,
            drawn(lambda rng: _fitted_pairs(rng, _repeated_pairs(rng, printed.PAIRS))),
            (printed.LARGEST_WITH_REPEATABILITY,),
        ),
        Floor(
            "rotation: 19 points, two most distant",
            repeated,
            drawn(lambda rng: most_distant_mm(scattered(rng, tests.rotation_steps))),
            (printed.ROTATION_AFTER,),
        ),
        Floor(
            "straightness: 17 points from best line",
            repeated,
            drawn(lambda rng: straightness_mm(_line(rng, tests.line_points))),
            straightness,
        ),
        Floor(
            "repeatability: radius of 28 points",
            repeated,
            drawn(lambda rng: _radius(scattered(rng, tests.repeatability_approaches))),
            (printed.RADIUS,),
        ),
        Floor(
            "20 unseen pairs: mean error",
            repeated,
            drawn(lambda rng: float(np.abs(_repeated_pairs(rng, unseen)).mean())),
            (printed.MEAN_AFTER,),
        ),
        Floor(
            "20 unseen pairs: largest error",
            repeated,
            drawn(lambda rng: float(np.abs(_repeated_pairs(rng, unseen)).max())),
            (printed.MAX_AFTER,),
        ),
    )


def scattered(rng: np.random.Generator, count: int) -> Array:
    """Points that should be one, (count, 3)."""
    half = printed.REPEATABILITY_MM
    return rng.uniform(-half, half, (count, 3))


def _line(rng: np.random.Generator, count: int) -> Array:
    points = scattered(rng, count)
    points[:, 0] += np.linspace(0.0, printed.LINES_MM[0], count)
    return points


def most_distant_mm(points: Array) -> float:
    """The rotation test's figure of points (N, 3), N > 1."""
    first, second = farthest_apart(points)
    return float(np.linalg.norm(points[first] - points[second]))


def straightness_mm(points: Array) -> float:
    """Largest distance of points (N, 3) from their best line."""
    return longest_mm(away_from_best_line(points))


def _radius(points: Array) -> float:
    return longest_mm(away_from_mean(points))


def _tracked_pairs(rng: np.random.Generator, count: int) -> Array:
    """Errors of distances by the tracker's noise, (count,)."""
    return rng.normal(0.0, np.sqrt(2.0) * printed.TRACKER_NOISE_MM, count)


def _repeated_pairs(rng: np.random.Generator, count: int) -> Array:
    """Errors of distances that are long against the noise: only along them it counts, (count,)."""
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    between = scattered(rng, count) - scattered(rng, count)
    return np.asarray(np.sum(direction * between, axis=1))


def _fitted_pairs(rng: np.random.Generator, errors_mm: Array) -> float:
    """The largest residual when 22 parameters have taken their share of the errors.

    A drawn parameter space stands for the robot's.
    """
    space = rng.standard_normal((len(errors_mm), len(PAR4.parameters.free_by_default)))
    basis = np.linalg.qr(space)[0]
    return float(np.abs(errors_mm - basis @ (basis.T @ errors_mm)).max())
