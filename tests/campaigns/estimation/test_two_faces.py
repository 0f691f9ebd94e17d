"""The two-face error of a tracker: told by points in both faces, and taken out of the others."""

from dataclasses import replace

import numpy as np
import pytest
from validation_cases import shot, shots_of

from campaigns.estimation.two_faces import two_face_error_rad, without_two_face_error
from campaigns.shots.shot_sets import ShotSet

ERROR_RAD = (3e-5, -5e-5)
"""Collimation, vertical index."""


def in_face(points_mm, side):
    """Points as an instrument sees them whose head is bent so."""
    x, y, z = points_mm.T
    level = np.hypot(x, y)
    zenith = np.arctan2(level, z)
    azimuth = np.arctan2(y, x) + side * ERROR_RAD[0] / np.sin(zenith)
    zenith = zenith + side * ERROR_RAD[1]
    size = np.linalg.norm(points_mm, axis=1)
    flat = size * np.sin(zenith)
    return np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), size * np.cos(zenith)], 1)


def test_half_the_difference_of_both_faces_is_the_error_and_is_taken_out() -> None:
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.0, 1.0, (40, 3)) * [3000.0, 3000.0, 900.0] + [0.0, 0.0, 200.0]
    points[0] = [-2000.0, 1e-9, 300.0]  # where azimuths jump
    first, second = in_face(points, 1.0), in_face(points, -1.0)
    off_mm = np.linalg.norm(first - points, axis=1)
    assert off_mm.max() > 0.1
    error = two_face_error_rad(first[:3], second[:3])
    assert error == pytest.approx(ERROR_RAD, rel=1e-6)
    assert without_two_face_error(first, *error) == pytest.approx(points, abs=1e-6)


def test_nests_in_both_faces_take_the_error_out_of_the_robots_shots_too() -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(-400.0, 400.0, (12, 3)) + np.array([2500.0, 600.0, -300.0])
    points[:3] += [-3500.0, 900.0, 0.0]  # nests stand elsewhere
    first, second = in_face(points, 1.0), in_face(points, -1.0)
    accepted = []
    for number, (seen, other) in enumerate(zip(first.tolist(), second.tolist(), strict=True)):
        each = shot(number, ShotSet.NEST if number < 3 else ShotSet.DRIFT, (0.0, 0.0, -575.0))
        other_mm = tuple(other) if number < 3 else None
        outcome = replace(each.outcome, point_in_tracker_mm=tuple(seen), other_face_mm=other_mm)
        accepted.append(replace(each, outcome=outcome))
    kept = shots_of(accepted).points_in_tracker_mm
    assert kept == pytest.approx(points, abs=1e-6)
    in_one = [replace(a, outcome=replace(a.outcome, other_face_mm=None)) for a in accepted]
    off_mm = np.linalg.norm(shots_of(in_one).points_in_tracker_mm - points, axis=1)
    assert off_mm.min() > 0.05
