"""The figures of ISO 9283 against numbers worked out by hand."""

import numpy as np
import pytest

from campaigns.evaluation.validation import RepeatabilityTest, repeatability_test


def visits(points, commanded=(0.0, 0.0, 0.0), std_mm: float = 0.0) -> RepeatabilityTest:
    count = len(points)
    poses = np.tile([*commanded, 0.0], (count, 1))
    covariance = np.tile(std_mm**2 * np.eye(3), (count, 1, 1))
    return repeatability_test(poses, np.array(points), covariance, in_base=True)


def cross(half_mm: float, *centre: float) -> np.ndarray:
    """Six points about a centre, all at the same distance."""
    return half_mm * np.vstack([np.eye(3), -np.eye(3)]) + np.array(centre or (0.0, 0.0, 0.0))


def test_ap_is_the_distance_of_the_mean_with_scatter_and_instrument_in_its_uncertainty() -> None:
    found = visits(cross(1.0, 4.0, 0.0, 0.0), (0.0, 3.0, 0.0))
    assert found.accuracy.value_mm == pytest.approx(5.0)
    found = visits(cross(1.0, 4.0, 0.0, 0.0), std_mm=0.3)  # along x: 5, 3 and four times 4
    of_mean = np.sqrt(2.0 / 5.0 / 6.0)
    assert found.accuracy.standard_uncertainty_mm == pytest.approx(np.hypot(of_mean, 0.3))


def test_the_uncertainty_of_rp_is_what_other_samples_scatter() -> None:
    rng = np.random.default_rng(1)
    found = [visits(rng.normal(size=(28, 3))).rp for _ in range(400)]
    scatter = np.std([each.value_mm for each in found])
    stated = np.mean([each.standard_uncertainty_mm for each in found])
    assert stated == pytest.approx(scatter, rel=0.2)
