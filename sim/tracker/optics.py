"""Optics of a tracker: its place in the base frame, and a point's uncertainty in its own."""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.geometry import UP, Array

MM_PER_M = 1000.0
UM_PER_MM = 1000.0
MPE_PER_SIGMA = math.sqrt(3.0)
"""A data sheet's limit is read as the half-width of a uniform distribution."""


@dataclass(frozen=True, slots=True, eq=False)
class Station:
    """Pose of the tracker in the base frame."""

    origin_in_base_mm: Array
    base_from_tracker: Array
    """(3, 3) rotation."""

    def to_tracker_mm(self, point_in_base_mm: Array) -> Array:
        """(3,): the same point in the tracker's frame."""
        return self.base_from_tracker.T @ (point_in_base_mm - self.origin_in_base_mm)


class Noise(Protocol):
    """Scatter of a shot around the true point, in the tracker's frame."""

    def spread_mm(self, point_in_tracker_mm: Array) -> Array:
        """(3, 3): a square root S of the covariance, S Sᵀ, in mm."""
        ...


@dataclass(frozen=True, slots=True)
class IsotropicNoise:
    """Noise with the same standard deviation on every coordinate, everywhere."""

    coordinate_mm: float

    def spread_mm(self, point_in_tracker_mm: Array) -> Array:  # noqa: ARG002 - of the protocol
        """(3, 3): a square root S of the covariance, S Sᵀ, in mm."""
        return self.coordinate_mm * np.eye(3)


@dataclass(frozen=True, slots=True)
class Limit:
    """A maximum permissible error of a + b · distance."""

    constant_um: float
    per_metre_um: float

    def sigma_mm(self, distance_mm: float) -> float:
        """The standard uncertainty at that distance."""
        limit_um = self.constant_um + self.per_metre_um * distance_mm / MM_PER_M
        return limit_um / UM_PER_MM / MPE_PER_SIGMA


@dataclass(frozen=True, slots=True)
class SphericalNoise:
    """Along the beam, across it horizontally (azimuth) and across it upward (elevation)."""

    along: Limit
    azimuth: Limit
    elevation: Limit

    def spread_mm(self, point_in_tracker_mm: Array) -> Array:
        """(3, 3): a square root S of the covariance, S Sᵀ, in mm."""
        distance_mm = float(np.linalg.norm(point_in_tracker_mm))
        limits = (self.along, self.azimuth, self.elevation)
        sigmas_mm = np.array([limit.sigma_mm(distance_mm) for limit in limits])
        spread_mm: Array = _beam_axes(point_in_tracker_mm) * sigmas_mm
        return spread_mm


def _beam_axes(point_in_tracker_mm: Array) -> Array:
    """(3, 3), columns: along the beam, across it horizontally, across it upward."""
    along = point_in_tracker_mm / np.linalg.norm(point_in_tracker_mm)
    level = np.cross(UP, along)
    horizontal = float(np.linalg.norm(level))
    azimuth = level / horizontal if horizontal > 0.0 else np.array([0.0, 1.0, 0.0])
    return np.column_stack([along, azimuth, np.cross(along, azimuth)])


def angle_between_rad(first: Array, second: Array) -> float:
    """The angle between two directions, exact for small ones too."""
    across = float(np.linalg.norm(np.cross(first, second)))
    return math.atan2(across, float(first @ second))


def direction_of(point_in_tracker_mm: Array) -> tuple[float, float]:
    """Horizontal angle and zenith angle, rad (zenith 0 is straight up)."""
    x, y, z = map(float, point_in_tracker_mm)
    return math.atan2(y, x), math.atan2(math.hypot(x, y), z)
