"""Measured lengths: values with one covariance, of the instrument and of the robot's own scatter.

A measured point differs from the point that the robot reaches on average by two independent errors:
the instrument's, and the scatter of that visit. Limits and comparisons are about the robot and not
about one visit, so both are in the uncertainty of every figure. They are kept apart, because an
estimated scatter has degrees of freedom, and because averaging reduces the scatter of independent
visits, but not errors of the instrument that all points may have in common.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.evaluation.decision import (
    FigureChange,
    Requirement,
    coverage_factor,
    decide_change,
    effective_dof,
)


@dataclass(frozen=True, slots=True)
class MeasuredLength:
    """Length with its standard uncertainty, in two parts, in the direction in which it lies."""

    value_mm: float
    instrument_mm: float
    """1 σ by the instrument."""
    robot_mm: float = 0.0
    """1 σ by the robot's scatter."""
    dof: float = math.inf
    """Degrees of freedom of the robot's scatter."""
    count: int = 1
    """Number of lengths of which this is the largest."""

    @property
    def standard_uncertainty_mm(self) -> float:
        """Both parts together, u."""
        return math.hypot(self.instrument_mm, self.robot_mm)

    @property
    def effective_dof(self) -> float:
        """Degrees of freedom of u."""
        return effective_dof(self.standard_uncertainty_mm**2, self.robot_mm**2, self.dof)

    @property
    def expanded_uncertainty_mm(self) -> float:
        """U = k u."""
        return coverage_factor(self.effective_dof, self.count) * self.standard_uncertainty_mm

    def requirement(self, name: str, limit_mm: float | None) -> Requirement:
        """Return the requirement that this length is within a limit."""
        return Requirement(
            name,
            self.value_mm,
            limit_mm,
            self.standard_uncertainty_mm,
            self.effective_dof,
            self.count,
        )

    @property
    def upper_mm(self) -> float:
        """Value with U, which is compared with a limit."""
        return self.value_mm + self.expanded_uncertainty_mm

    def with_scatter(self, scatter_mm: float) -> "MeasuredLength":
        """Return the length with another scatter of the robot, known as a bound."""
        return replace(self, robot_mm=scatter_mm, dof=math.inf)


@dataclass(frozen=True, slots=True)
class Comparison:
    """Comparison of one figure measured in two series of visits."""

    before: MeasuredLength
    after: MeasuredLength

    @property
    def change(self) -> FigureChange:
        """Decision on the difference: it counts only beyond its U."""
        difference_mm = self.after.value_mm - self.before.value_mm
        return decide_change(difference_mm, self._standard_mm, self._dof, self._count)

    @property
    def expanded_uncertainty_mm(self) -> float:
        """U of the difference."""
        return coverage_factor(self._dof, self._count) * self._standard_mm

    @property
    def _standard_mm(self) -> float:
        """Standard uncertainty of the difference: the visits of both series are independent."""
        return math.hypot(self.before.standard_uncertainty_mm, self.after.standard_uncertainty_mm)

    @property
    def _dof(self) -> float:
        """Degrees of freedom of the difference's uncertainty."""
        # One estimate of the scatter may stand in both, so that it is too small in both: the
        # uncertainties of the variances are added up, not their squares.
        uncertain = sum(
            length.standard_uncertainty_mm**2 / math.sqrt(length.effective_dof)
            for length in (self.before, self.after)
        )
        return max((self._standard_mm**2 / uncertain) ** 2, 1.0) if uncertain else math.inf

    @property
    def _count(self) -> int:
        """Number of figures of which either is the largest."""
        return max(self.before.count, self.after.count)


@dataclass(frozen=True, slots=True, eq=False)
class PointNoise:
    """Covariances of measured points by the instrument and by the robot's scatter, (N, 3, 3)."""

    instrument_mm2: Array
    robot_mm2: Array
    dof: float = math.inf
    """Degrees of freedom of the robot's scatter."""

    def __getitem__(self, rows: Index) -> "PointNoise":
        return PointNoise(self.instrument_mm2[rows], self.robot_mm2[rows], self.dof)

    def between(self, first: Index, second: Index) -> "PointNoise":
        """Return the noise of the vectors from the first points to the second, (M,) each."""
        instrument, robot = self.instrument_mm2, self.robot_mm2
        return PointNoise(
            instrument[first] + instrument[second], robot[first] + robot[second], self.dof
        )


def largest_length(
    vectors_mm: Array, noise: PointNoise, count: int | None = None
) -> MeasuredLength:
    """Return the largest length of vectors (M, 3), with a U that holds for the true largest.

    `count` is the number of lengths among which it was sought, M by default.
    """
    sizes = np.linalg.norm(vectors_mm, axis=1)
    instrument = lengths_std_mm(vectors_mm, noise.instrument_mm2)
    robot = lengths_std_mm(vectors_mm, noise.robot_mm2)
    return largest_of(sizes, instrument, robot, noise.dof, count or len(sizes))


def largest_of(
    sizes_mm: Array, instrument_mm: Array, robot_mm: Array, dof: float, count: int
) -> MeasuredLength:
    """Return the largest of sizes (M,) with 1 σ of both parts (M,)."""
    # A smaller value with a larger U may truly be the largest. So the parts are those of the value
    # that reaches farthest with its U; they are at least those of the largest value.
    parts = zip(sizes_mm.tolist(), instrument_mm.tolist(), robot_mm.tolist(), strict=True)
    lengths = [
        MeasuredLength(size, by_instrument, by_robot, dof, count)
        for size, by_instrument, by_robot in parts
    ]
    farthest = max(lengths, key=lambda length: length.upper_mm)
    return replace(farthest, value_mm=float(sizes_mm.max()))


def lengths_std_mm(vectors_mm: Array, covariance_mm2: Array) -> Array:
    """Return 1 σ of the lengths of vectors (M, 3), (M,), by their covariances (M, 3, 3).

    A length of 0 has the σ of its worst direction.
    """
    # first-order propagation (GUM 5.2.2): the gradient of |v| is v / |v|, which 0 does not have
    sizes = np.linalg.norm(vectors_mm, axis=1)
    along = vectors_mm / np.maximum(sizes, 1e-300)[:, None]
    variance = np.einsum("mi,mij,mj->m", along, covariance_mm2, along)
    worst = np.linalg.eigvalsh(covariance_mm2)[:, -1]
    return np.sqrt(np.where(sizes > 0.0, variance, worst))


def unsigned_excess_mm(errors_mm: Array, std_mm: Array) -> float:
    """Return by how much noise may enlarge the mean size of errors (M,), by their 1 σ (M,)."""
    # The size of an error of 0 with noise σ is √(2/π) σ on average, that of a large one has no
    # excess. Averaging does not reduce it. The exponent is half of a normal density's, so that
    # errors of 0 that were measured as 1 or 2 σ still count with most of their excess.
    noisy = std_mm > 0.0
    std = std_mm[noisy]
    excess = math.sqrt(2.0 / math.pi) * std * np.exp(-((errors_mm[noisy] / std) ** 2) / 4.0)
    return float(excess.sum()) / len(errors_mm)
