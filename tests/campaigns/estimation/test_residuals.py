"""The residual builders: zero for the truth, and derivatives that are those of the residuals."""

from dataclasses import replace

import numpy as np
import pytest
from par4_cases import (
    NOMINAL,
    TABLE1,
    TRACKER_FROM_BASE,
    WELL_INSIDE,
    central_differences,
    measured_points,
    reachable_joints,
)
from par4_space import SPACE

from campaigns.estimation.least_squares import IdentifiableSubspace, LeastSquaresProblem, Priors
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.mechanisms.mechanism import NoSolution

FREE = SPACE.places(SPACE.free_by_default)
STEPS = np.where(SPACE.is_angle[FREE], 1e-5, 1e-3)
FRAME_STEPS = np.array([1e-5, 1e-5, 1e-5, 1e-2, 1e-2, 1e-2])
JOINTS = reachable_joints(NOMINAL, 30, seed=31, limits=WELL_INSIDE)
POINTS_MM = measured_points(TABLE1, JOINTS)
COVARIANCE_MM2 = point_covariance_mm2(POINTS_MM, TrackerUncertainty())
TRUTH = TABLE1.p[FREE]


def model():
    return PositionModel(NOMINAL, FREE, JOINTS)


def distances():
    first, second = np.arange(0, 30, 2), np.arange(1, 30, 2)
    measured_mm = np.linalg.norm(POINTS_MM[second] - POINTS_MM[first], axis=1)
    return DistanceResiduals.in_mm(model(), first, second, measured_mm)


def points():
    return PointResiduals.from_points(model(), POINTS_MM, COVARIANCE_MM2)


def with_priors():
    places = np.array([2, 5, 21])
    priors = Priors(places, np.array([0.0, 1.0, 100.0]), np.array([0.1, 0.2, 0.5]))
    return LeastSquaresProblem(points(), 3, priors)


def weighed_down():
    """Some shots count little, none scatters as stated, and the last parameters are held."""
    problem = with_priors().weighted(np.linspace(0.1, 1.0, len(JOINTS)))
    directions = np.delete(np.eye(len(FREE) + 6), range(len(FREE) - 3, len(FREE)), axis=1)
    subspace = IdentifiableSubspace(problem.start(), directions)
    return replace(problem, sigma0=3.0, subspace=subspace)


@pytest.mark.parametrize("build", [distances, with_priors])
@pytest.mark.parametrize("part", [0.0, 1.0])
def test_jacobian_is_the_residuals_derivative(build, part):
    """At the start and at the truth, the frame being turned and shifted."""
    problem = build()
    x = problem.start()
    x[: len(FREE)] += part * (TRUTH - x[: len(FREE)])
    steps = STEPS
    if build is with_priors:
        x[-6:] = part * np.array([0.02, -0.01, 0.03, 1.0, -2.0, 0.5])
        steps = np.concatenate([STEPS, FRAME_STEPS])
    analytic = problem.jacobian(x)
    size = np.linalg.norm(analytic, axis=0)
    error = (central_differences(problem.residual, x, steps) - analytic) / size
    assert analytic.shape == (len(problem.residual(x)), len(x))
    assert np.abs(error).max() < 1e-7


def test_jacobian_of_a_weighted_problem_in_a_subspace_is_the_residuals_derivative():
    problem = weighed_down()
    y = problem.start() + 1e-3
    steps = np.concatenate([STEPS[:-3], FRAME_STEPS])
    analytic = problem.jacobian(y)
    error = (central_differences(problem.residual, y, steps) - analytic) / np.linalg.norm(
        analytic, axis=0
    )
    assert analytic.shape == (problem.rows, len(y))
    assert np.abs(error).max() < 1e-7


def test_a_prior_pulls_by_its_own_standard_deviation_whatever_weighs_the_measurements():
    problem = with_priors()
    x = problem.start()
    x[5] += 0.4
    pull = problem.residual(x)[-3:]
    assert pull[1] == pytest.approx((NOMINAL.p[FREE[5]] + 0.4 - 1.0) / 0.2)
    assert len(problem.residual(x)) == 3 * len(JOINTS) + 3
    problem, plain = weighed_down(), with_priors()
    x = problem.x(problem.start() + 1e-3)
    weighed, unweighed = problem.residual(problem.start() + 1e-3), plain.residual(x)
    root = np.repeat(np.sqrt(np.linspace(0.1, 1.0, len(JOINTS))) / 3.0, 3)
    assert weighed[:-3] == pytest.approx(root * unweighed[:-3], rel=1e-12)
    assert (weighed[-3:] == unweighed[-3:]).all()


