"""Evidence why ours differs from the paper, in numbers: noise alone, pairs' lengths, Table I."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from app.papers.corbel2006 import trials
from app.papers.corbel2006.comparison import Distribution, of_experiment
from app.papers.corbel2006.printed import LINES_MM, PAIRS, TRACKER_NOISE_MM, allowed, printed
from campaigns.arrays import AXES, Array, Mask
from campaigns.estimation.point_sets import away_from_best_line, diameter_mm, longest_mm
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot
from campaigns.settings.sections import PlanConfig, ValidationConfig

DRAWS = 2000
SEED = 1
GRID_MM = 25.0
EXTENT_MM = 1000.0
"""The grid reaches so far to every side of the base: further than any of the robots."""
PRINTED_LIMITS_RAD = (-np.pi / 4.0, np.pi / 4.0)

Drawn = Callable[[np.random.Generator], float]


@dataclass(frozen=True, slots=True, eq=False)
class Floor:
    """What noise alone leaves in a test on a robot whose geometry is perfectly known, mm.

    Drawn, not measured: no cell, no identification. A calibrated robot cannot show less.
    """

    name: str
    noise: str
    draws_mm: Array
    paper: tuple[str, ...]
    """In its words, after calibration."""

    @property
    def left(self) -> Distribution:
        """Summary of the draws."""
        return Distribution.of(self.draws_mm.tolist())


def floors(rng: np.random.Generator, draws: int = DRAWS) -> tuple[Floor, ...]:
    """Floors of the tests that bear on a difference from the paper."""
    tests, unseen = ValidationConfig(), PlanConfig().validation_pairs
    ideal = np.outer(np.linspace(0.0, LINES_MM[0], tests.line_points), (1.0, 0.0, 0.0))
    lines = tuple(printed(trials.PROTOTYPE, f"along {axis}, after") for axis in AXES)

    def floor(name: str, figure: Drawn, *paper: str, noise: str = "± 0.4/√3") -> Floor:
        return Floor(name, noise, np.array([figure(rng) for _ in range(draws)]), paper)

    return (
        floor(
            "60 fitted pairs: largest error",
            lambda rng: _fitted_mm(rng, _tracked_mm(rng, PAIRS)),
            printed(trials.SIMULATION, "fitted pairs, after"),
            noise="σ 0.015/√3",
        ),
        floor(
            "60 fitted pairs: largest error",
            lambda rng: _fitted_mm(rng, _repeated_mm(rng, PAIRS)),
            printed(trials.REPEATABILITY, "fitted pairs, after"),
        ),
        floor(
            "rotation: 19 points, two most distant",
            lambda rng: diameter_mm(_scattered(rng, tests.rotation_steps)),
            printed(trials.PROTOTYPE, "rotation, after"),
        ),
        floor(
            "straightness: 17 points from best line",
            lambda rng: longest_mm(away_from_best_line(ideal + _scattered(rng, tests.line_points))),
            *lines,
        ),
        floor(
            "20 hold-out pairs: mean error",
            lambda rng: float(np.abs(_repeated_mm(rng, unseen)).mean()),
            printed(trials.PROTOTYPE, "mean, after"),
        ),
        floor(
            "20 hold-out pairs: largest error",
            lambda rng: float(np.abs(_repeated_mm(rng, unseen)).max()),
            printed(trials.PROTOTYPE, "max, after"),
        ),
    )


def _scattered(rng: np.random.Generator, count: int) -> Array:
    """Points that should be one, (count, 3)."""
    return rng.uniform(-trials.REPEATABILITY_MM, trials.REPEATABILITY_MM, (count, 3))


def _tracked_mm(rng: np.random.Generator, count: int) -> Array:
    """Errors of distances by the tracker's noise, (count,)."""
    return rng.normal(0.0, np.sqrt(2.0) * TRACKER_NOISE_MM, count)


