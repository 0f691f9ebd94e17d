"""The solver, on the reference campaigns and at its limits."""

from dataclasses import dataclass

import numpy as np
import pytest
from family_cases import VECTORS
from par4_cases import NOMINAL, TABLE1, WELL_INSIDE, measured_points, reachable_joints
from par4_space import SPACE, par4_of

from campaigns.estimation.least_squares import solve
from campaigns.estimation.residuals import DistanceResiduals, PositionModel
from campaigns.mechanisms.mechanism import NoSolution

FREE = SPACE.places(SPACE.free_by_default)


def distances(name):
    shots = np.loadtxt(VECTORS / f"{name}.csv", delimiter=",", skiprows=1)
    first, second = np.arange(0, len(shots), 2), np.arange(1, len(shots), 2)
    points_mm = shots[:, 5:]
    measured_mm = np.linalg.norm(points_mm[second] - points_mm[first], axis=1)
    model = PositionModel(NOMINAL, FREE, np.radians(shots[:, 1:5]))
    return DistanceResiduals.in_mm(model, first, second, measured_mm)


def test_a_finished_fit_is_at_its_end_and_says_how_long_it_took():
    problem = distances("table1-tracker-noise")
    fit = solve(problem)
    assert np.abs(fit.residual - problem.residual(fit.x)).max() < 1e-11
    at_end = problem.jacobian(fit.x)
    assert np.linalg.norm(fit.jacobian - at_end) < 1e-8 * np.linalg.norm(at_end)
    fit = solve(distances("table1-tracker-noise"))
    assert fit.message == f"converged after {fit.evaluations} evaluations"
    assert fit.evaluations < 15
    fit = solve(distances("table2-repeatability"))
    slope = fit.jacobian.T @ fit.residual / np.linalg.norm(fit.jacobian, axis=0)
    assert np.abs(slope).max() < 1e-6


@pytest.mark.parametrize("evaluations", [2, 3])
def test_a_fit_cut_short_says_that_it_has_not_converged(evaluations):
    fit = solve(distances("table1-tracker-noise"), evaluations)
    assert not fit.converged
    assert fit.message == f"not converged: stopped after {evaluations} evaluations"
    assert fit.evaluations == evaluations


@dataclass
class Logarithm:
    """Zero at 1; the first step from 5 leads to -3, where there is no answer."""

    begin: float
    refused: int = 0

    def start(self):
        return np.array([self.begin])

    def fine_unknowns(self):
        return np.zeros(1, dtype=bool)

    def residual(self, x):
        if x[0] <= 0.0:
            self.refused += 1
            raise NoSolution
        return np.log(x)

    def jacobian(self, x):
        return np.array([1.0 / x])


def test_a_step_out_of_the_model_is_turned_back_and_a_start_outside_is_an_error():
    problem = Logarithm(begin=5.0)
    fit = solve(problem)
    assert problem.refused > 0
    assert fit.converged
    assert fit.x == pytest.approx([1.0], abs=1e-9)
    with pytest.raises(NoSolution):
        solve(Logarithm(begin=-1.0))


@dataclass
class BentLogarithm(Logarithm):
    """Minimum at which residuals are left: steps shrink to a part of the one before."""

    def residual(self, x):
        return np.append(super().residual(x), 0.1 * x - 0.8)

    def jacobian(self, x):
        return np.vstack([super().jacobian(x), [[0.1]]])


def test_a_fit_that_had_to_turn_back_ends_as_near_to_its_minimum_as_any():
    problem = BentLogarithm(begin=12.0)
    fit = solve(problem)
    assert problem.refused > 0
    assert fit.converged
    slope = fit.jacobian.T @ fit.residual / np.linalg.norm(fit.jacobian)
    assert np.abs(slope).max() < 1e-9 * np.linalg.norm(fit.residual)


def test_a_far_start_still_arrives():
    """The nominal robot off by 4 mm and 1° everywhere."""
    joints = reachable_joints(TABLE1, 120, seed=43, limits=WELL_INSIDE)
    first, second = np.arange(0, 120, 2), np.arange(1, 120, 2)
    positions = measured_points(TABLE1, joints)
    measured_mm = np.linalg.norm(positions[second] - positions[first], axis=1)
    off = TABLE1.p.copy()
    off[FREE] += np.random.default_rng(0).choice([-1, 1], 22) * np.where(
        [name.endswith("_deg") for name in SPACE.free_by_default], np.radians(1.0), 4.0
    )
    model = PositionModel(par4_of(off), FREE, joints)
    fit = solve(DistanceResiduals.in_mm(model, first, second, measured_mm))
    assert fit.converged
    assert np.abs(model.kinematics(fit.x).p - TABLE1.p).max() < 1e-6