def test_distances_are_whitened_by_what_they_are_given():
    plain = distances()
    whitening = np.linspace(1.0, 30.0, plain.rows)
    whitened = DistanceResiduals(
        plain.model, plain.first, plain.second, plain.measured_mm, whitening
    )
    x = plain.start()
    assert (whitened.errors_mm(x) == plain.residual(x)).all()
    assert whitened.residual(x) == pytest.approx(whitening * plain.residual(x), rel=1e-15)
    assert whitened.jacobian(x) == pytest.approx(whitening[:, None] * plain.jacobian(x), rel=1e-15)


def test_residuals_vanish_for_the_true_robot_in_its_true_frame():
    assert np.abs(distances().residual(TRUTH)).max() < 1e-9
    assert np.abs(distances().residual(NOMINAL.p[FREE])).max() > 1.0
    problem = points()
    exact = PointResiduals(problem.model, POINTS_MM, problem.whitening, TRACKER_FROM_BASE)
    assert np.abs(exact.residual(np.concatenate([TRUTH, np.zeros(6)]))).max() < 1e-6


def test_the_frame_that_x_stands_for_is_the_one_in_the_residuals():
    problem = points()
    x = problem.start()
    x[-6:] = [0.02, -0.01, 0.03, 1.0, -2.0, 0.5]
    positions = problem.model.positions_mm(x[:-6])
    misfit = problem.tracker_from_base(x).apply(positions) - POINTS_MM
    whitened = np.einsum("nij,nj->ni", problem.whitening, misfit)
    assert np.abs(problem.residual(x) - whitened.ravel()).max() < 1e-9


def test_whitening_makes_every_covariance_the_unit_matrix_and_refuses_an_indefinite_one():
    whitening = points().whitening
    unit = whitening @ COVARIANCE_MM2 @ whitening.transpose(0, 2, 1)
    assert np.abs(unit - np.eye(3)).max() < 1e-12
    with pytest.raises(np.linalg.LinAlgError):
        PointResiduals.from_points(
            model(), POINTS_MM, np.diag([1.0, 1.0, -1.0]) + 0 * COVARIANCE_MM2
        )


def test_a_pair_measured_twice_at_one_place_has_a_finite_derivative():
    joints = np.repeat(JOINTS[:1], 2, axis=0)
    problem = DistanceResiduals.in_mm(
        PositionModel(NOMINAL, FREE, joints), np.array([0]), np.array([1]), np.array([0.01])
    )
    assert problem.residual(problem.start()) == pytest.approx(-0.01)
    assert np.isfinite(problem.jacobian(problem.start())).all()


def test_the_model_s_memory_changes_no_answer():
    """Its starts come from earlier answers; after any history it tells the same as a fresh one."""
    remembering = model()
    start = remembering.nominal
    for x in (start, TRUTH, 0.5 * (start + TRUTH), TRUTH, start):
        fresh = model()
        assert np.abs(remembering.positions_mm(x) - fresh.positions_mm(x)).max() < 1e-9
        assert np.abs(remembering.jacobian(x) - fresh.jacobian(x)).max() < 1e-9


def test_the_model_replaces_only_what_is_free():
    freed = SPACE.places(("arm2.forearm_mm", "plate_mm"))
    geometry = PositionModel(NOMINAL, freed, JOINTS).kinematics(np.array([701.5, 98.0]))
    nominal = NOMINAL.parameters
    changed = {n: v for n, v in geometry.parameters.items() if v != pytest.approx(nominal[n])}
    assert changed == {"arm2.forearm_mm": 701.5, "plate_mm": 98.0}
    assert tuple(geometry.parameters) == SPACE.names


def test_after_parameters_without_an_assembly_the_model_goes_on():
    remembering = model()
    impossible = remembering.nominal.copy()
    impossible[list(SPACE.free_by_default).index("arm2.forearm_mm")] = 50.0
    expected = TABLE1.forward(JOINTS).values_or_raise()[:, :3]
    remembering.jacobian(remembering.nominal)
    with pytest.raises(NoSolution):
        remembering.positions_mm(impossible)
    assert np.abs(remembering.positions_mm(TRUTH) - expected).max() < 1e-9
