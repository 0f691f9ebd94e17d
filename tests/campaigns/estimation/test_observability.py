"""What a fit knows: rank, condition, what cannot be told apart, covariance."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from par4_cases import LIMITS, NOMINAL, reachable_joints
from par4_space import SPACE

from campaigns.estimation.information import covariance
from campaigns.estimation.observability import observability, triangle_of, unobservable_combinations
from campaigns.estimation.residuals import DistanceResiduals, PositionModel
from campaigns.evaluation.summary import spread

AZIMUTHS = tuple(f"arm{arm}.azimuth_deg" for arm in range(4))
JOINTS = reachable_joints(NOMINAL, 120, seed=51, limits=LIMITS)


def distance_jacobian(names):
    rows = np.arange(0, len(JOINTS), 2)
    model = PositionModel(NOMINAL, SPACE.places(names), JOINTS)
    problem = DistanceResiduals.in_mm(model, rows, rows + 1, np.zeros(len(rows)))
    return problem.jacobian(problem.start())


def of_all_arms(field):
    return {f"arm{arm}.{field}" for arm in range(4)}


def test_sixty_pairs_tell_the_22_parameters_with_the_explicit_inverses_covariance():
    seen = observability(distance_jacobian(SPACE.free_by_default))
    assert seen.rank == 22
    assert 50.0 < seen.condition < 200.0
    assert unobservable_combinations(seen, SPACE.free_by_default) == []
    assert_explicit_inverse(distance_jacobian(SPACE.free_by_default))


def test_with_everything_free_the_frame_s_place_and_turn_are_named():
    """Distances don't know where the base frame is: three shifts, and the turn about z."""
    seen = observability(distance_jacobian(SPACE.names))
    assert seen.rank == 25
    assert seen.condition == np.inf
    combinations = [set(names) for names in unobservable_combinations(seen, SPACE.names)]
    assert len(combinations) == 4
    for field in ("x_mm", "y_mm", "z_mm"):
        assert of_all_arms(field) in combinations
    (turn,) = (names for names in combinations if set(AZIMUTHS) <= names)
    assert {name.split(".")[1] for name in turn} == {"x_mm", "y_mm", "azimuth_deg"}


def test_freed_azimuths_and_a_freed_motor_are_named():
    names = SPACE.free_by_default + AZIMUTHS
    seen = observability(distance_jacobian(names))
    assert seen.rank == 25
    (combination,) = unobservable_combinations(seen, names)
    assert set(AZIMUTHS) <= set(combination)
    assert not any(name.endswith(("z_mm", "arm_mm", "offset_deg")) for name in combination)
    names = (*SPACE.free_by_default, "arm0.z_mm")
    seen = observability(distance_jacobian(names))
    assert seen.rank == 22
    assert set(unobservable_combinations(seen, names)[0]) == of_all_arms("z_mm")


def test_an_unobservable_direction_really_changes_no_distance():
    jacobian = distance_jacobian(SPACE.names)
    seen = observability(jacobian)
    norms = np.linalg.norm(jacobian, axis=0)
    model = PositionModel(NOMINAL, SPACE.places(SPACE.names), JOINTS)
    poses = NOMINAL.forward(JOINTS).values_or_raise()
    before = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    for direction in seen.null_directions:
        moved = model.kinematics(model.nominal + 1e-4 * direction / norms)
        after = np.linalg.norm(
            np.diff(moved.forward(JOINTS).values_or_raise()[:, :3], axis=0), axis=1
        )
        assert np.abs(after - before).max() < 1e-7


def test_fewer_rows_than_parameters_cannot_have_full_rank():
    seen = observability(distance_jacobian(SPACE.free_by_default)[:15])
    assert (seen.rank, len(seen.singular_values)) == (15, 22)
    assert seen.null_directions.shape == (7, 22)
    assert seen.condition == np.inf


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_units_change_neither_rank_nor_condition(scale):
    jacobian = distance_jacobian(SPACE.free_by_default)
    seen = observability(jacobian * np.where(np.arange(22) % 2, scale, 1.0))
    assert seen.rank == 22
    assert seen.condition == pytest.approx(observability(jacobian).condition, rel=1e-9)


def test_parameters_without_effect_or_of_one_effect_are_named():
    jacobian = np.column_stack([np.eye(4), np.zeros(4)])
    seen = observability(jacobian)
    assert seen.rank == 4
    assert unobservable_combinations(seen, tuple("abcde")) == [("e",)]
    rng = np.random.default_rng(0)
    columns = rng.normal(size=(30, 3))
    jacobian = np.column_stack([columns, columns[:, 0], columns[:, 2]])
    combinations = unobservable_combinations(observability(jacobian), tuple("abcde"))
    assert sorted(combinations) == [("a", "d"), ("c", "e")]


def assert_explicit_inverse(jacobian):
    expected = np.linalg.inv(jacobian.T @ jacobian)
    std = np.sqrt(np.diag(expected))
    assert np.abs((covariance(jacobian) - expected) / np.outer(std, std)).max() < 1e-9


@given(st.integers(0, 2**32 - 1))
def test_covariance_is_the_explicit_inverse(seed):
    jacobian = np.random.default_rng(seed).normal(size=(30, 6)) * [1, 10, 100, 1, 0.1, 5]
    assert_explicit_inverse(jacobian)


def test_lost_rank_has_no_covariance():
    with pytest.raises(np.linalg.LinAlgError, match="rank 25 of 29"):
        covariance(distance_jacobian(SPACE.names))


def test_spread_tells_mean_rms_and_largest_of_something():
    told = spread(np.array([1.0, -2.0, 2.0, -1.0, 0.0]))
    assert (told.mean_abs, told.max_abs) == (1.2, 2.0)
    assert told.rms == pytest.approx(np.sqrt(2.0))
    with pytest.raises(ValueError, match="no errors"):
        spread(np.array([]))


@pytest.mark.parametrize("rows", [7, 300, 599, 600, 1801])
def test_a_triangle_has_the_normal_equations_of_all_rows(rows):
    columns = np.random.default_rng(rows).normal(size=(rows, 7)) * 10.0 ** np.arange(7)
    triangle = triangle_of(columns)
    assert triangle.shape == (7, 7)
    assert np.all(np.tril(triangle, -1) == 0.0)
    scale = np.linalg.norm(columns, axis=0)
    wrong = (triangle.T @ triangle - columns.T @ columns) / np.outer(scale, scale)
    assert np.abs(wrong).max() < 1e-14
