"""The laser tracker's uncertainty (spherical instrument) as covariance of a point."""

from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation import error_columns
from campaigns.estimation.point_sets import directions

LIMIT_PER_STD = 3**0.5
"""A data sheet's limit (MPE) over the standard uncertainty it stands for: an even distribution."""
MM_PER_UM = 1e-3
PER_MM_OF_UM_PER_M = 1e-6
WINSORISED_AT = 10.0
"""Times the median: a larger variance of a distance counts as that."""


@dataclass(frozen=True, slots=True)
class TrackerUncertainty:
    """Standard uncertainties (1 σ), along the beam and across it: a constant and a part per length.

    The defaults are a common tracker's limits, ± (10 µm + 0.3 µm/m) and ± (15 µm + 6 µm/m), each
    over √3.
    """

    along_mm: float = 0.010 / 3**0.5
    along_per_mm: float = 0.3e-6 / 3**0.5
    across_mm: float = 0.015 / 3**0.5
    across_per_mm: float = 6e-6 / 3**0.5
    scale: float = 2e-6 / 3**0.5
    """Of what all shots have in common, the share of every length: the tracker's and the air's."""
    axes_per_mm: float = 3e-6 / 3**0.5
    """Likewise of the misalignment of each of the instrument's axes and beam, rad."""
    reflector_mm: float = 0.01 / 3**0.5
    """Likewise of the reflector's constant, along the beam."""

    @classmethod
    def of_limits(
        cls, along_um: float, along_um_per_m: float, across_um: float, across_um_per_m: float
    ) -> "TrackerUncertainty":
        """Of an instrument whose data sheet has these limits (MPE)."""
        um, um_per_m = MM_PER_UM / LIMIT_PER_STD, PER_MM_OF_UM_PER_M / LIMIT_PER_STD
        return cls(
            along_um * um, along_um_per_m * um_per_m, across_um * um, across_um_per_m * um_per_m
        )

    def with_common_limits(
        self, scale_ppm: float, axes_um_per_m: float, reflector_mm: float
    ) -> "TrackerUncertainty":
        """The same with these limits of what all shots have in common."""
        ppm = PER_MM_OF_UM_PER_M / LIMIT_PER_STD
        return replace(
            self,
            scale=scale_ppm * ppm,
            axes_per_mm=axes_um_per_m * ppm,
            reflector_mm=reflector_mm / LIMIT_PER_STD,
        )


def point_covariance_mm2(points_from_tracker_mm: Array, uncertainty: TrackerUncertainty) -> Array:
    """Covariance (…, 3, 3) of points (…, 3) given from the tracker's origin, in the same axes.

    Across the beam both directions are taken alike, so no axis of the instrument is needed.
    """
    distance = np.linalg.norm(points_from_tracker_mm, axis=-1)
    beam = points_from_tracker_mm / distance[..., None]
    along = (uncertainty.along_mm + uncertainty.along_per_mm * distance) ** 2
    across = (uncertainty.across_mm + uncertainty.across_per_mm * distance) ** 2
    found = beam[..., :, None] * beam[..., None, :]
    found *= (along - across)[..., None, None]
    for axis in range(3):
        found[..., axis, axis] += across
    return np.asarray(found)


def common_shifts_mm(
    points_from_tracker_mm: Array, uncertainty: TrackerUncertainty
) -> dict[str, Array]:
    """Shifts of points, (N, 3) each, by one standard deviation of what all shots have in common.

    Points are given in the instrument's axes, z being its standing axis.
    """
    points, by_axes = points_from_tracker_mm, uncertainty.axes_per_mm
    return {
        "scale": uncertainty.scale * points,
        "transit axis": by_axes * error_columns.transit_axis(points)[:, :, 0],
        "collimation": by_axes * error_columns.collimation(points)[:, :, 0],
        "vertical index": by_axes * error_columns.vertical_index(points)[:, :, 0],
        "reflector": uncertainty.reflector_mm * error_columns.reflector_constant(points)[:, :, 0],
    }


def inverse_roots(covariance_mm2: Array) -> Array:
    """W with W C Wᵀ = 1 for each of covariances C, (…, 3, 3), lower triangular, by Cholesky.

    By hand for all at once, several times faster than a call for each; raises `LinAlgError`.
    """
    first, lower_y, lower_z, second, across, third = _cholesky(covariance_mm2)
    found = np.zeros(covariance_mm2.shape)
    found[..., 0, 0], found[..., 1, 1], found[..., 2, 2] = first, second, third
    found[..., 1, 0] = -lower_y * first * second
    found[..., 2, 1] = -across * second * third
    found[..., 2, 0] = (across * lower_y * second - lower_z) * first * third
    return found


def roots(covariance_mm2: Array) -> Array:
    """L with L Lᵀ = C for each of covariances C, (…, 3, 3), lower triangular, likewise."""
    first, lower_y, lower_z, second, across, third = _cholesky(covariance_mm2)
    found = np.zeros(covariance_mm2.shape)
    found[..., 0, 0], found[..., 1, 1], found[..., 2, 2] = 1.0 / first, 1.0 / second, 1.0 / third
    found[..., 1, 0], found[..., 2, 0], found[..., 2, 1] = lower_y, lower_z, across
    return found


def _cholesky(covariance_mm2: Array) -> tuple[Array, Array, Array, Array, Array, Array]:
    """Entries of L, (…) each: 1 / xx, yx, zx, 1 / yy, zy, 1 / zz."""
    (xx, _, _), (yx, yy, _), (zx, zy, zz) = np.moveaxis(covariance_mm2, (-2, -1), (0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        first = 1.0 / np.sqrt(xx)
        lower_y, lower_z = yx * first, zx * first
        second = 1.0 / np.sqrt(yy - lower_y**2)
        across = (zy - lower_z * lower_y) * second
        third = 1.0 / np.sqrt(zz - lower_z**2 - across**2)
    if not np.isfinite(first + second + third).all():
        raise np.linalg.LinAlgError("a covariance is not positive definite")
    return first, lower_y, lower_z, second, across, third


def distance_variance_mm2(
    points_mm: Array, covariance_mm2: Array, first: Index, second: Index
) -> Array:
    """Variance of the distances between rows `first` and `second` of points (N, 3), (M,).

    Of stacks of points (…, N, 3), (…, M).
    """
    direction = directions(points_mm, first, second)
    together = covariance_mm2[..., first, :, :] + covariance_mm2[..., second, :, :]
    return np.asarray(np.einsum("...mi,...mij,...mj->...m", direction, together, direction))


def common_distance_variance_mm2(
    points_mm: Array, uncertainty: TrackerUncertainty, first: Index, second: Index
) -> Array:
    """Part of their variance, (M,), by what all shots have in common; points from the tracker."""
    direction = directions(points_mm, first, second)
    apart = (
        each[second] - each[first] for each in common_shifts_mm(points_mm, uncertainty).values()
    )
    return np.asarray(sum(np.einsum("mi,mi->m", direction, each) ** 2 for each in apart))


def pooled_variance_mm2(variance_mm2: Array) -> float:
    """The one variance of all distances, of each (M,), for they count alike as in the paper.

    Their mean, on which no single statement has much influence.
    """
    most = WINSORISED_AT * np.median(variance_mm2)
    return float(np.mean(np.minimum(variance_mm2, most)))
