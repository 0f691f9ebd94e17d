"""What a total station's points are worth, where it points for them, and its air."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.geocom.accuracy import (
    BOTH_FACES,
    RAD_PER_ARCSEC,
    UNKNOWN_CLASS,
    Accuracy,
    accuracy_of_class,
    covariance_mm2,
    direction_rad,
    relative_humidity_percent,
)

PURE_ANGLE = Accuracy(10.0, 0.0, 0.0, aiming_mm=0.0, target_mm=0.0)
lengths = st.floats(-2e4, 2e4).filter(lambda value: abs(value) > 1.0)
points = st.tuples(lengths, lengths, lengths)


def point_at(hz_rad, v_rad, distance_mm):
    across = distance_mm * math.sin(v_rad)
    return across * math.sin(hz_rad), across * math.cos(hz_rad), distance_mm * math.cos(v_rad)


class TestCovariance:
    @pytest.mark.slow
    @given(points)
    def test_it_is_that_of_the_angles_and_the_distance(self, point_mm):
        """Compared with differences of the point by its Hz, V and distance."""
        accuracy = Accuracy(3.0, 2.0, 2.0, aiming_mm=0.0, target_mm=0.0)
        polar = np.array(direction_rad(point_mm))
        steps = np.array([1e-6, 1e-6, 1e-2])
        jacobian = np.column_stack(
            [
                (np.array(point_at(*(polar + step))) - point_at(*(polar - step))) / (2 * size)
                for step, size in zip(np.diag(steps), steps, strict=True)
            ]
        )
        angle_rad = BOTH_FACES * 3.0 * RAD_PER_ARCSEC
        sigmas = np.array([angle_rad, angle_rad, 2.0 + 2.0 * polar[2] / 1e6])
        expected = jacobian @ np.diag(sigmas**2) @ jacobian.T
        found = np.array(covariance_mm2(point_mm, accuracy))
        assert found == pytest.approx(expected, abs=1e-5 * np.trace(expected))

    @given(points, st.booleans())
    def test_it_is_symmetric_and_positive_definite(self, point_mm, warned):
        found = np.array(covariance_mm2(point_mm, UNKNOWN_CLASS, warned=warned))
        assert (found == found.T).all()
        assert np.linalg.eigvalsh(found)[0] >= 0.99 * UNKNOWN_CLASS.target_mm**2

    @pytest.mark.parametrize("point_mm", [(0.0, 0.0, 0.0), (0.0, 0.0, 3000.0)])
    def test_it_holds_at_the_zenith_and_at_the_instrument_too(self, point_mm):
        found = np.array(covariance_mm2(point_mm, UNKNOWN_CLASS))
        assert np.isfinite(found).all()
        assert np.linalg.eigvalsh(found)[0] > 0.0

    def test_errors_of_angles_grow_with_the_distance_and_aims_count_near_by(self):
        near, far = (covariance_mm2((0.0, y, 0.0), PURE_ANGLE)[0][0] for y in (1e3, 1e4))
        assert far == pytest.approx(100.0 * near)
        assert math.sqrt(far) == pytest.approx(1e4 * math.sqrt(2.0) * math.radians(10.0 / 3600.0))
        (xx, _, _), (_, yy, _), _ = covariance_mm2((0.0, 2500.0, 0.0), accuracy_of_class(350))
        assert math.sqrt(xx) == pytest.approx(math.hypot(1.0, 0.3), rel=0.01)
        assert math.sqrt(yy) == pytest.approx(math.hypot(0.6, 0.3), rel=0.01)
        usual, warned = (
            np.array(covariance_mm2((1e3, 2e3, 3e2), UNKNOWN_CLASS, warned=flag))
            for flag in (False, True)
        )
        assert warned == pytest.approx(4.0 * usual)


class TestClasses:
    @pytest.mark.parametrize(
        ("number", "arcsec", "mm", "ppm"),
        [(350, 0.5, 0.6, 1.0), (651, 1.0, 0.6, 1.0), (601, 2.0, 1.0, 1.5), (202, 5.0, 2.0, 2.0)],
    )
    def test_class_says_what_the_instrument_can_do(self, number, arcsec, mm, ppm):
        found = accuracy_of_class(number)
        assert (found.angle_arcsec, found.distance_mm, found.distance_ppm) == (arcsec, mm, ppm)

    @pytest.mark.parametrize("number", [None, 4711])
    def test_unknown_class_counts_as_coarse(self, number):
        assert accuracy_of_class(number) == UNKNOWN_CLASS


class TestDirection:
    @given(points)
    def test_direction_and_distance_give_the_point_again(self, point_mm):
        assert point_at(*direction_rad(point_mm)) == pytest.approx(point_mm, abs=1e-6)

    @pytest.mark.parametrize(
        ("point_mm", "hz_deg", "v_deg"),
        [
            ((0.0, 1.0, 0.0), 0.0, 90.0),
            ((1.0, 0.0, 0.0), 90.0, 90.0),
            ((-1.0, 0.0, 0.0), 270.0, 90.0),
            ((0.0, 0.0, 1.0), 0.0, 0.0),
            ((0.0, 0.0, -1.0), 0.0, 180.0),
        ],
    )
    def test_hz_is_clockwise_from_north_and_v_from_the_zenith(self, point_mm, hz_deg, v_deg):
        hz_rad, v_rad, _ = direction_rad(point_mm)
        assert (math.degrees(hz_rad), math.degrees(v_rad)) == pytest.approx((hz_deg, v_deg))

    def test_own_place_has_no_direction(self):
        assert direction_rad((0.0, 0.0, 0.0)) is None


class TestHumidity:
    @pytest.mark.parametrize(
        ("dry_degC", "wet_degC", "percent"),
        [(20.0, 20.0, 100.0), (20.0, 14.0, 52.0), (25.0, 18.0, 50.5), (10.0, 7.5, 70.0)],
    )
    def test_tables_of_psychrometers_are_met(self, dry_degC, wet_degC, percent):
        found = relative_humidity_percent(dry_degC, wet_degC, 1013.25)
        assert found == pytest.approx(percent, abs=1.5)

    @pytest.mark.parametrize(("dry_degC", "wet_degC"), [(20.0, 25.0), (40.0, 5.0)])
    def test_what_cannot_be_stays_within_its_limits(self, dry_degC, wet_degC):
        assert 0.0 <= relative_humidity_percent(dry_degC, wet_degC, 1013.25) <= 100.0