def _repeated_mm(rng: np.random.Generator, count: int) -> Array:
    """Errors of distances that are long against the noise: only along them it counts, (count,)."""
    direction = rng.standard_normal((count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    between = _scattered(rng, count) - _scattered(rng, count)
    return np.asarray(np.sum(direction * between, axis=1))


def _fitted_mm(rng: np.random.Generator, errors_mm: Array) -> float:
    """Largest residual when 22 parameters have taken their share of the errors.

    A drawn parameter space stands for the robot's.
    """
    space = rng.standard_normal((len(errors_mm), len(PAR4.parameters.free_by_default)))
    basis = np.linalg.qr(space)[0]
    return float(np.abs(errors_mm - basis @ (basis.T @ errors_mm)).max())


@dataclass(frozen=True, slots=True, eq=False)
class PairLengths:
    """Validation pairs of all seeds of the prototype before calibration, (M,) each, mm."""

    lengths_mm: Array
    errors_mm: Array
    """Without signs."""

    @property
    def share(self) -> float:
        """Mean error in mean distances."""
        return float(self.errors_mm.mean() / self.lengths_mm.mean())

    def length_for_mm(self, words: str) -> float:
        """Length of a pair that has on average the error that the paper prints in these words."""
        return float(np.mean(allowed(words))) / self.share


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """What of a grid over the whole space a robot reaches at θ = 0 (docs/model.md, erratum 3)."""

    name: str
    points: int | None
    """How many."""
    lines_mm: tuple[float, ...]
    """The longest straight lines along x, y and z anywhere on the grid."""


def reaches() -> tuple[Reach, ...]:
    """Reach as printed and by our reading, each with the printed joint limits and with ours.

    Only joints count: neither swing nor singularities, so this is generous.
    """
    axis = np.arange(-EXTENT_MM, EXTENT_MM + GRID_MM / 2.0, GRID_MM)
    grid = np.meshgrid(axis, axis, axis, indexing="ij")
    poses = np.pad(np.stack(grid, axis=-1).reshape(-1, 3), ((0, 0), (0, 1)))
    ours_rad = find_robot("par4-prototype").robot.limits.joint
    limits = (("±45°", PRINTED_LIMITS_RAD), ("−45° to 90°", ours_rad))
    found = []
    for robot, name in (("par4-table1", "par4-table1 (printed)"), ("par4-prototype",) * 2):
        joints = find_robot(robot).robot.kinematics.inverse(poses).values
        for words, (low, high) in limits:
            within = ((joints >= low) & (joints <= high)).all(axis=-1)  # NaN is not
            reached: Mask = np.asarray(within.reshape(grid[0].shape))
            lines_mm = tuple(_longest_mm(np.moveaxis(reached, which, -1)) for which in range(3))
            found.append(Reach(f"{name}, {words}", int(reached.sum()), lines_mm))
    return tuple(found)


def _longest_mm(grid: Mask) -> float:
    """Longest unbroken run along the last axis, from its first point to its last."""
    run = np.zeros(grid.shape[:-1], dtype=np.intp)
    longest = 0
    for place in range(grid.shape[-1]):
        run = np.where(grid[..., place], run + 1, 0)
        longest = max(longest, int(run.max()))
    return GRID_MM * max(longest - 1, 0)


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """All of it; what rests on seeds of the prototype is None without one."""

    floors: tuple[Floor, ...]
    reaches: tuple[Reach, ...]
    pairs: PairLengths | None


def evidence(results: Sequence[trials.TrialResult]) -> Evidence:
    """Draw and compute it."""
    pairs = None
    if own := of_experiment(results, trials.PROTOTYPE):
        lengths_mm = np.concatenate([result.before.lengths_mm for result in own])
        errors_mm = np.abs(np.concatenate([result.before.errors_mm for result in own]))
        pairs = PairLengths(lengths_mm, errors_mm)
    return Evidence(floors(np.random.default_rng(SEED)), reaches(), pairs)
