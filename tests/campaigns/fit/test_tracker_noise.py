"""The tracker's uncertainty as covariance of points and variance of distances."""

from dataclasses import astuple

import numpy as np
import pytest

from campaigns.fit.error_sources import tracker_columns
from campaigns.fit.tracker_noise import (
    TrackerUncertainty,
    distance_variance_mm2,
    point_covariance_mm2,
)

POINTS_MM = np.random.default_rng(7).uniform(-3000.0, 3000.0, (50, 3))
FIRST, SECOND = np.arange(0, 50, 2), np.arange(1, 50, 2)


def spherical(range_mm, azimuth, elevation):
    cos = np.cos(elevation)
    unit = np.array([cos * np.cos(azimuth), cos * np.sin(azimuth), np.sin(elevation)])
    return range_mm * unit


@pytest.mark.parametrize("point_mm", POINTS_MM[:10])
def test_covariance_is_that_of_range_azimuth_and_elevation(point_mm):
    """J diag(u_r², (r cos ε u_az)², (r u_el)²) Jᵀ, with both angles' uncertainties taken alike."""
    told = TrackerUncertainty(0.006, 2e-7, 0.009, 3.5e-6)
    distance = np.linalg.norm(point_mm)
    azimuth, elevation = np.arctan2(point_mm[1], point_mm[0]), np.arcsin(point_mm[2] / distance)
    across_mm = told.across_mm + told.across_per_mm * distance
    along_mm = told.along_mm + told.along_per_mm * distance
    at = np.array([distance, azimuth, elevation])
    by_instrument = np.column_stack(
        [
            (spherical(*(at + step)) - spherical(*(at - step))) / (2.0 * step.max())
            for step in np.diag([1e-2, 1e-6, 1e-6])
        ]
    )
    across_rad = across_mm / distance
    std = np.array([along_mm, across_rad / np.cos(elevation), across_rad])
    expected = by_instrument @ np.diag(std**2) @ by_instrument.T
    covariance = point_covariance_mm2(point_mm[None], told)[0]
    assert np.abs(covariance - expected).max() < 1e-8 * np.abs(expected).max()


def test_columns_are_those_of_an_instrument_out_of_adjustment():
    """By what its two angles and its distance are then read as (Deumlich and Staiger)."""
    error, columns = 1e-6, tracker_columns(POINTS_MM)
    for effect, column in columns.items():
        shifts = []
        for point in POINTS_MM:
            distance = np.linalg.norm(point)
            azimuth, elevation = np.arctan2(point[1], point[0]), np.arcsin(point[2] / distance)
            read = {
                "constant": (distance + error, azimuth, elevation),
                "scale": (distance * (1.0 + error), azimuth, elevation),
                "transit": (distance, azimuth + error * np.tan(elevation), elevation),
            }[effect]
            shifts.append(spherical(*read) - point)
        moved = np.array(shifts)
        if effect == "scale":
            moved -= moved.mean(axis=0)  # the frame takes up what all points have in common
        np.testing.assert_allclose(error * column, moved, rtol=1e-3, atol=1e-8)


def test_covariances_are_symmetric_positive_definite_and_of_the_data_sheets_limits():
    covariance = point_covariance_mm2(POINTS_MM, TrackerUncertainty())
    assert (covariance == covariance.transpose(0, 2, 1)).all()
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    at500 = TrackerUncertainty.of_limits(10.0, 0.3, 15.0, 6.0)
    assert astuple(at500) == pytest.approx(astuple(TrackerUncertainty()))


def test_variance_of_distances_follows_both_covariances():
    """First-order propagation, with the gradient of |b - a| by differences."""
    covariance = point_covariance_mm2(POINTS_MM, TrackerUncertainty())
    variance = distance_variance_mm2(POINTS_MM, covariance, FIRST, SECOND)
    for pair, (a, b) in enumerate(zip(FIRST, SECOND, strict=True)):
        ends = np.concatenate([POINTS_MM[a], POINTS_MM[b]])
        moved = ends + 1e-3 * np.vstack([np.eye(6), -np.eye(6)])
        lengths = np.linalg.norm(moved[:, 3:] - moved[:, :3], axis=1)
        gradient = (lengths[:6] - lengths[6:]) / 2e-3
        both = np.zeros((6, 6))
        both[:3, :3], both[3:, 3:] = covariance[a], covariance[b]
        assert variance[pair] == pytest.approx(gradient @ both @ gradient, rel=1e-6)
