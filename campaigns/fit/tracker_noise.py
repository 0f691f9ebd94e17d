"""Uncertainty of a laser tracker (spherical instrument), as covariance of a point.

A tracker measures a distance along its beam and two angles. Its data sheet states limits (MPE,
ISO 10360-10) of both directions, each a constant and a part that grows with the distance r:

    u_along = a + b r,   u_across = c + d r,   Σ = u_along² b b' + u_across² (1 - b b')

with the beam's unit vector b. Errors that all shots have in common, such as the reflector's
constant, do not belong to this noise: the fit has them as unknowns (`error_sources.py`).
"""

from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.fit.error_sources import SOURCES, tracker_columns
from campaigns.fit.rigid_transforms import directions

LIMIT_PER_STD = 3**0.5
"""A data sheet's limit (MPE) over the standard uncertainty that it stands for: errors are taken as
evenly distributed between the limits (GUM 4.3.7)."""
MM_PER_UM = 1e-3
PER_MM_OF_UM_PER_M = 1e-6


@dataclass(frozen=True, slots=True)
class TrackerUncertainty:
    """Standard uncertainties (1 σ) along the beam and across it: a constant and a part per length.

    The defaults are a common tracker's limits, ± (10 µm + 0.3 µm/m) and ± (15 µm + 6 µm/m), each
    over √3. Those of errors that all shots have in common are the tolerances of the fit.

    Attributes:
        along_mm, along_per_mm: Along the beam: constant part, mm, and part per mm of distance.
        across_mm, across_per_mm: Across the beam, in each direction: the two parts again.
        scale, axes_per_mm, reflector_mm: Errors that all shots have in common.

    Example:
        >>> TrackerUncertainty.of_limits(10.0, 0.3, 15.0, 6.0)  # µm and µm/m, of a data sheet
    """

    along_mm: float = 0.010 / 3**0.5
    along_per_mm: float = 0.3e-6 / 3**0.5
    across_mm: float = 0.015 / 3**0.5
    across_per_mm: float = 6e-6 / 3**0.5
    scale: float = SOURCES["scale"].of_angles
    """Error of all lengths, a ratio: the tracker's and the air's."""
    axes_per_mm: float = SOURCES["transit"].of_angles
    """Transit axis out of square, rad."""
    reflector_mm: float = SOURCES["constant"].of_lengths
    """Error of the reflector's constant, along the beam."""

    @property
    def common(self) -> dict[str, float]:
        """1 σ of the errors that all shots have in common, by source: mm, rad and a ratio."""
        return {"constant": self.reflector_mm, "transit": self.axes_per_mm, "scale": self.scale}

    @classmethod
    def of_limits(
        cls, along_um: float, along_um_per_m: float, across_um: float, across_um_per_m: float
    ) -> "TrackerUncertainty":
        """Return the uncertainty of an instrument whose data sheet has these limits (MPE)."""
        um, um_per_m = MM_PER_UM / LIMIT_PER_STD, PER_MM_OF_UM_PER_M / LIMIT_PER_STD
        return cls(
            along_um * um, along_um_per_m * um_per_m, across_um * um, across_um_per_m * um_per_m
        )

    def with_common_limits(
        self, scale_ppm: float, axes_um_per_m: float, reflector_mm: float
    ) -> "TrackerUncertainty":
        """Return this uncertainty with other limits (MPE) of the errors common to all shots."""
        ppm = PER_MM_OF_UM_PER_M / LIMIT_PER_STD
        return replace(
            self,
            scale=scale_ppm * ppm,
            axes_per_mm=axes_um_per_m * ppm,
            reflector_mm=reflector_mm / LIMIT_PER_STD,
        )


def point_covariance_mm2(points_from_tracker_mm: Array, uncertainty: TrackerUncertainty) -> Array:
    """Return the covariance (…, 3, 3) of points (…, 3) seen from the tracker, in its axes."""
    along, across = covariance_by_direction_mm2(points_from_tracker_mm, uncertainty)
    return along + across


def covariance_by_direction_mm2(
    points_from_tracker_mm: Array, uncertainty: TrackerUncertainty
) -> tuple[Array, Array]:
    """Return the parts of a point's covariance along the beam and across it, (…, 3, 3) each."""
    distance = np.linalg.norm(points_from_tracker_mm, axis=-1)
    beam = points_from_tracker_mm / distance[..., None]
    outer = beam[..., :, None] * beam[..., None, :]
    along = (uncertainty.along_mm + uncertainty.along_per_mm * distance) ** 2
    across = (uncertainty.across_mm + uncertainty.across_per_mm * distance) ** 2
    return along[..., None, None] * outer, across[..., None, None] * (np.eye(3) - outer)


def distance_variance_mm2(
    points_mm: Array, covariance_mm2: Array, first: Index, second: Index
) -> Array:
    """Return the variance (M,) of the distances between rows `first` and `second` of (N, 3)."""
    direction = directions(points_mm, first, second)
    together = covariance_mm2[first] + covariance_mm2[second]
    return np.asarray(np.einsum("mi,mij,mj->m", direction, together, direction))


def common_distance_variance_mm2(
    points_mm: Array, uncertainty: TrackerUncertainty, first: Index, second: Index
) -> Array:
    """Return the variance (M,) of distances by the errors that all shots have in common.

    Points (N, 3) are seen from the tracker.
    """
    # both ends move by one error, so that a distance changes by the difference of the motions
    direction = directions(points_mm, first, second)
    variance = np.zeros(len(first))
    for source, column in tracker_columns(points_mm).items():
        shift = uncertainty.common[source] * column
        variance += ((shift[second] - shift[first]) * direction).sum(axis=1) ** 2
    return variance
