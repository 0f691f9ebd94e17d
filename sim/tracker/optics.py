"""Optics of a tracker: its place in the base frame, and a point's uncertainty in its own.

A tracker measures a distance along its beam and two angles. A distance error lies along the beam,
an angle error across it and grows with the distance: the covariance of a point is an ellipsoid with
axes along the beam, across it horizontally and across it upward, and turns with the beam. Its sizes
come from a data sheet's maximum permissible errors (MPE, ISO 10360-10), which have the form

    MPE = constant + part per metre · distance        for each of the three directions.

A data sheet gives no distribution within the limits. As the GUM advises in this case (4.3.7) the
error is taken as uniform between them: the standard uncertainty is MPE/√3. Draws are normal with
this standard uncertainty.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from pydantic import model_validator

from sim.geometry import UP, Array
from sim.section import NotNegative, Positive, Section

MM_PER_M = 1000.0
UM_PER_MM = 1000.0
MPE_PER_SIGMA = math.sqrt(3.0)
"""Half-width of a uniform distribution over its standard deviation."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackerPose:
    """Pose of the tracker in the base frame."""

    origin_in_base_mm: Array
    base_from_tracker: Array
    """(3, 3) rotation."""

    def to_tracker_mm(self, point_in_base_mm: Array) -> Array:
        """Convert a point (3,) from the base frame to the tracker's, mm."""
        # the inverse of a rotation is its transpose
        return self.base_from_tracker.T @ (point_in_base_mm - self.origin_in_base_mm)


class Limit(Section):
    """A maximum permissible error of a + b · distance; its standard uncertainty is 1/√3 of it."""

    constant_um: NotNegative
    per_metre_um: NotNegative

    def sigma_mm(self, distance_mm: float) -> float:
        """Return the standard uncertainty at a distance, mm."""
        limit_um = self.constant_um + self.per_metre_um * distance_mm / MM_PER_M
        return limit_um / UM_PER_MM / MPE_PER_SIGMA


class Noise(Section):
    """Scatter of shots: equal on all coordinates, or that of a spherical instrument.

    Its limits are along the beam, across it horizontally (azimuth) and upward (elevation).
    """

    coordinate_mm: Positive | None = None
    """Standard deviation of each coordinate; or `along`, `azimuth` and `elevation`."""
    along: Limit | None = None
    """Limit along the beam."""
    azimuth: Limit | None = None
    """Limit across the beam, horizontally."""
    elevation: Limit | None = None
    """Limit across the beam, upward."""

    @model_validator(mode="after")
    def _is_one_of_two(self) -> Self:
        spherical = [limit is not None for limit in (self.along, self.azimuth, self.elevation)]
        if any(spherical) == (self.coordinate_mm is not None) or any(spherical) != all(spherical):
            raise ValueError("give either coordinate_mm, or along, azimuth and elevation")
        return self

    def spread_mm(self, point_in_tracker_mm: Array) -> Array:
        """Return a square root S (3, 3) of a shot's covariance S Sᵀ in the tracker's frame, mm."""
        if self.along is None or self.azimuth is None or self.elevation is None:
            return (self.coordinate_mm or 0.0) * np.eye(3)
        # S: unit axes of the beam as columns, each times its standard uncertainty
        distance_mm = float(np.linalg.norm(point_in_tracker_mm))
        limits = (self.along, self.azimuth, self.elevation)
        sigmas_mm = np.array([limit.sigma_mm(distance_mm) for limit in limits])
        return np.asarray(_beam_axes(point_in_tracker_mm) * sigmas_mm)

    @property
    def data_sheet(self) -> dict[str, float]:
        """Limits (MPE) by a data sheet of such a tracker: constants and parts per metre, µm.

        Across the beam they are the larger ones of azimuth and elevation.
        """
        # a data sheet has no limits of coordinates: equal limits in all directions are as wide
        if self.along is None or self.azimuth is None or self.elevation is None:
            limit_um = (self.coordinate_mm or 0.0) * UM_PER_MM * MPE_PER_SIGMA
            limit = Limit(constant_um=limit_um, per_metre_um=0.0)
            return Noise(along=limit, azimuth=limit, elevation=limit).data_sheet
        across = (self.azimuth, self.elevation)
        return {
            "along_um": self.along.constant_um,
            "along_um_per_m": self.along.per_metre_um,
            "across_um": max(limit.constant_um for limit in across),
            "across_um_per_m": max(limit.per_metre_um for limit in across),
        }


def _beam_axes(point_in_tracker_mm: Array) -> Array:
    """Return unit axes (3, 3) as columns: along the beam, across it horizontally, and upward."""
    # straight up or down no direction across the beam is special, and y is taken
    along = point_in_tracker_mm / np.linalg.norm(point_in_tracker_mm)
    level = np.cross(UP, along)
    horizontal = float(np.linalg.norm(level))
    azimuth = level / horizontal if horizontal > 0.0 else np.array([0.0, 1.0, 0.0])
    return np.column_stack([along, azimuth, np.cross(along, azimuth)])


def angle_between_rad(first: Array, second: Array) -> float:
    """Return the angle between two directions, rad."""
    # by the cross product too: the arc cosine loses half of the digits of a small angle
    (ux, uy, uz), (vx, vy, vz) = first.tolist(), second.tolist()
    across = math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)
    return math.atan2(across, ux * vx + uy * vy + uz * vz)


def direction_of(point_in_tracker_mm: Array) -> tuple[float, float]:
    """Return the horizontal angle and zenith angle, rad (zenith 0 is straight up)."""
    x, y, z = map(float, point_in_tracker_mm)
    return math.atan2(y, x), math.atan2(math.hypot(x, y), z)
