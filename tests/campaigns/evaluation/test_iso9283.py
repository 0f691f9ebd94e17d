"""The figures of ISO 9283 against numbers worked out by hand, and what they may not be called."""

import numpy as np
import pytest

from campaigns.evaluation import iso9283

ORIGIN = np.zeros(3)


def cross(half_mm: float, *centre: float) -> np.ndarray:
    """Six points about a centre, all at the same distance."""
    return half_mm * np.vstack([np.eye(3), -np.eye(3)]) + np.array(centre or (0.0, 0.0, 0.0))


def test_ap_is_the_distance_of_the_mean_from_the_commanded_point() -> None:
    found = iso9283.pose_accuracy(np.array([0.0, 3.0, 0.0]), cross(1.0, 4.0, 0.0, 0.0), 0.01)
    assert (found.symbol, found.n) == ("AP", 6)
    assert found.value_mm == pytest.approx(5.0)


def test_the_uncertainty_of_ap_holds_scatter_of_the_mean_and_instrument() -> None:
    attained = cross(1.0, 4.0, 0.0, 0.0)  # along x: 5, 3 and four times 4
    found = iso9283.pose_accuracy(ORIGIN, attained, 0.3)
    assert found.standard_uncertainty_mm == pytest.approx(np.hypot(np.sqrt(2.0 / 5.0 / 6.0), 0.3))
    assert found.expanded_uncertainty_mm == pytest.approx(2.0 * found.standard_uncertainty_mm)


def test_ap_of_one_visit_has_the_instruments_uncertainty_alone() -> None:
    found = iso9283.pose_accuracy(ORIGIN, np.array([[3.0, 4.0, 0.0]]), 0.02)
    assert (found.value_mm, found.n) == (5.0, 1)
    assert found.standard_uncertainty_mm == pytest.approx(0.02)


def test_rp_is_mean_and_three_deviations_of_the_distances_from_the_mean() -> None:
    assert iso9283.pose_repeatability(cross(2.0)).value_mm == pytest.approx(2.0)
    points = np.array([[-3.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])  # l = 3, 1, 2
    found = iso9283.pose_repeatability(points)
    assert (found.symbol, found.n) == ("RP", 3)
    assert found.value_mm == pytest.approx(2.0 + 3.0 * 1.0)
    assert found.standard_uncertainty_mm == pytest.approx(np.sqrt(1.0 / 3.0 + 9.0 / 4.0))


def test_the_uncertainty_of_rp_is_what_other_samples_scatter() -> None:
    rng = np.random.default_rng(1)
    found = [iso9283.pose_repeatability(rng.normal(size=(28, 3))) for _ in range(400)]
    scatter = np.std([each.value_mm for each in found])
    stated = np.mean([each.standard_uncertainty_mm for each in found])
    assert stated == pytest.approx(scatter, rel=0.2)


def test_vap_is_the_largest_distance_between_means_of_directions() -> None:
    directions = [cross(0.1), cross(0.1, 0.0, 0.6, 0.0), cross(0.1, 0.5, 0.0, 0.0)[:4]]
    found = iso9283.pose_accuracy_variation(directions, 0.0)
    means = [points.mean(axis=0) for points in directions]
    assert found.value_mm == pytest.approx(np.linalg.norm(means[1] - means[2]))
    assert (found.symbol, found.n) == ("vAP", 4)


def test_ad_is_the_mean_distance_less_the_commanded_one_with_its_sign() -> None:
    found = iso9283.distance_accuracy(100.0, np.array([99.0, 98.0, 97.0]), 0.0)
    assert (found.symbol, found.n) == ("AD", 3)
    assert found.value_mm == pytest.approx(-2.0)
    assert found.standard_uncertainty_mm == pytest.approx(1.0 / np.sqrt(3.0))


def test_rd_is_three_deviations_of_the_distances() -> None:
    found = iso9283.distance_repeatability(np.array([99.0, 98.0, 97.0]))
    assert (found.symbol, found.n) == ("RD", 3)
    assert found.value_mm == pytest.approx(3.0)


def test_at_is_the_largest_distance_of_the_mean_path_from_the_commanded_line() -> None:
    path = np.array([[0.0, 0.0, 0.0], [50.0, 3.0, 4.0], [100.0, 0.0, 0.0]])
    sideways = np.array([0.0, 1.0, 0.0])
    found = iso9283.line_accuracy(
        ORIGIN, np.array([100.0, 0.0, 0.0]), np.stack([path + sideways, path - sideways]), 0.0
    )
    assert (found.symbol, found.n) == ("AT", 2)
    assert found.value_mm == pytest.approx(5.0)


def test_a_point_ahead_on_its_line_is_no_path_error() -> None:
    path = np.array([[[10.0, 0.0, 0.0], [60.0, 0.0, 0.0], [110.0, 0.0, 0.0]]])
    found = iso9283.line_accuracy(ORIGIN, np.array([100.0, 0.0, 0.0]), path, 0.01)
    assert found.value_mm == pytest.approx(0.0)
    assert found.standard_uncertainty_mm == pytest.approx(0.01)


def test_a_figure_that_needs_repetitions_is_refused_without_them() -> None:
    one = np.zeros((1, 3))
    for wrong, symbol in (
        (lambda: iso9283.pose_repeatability(one), "RP"),
        (lambda: iso9283.distance_repeatability(np.array([1.0])), "RD"),
        (lambda: iso9283.pose_accuracy(ORIGIN, one[:0], 0.0), "AP"),
        (lambda: iso9283.distance_accuracy(1.0, np.array([]), 0.0), "AD"),
        (lambda: iso9283.pose_accuracy_variation([one], 0.0), "vAP"),
        (lambda: iso9283.line_accuracy(ORIGIN, np.ones(3), np.empty((0, 3, 3)), 0.0), "AT"),
    ):
        with pytest.raises(ValueError, match=symbol):
            wrong()
