"""Analytic derivatives of the closures and of the forward model against numerical ones."""

import numpy as np
import pytest
from par4_cases import (
    DECADES,
    NOMINAL,
    ROBOTS,
    TABLE1,
    WELL_INSIDE,
    assert_exact_in_every_decade,
    reachable_joints,
)
from par4_space import GEOMETRY_NAMES, IS_ANGLE, PLATE, TILTS, par4_of

from campaigns.mechanisms.par4 import PAR4

LEVER_MM = 100.0
BY_LENGTH = np.where(IS_ANGLE[: len(GEOMETRY_NAMES)], 1.0, LEVER_MM)
"""A step of 0.01 is 0.01 rad or 1 mm."""


@pytest.fixture(scope="module", params=ROBOTS)
def assembled(request):
    geometry = ROBOTS[request.param]
    joints = reachable_joints(geometry, 12, seed=21, limits=WELL_INSIDE)
    return geometry, joints, geometry.forward(joints).values_or_raise()


def complex_step(function, x, step):
    """∂function/∂x (…, len(x)); exact but for step² as long as the function is analytic."""
    columns = [np.imag(function(x + 1j * step * unit)) / step for unit in np.eye(len(x))]
    return np.stack(columns, axis=-1)


def assert_closer_with_every_decade(errors, steps):
    """Falls with the square of the step until only rounding is left."""
    assert errors[-1] < 1e-9
    for error, step in zip(errors, steps, strict=True):
        assert error < step**2 + 1e-9


@pytest.mark.parametrize("row", range(3))
def test_derivative_of_the_closures_by_the_pose(assembled, row):
    geometry, joints, poses = assembled
    lever = np.array([1.0, 1.0, 1.0, 1.0 / LEVER_MM])
    exact = PAR4.pose_jacobian(geometry.p, joints, poses)[row] * lever

    def closures(scaled):
        return PAR4.closure_mm2(geometry.p, joints[[row]], (scaled * lever)[None])[0]

    errors = [
        np.abs(complex_step(closures, poses[row] / lever, LEVER_MM * step) - exact).max()
        for step in DECADES
    ]
    assert_closer_with_every_decade(np.array(errors) / np.abs(exact).max(), DECADES)


@pytest.mark.parametrize("row", range(3))
def test_derivative_of_the_closures_by_the_parameters(assembled, row):
    geometry, joints, poses = assembled
    own = PAR4.closure_parameter_jacobian(geometry.p, joints, poses)[row]
    exact = np.zeros((4, len(GEOMETRY_NAMES)))
    for arm in range(4):
        exact[arm, 7 * arm : 7 * arm + 7] = own[arm, :7]
        exact[arm, TILTS[arm]] = own[arm, 7]
    exact[:, PLATE] = own[:, 8]

    def closures(scaled):
        return PAR4.closure_mm2(scaled * BY_LENGTH, joints[[row]], poses[[row]] + 0j)[0]

    errors = [
        np.abs(complex_step(closures, geometry.p / BY_LENGTH, step) - exact * BY_LENGTH)
        for step in DECADES
    ]
    worst = np.array([error.max() for error in errors]) / np.abs(exact * BY_LENGTH).max()
    assert_closer_with_every_decade(worst, DECADES)


@pytest.mark.slow
def test_derivative_of_the_pose_by_every_parameter_in_every_decade(assembled):
    geometry, joints, poses = assembled
    unit = np.array([1.0, 1.0, 1.0, LEVER_MM])[:, None] * BY_LENGTH
    exact = geometry.jacobian(joints, poses) * unit

    def moved(vector):
        return par4_of(vector).forward(joints, poses).values_or_raise()

    assert_exact_in_every_decade(exact, moved, geometry.p, unit, BY_LENGTH)


def test_parameters_of_one_arm_leave_the_other_closures_alone(assembled):
    geometry, joints, poses = assembled
    vector = geometry.p.copy()
    vector[7:14] += 0.01
    change = PAR4.closure_mm2(vector, joints, poses) - PAR4.closure_mm2(geometry.p, joints, poses)
    assert np.abs(change[:, 1]).min() > 1e-3
    assert np.abs(change[:, [0, 2, 3]]).max() < 1e-6


def test_a_first_order_step_is_off_by_the_square_of_the_parameters_errors():
    joints = reachable_joints(NOMINAL, 50, seed=2, limits=WELL_INSIDE)
    poses = NOMINAL.forward(joints).values_or_raise()
    jacobian = NOMINAL.jacobian(joints, poses)
    errors = TABLE1.p - NOMINAL.p

    def missed_mm(part):
        moved = par4_of(NOMINAL.p + part * errors)
        predicted = poses + jacobian @ (part * errors)
        return np.abs(predicted - moved.forward(joints).values_or_raise())[:, :3].max()

    assert missed_mm(0.1) == pytest.approx(100.0 * missed_mm(0.01), rel=0.1)
    assert missed_mm(0.01) < 1e-3
