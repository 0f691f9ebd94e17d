"""What an estimate is worth: σ that hold, priors that count as they should, nothing walks off."""

from dataclasses import replace

import numpy as np
import pytest
from par4_cases import (
    NOMINAL,
    TABLE1,
    TRACKER_STD_MM,
    measured_points,
    reachable_joints,
    reachable_poses,
)
from par4_space import SPACE, par4_of

from campaigns.estimation import information, least_squares
from campaigns.estimation.estimate import estimate
from campaigns.estimation.observability import (
    observability,
    project_out_nuisance,
    unobservable_combinations,
)
from campaigns.estimation.residuals import DistanceResiduals, PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import fit_transform

FREE = SPACE.free_by_default
SHOTS = 24
DRAWS = 200
"""Limits below are three to four standard deviations of what so many draws show."""


def points(joints, measured, free=FREE, priors=None, nominal=NOMINAL):
    model = PositionModel(nominal, SPACE.places(free), joints)
    covariance = np.tile(TRACKER_STD_MM**2 * np.eye(3), (len(joints), 1, 1))
    data = PointResiduals.from_points(model, measured, covariance)
    return least_squares.LeastSquaresProblem(data, 3, priors or least_squares.Priors.none())


def distances(joints, measured, free=FREE, priors=None):
    first, second = np.arange(0, len(joints), 2), np.arange(1, len(joints), 2)
    lengths = np.linalg.norm(measured[first] - measured[second], axis=1)
    model = PositionModel(NOMINAL, SPACE.places(free), joints)
    whitening = np.full(len(first), 1.0 / (2.0**0.5 * TRACKER_STD_MM))
    data = DistanceResiduals(model, first, second, lengths, whitening)
    return least_squares.LeastSquaresProblem(data, 1, priors or least_squares.Priors.none())


@pytest.fixture(scope="module")
def joints():
    return reachable_joints(TABLE1, 120, seed=61)


@pytest.fixture(scope="module")
def measured(joints):
    return measured_points(TABLE1, joints, TRACKER_STD_MM, seed=62)


def true(free=FREE):
    return TABLE1.p[SPACE.places(free)]


def nominal(name):
    return NOMINAL.p[SPACE.places((name,))[0]]


def prior(name, std, free=FREE, mean=None):
    value = nominal(name) if mean is None else mean
    return least_squares.Priors(np.array([free.index(name)]), np.array([value]), np.array([std]))


@pytest.fixture(scope="module")
def drawn():
    """One plan measured many times: all estimates, and where each puts a sample of positions."""
    joints = reachable_joints(TABLE1, SHOTS, seed=63)
    elsewhere = reachable_poses(TABLE1, 60, seed=64)
    there = TABLE1.inverse(elsewhere).values_or_raise()
    found, errors = [], []
    for seed in range(DRAWS):
        measured = measured_points(TABLE1, joints, TRACKER_STD_MM, seed)
        robot = points(joints, measured, nominal=TABLE1)
        each = estimate(robot, 22, exclude=False, known_variance=True)
        vector = TABLE1.p.copy()
        vector[SPACE.places(FREE)] = each.x[:22]
        reached = par4_of(vector).forward(there, elsewhere).values_or_raise()[:, :3]
        errors.append(fit_transform(reached, elsewhere[:, :3]).apply(reached) - elsewhere[:, :3])
        found.append(each)
    return found, np.array(errors), (there, elsewhere)


@pytest.mark.slow
def test_stated_deviations_are_those_that_repeated_campaigns_show(drawn):
    found, _, _ = drawn
    empirical = np.std([each.x[:22] for each in found], axis=0)
    stated = np.sqrt(np.mean([np.diag(each.covariance)[:22] for each in found], axis=0))
    assert np.all(np.abs(empirical / stated - 1.0) < 0.2), empirical / stated


@pytest.mark.slow
def test_the_truth_lies_as_far_off_as_the_whole_covariance_says(drawn):
    found, _, _ = drawn
    missed = np.array([each.x[:22] - true() for each in found])
    known = np.array([each.covariance[:22, :22] for each in found])
    square = np.einsum("ni,ni->n", missed, np.linalg.solve(known, missed[:, :, None])[:, :, 0])
    assert np.mean(square) == pytest.approx(22.0, rel=0.07)


@pytest.mark.slow
def test_correlations_are_those_that_repeated_campaigns_show(drawn):
    found, _, _ = drawn
    empirical = np.corrcoef(np.array([each.x[:22] for each in found]).T)
    covariance = found[0].covariance[:22, :22]
    std = np.sqrt(np.diag(covariance))
    assert np.abs(empirical - covariance / np.outer(std, std)).max() < 0.28


@pytest.mark.slow
def test_predicted_position_deviation_is_what_repeated_campaigns_show(drawn):
    found, errors, (there, elsewhere) = drawn
    rows = information.marginalise_frame(information.point_jacobian(TABLE1, FREE, there, elsewhere))
    predicted = information.position_std_mm(rows, found[0].covariance[:22, :22])
    shown = np.sqrt(np.mean(np.sum(errors**2, axis=2), axis=0))
    assert shown.mean() == pytest.approx(predicted.mean(), rel=0.06)
    np.testing.assert_allclose(shown, predicted, rtol=0.15)


@pytest.mark.slow
def test_chi_squared_is_believed_of_good_noise_and_has_its_distribution(drawn):
    found, _, _ = drawn
    values = np.array([each.noise.chi2 for each in found])
    dof = 3 * SHOTS - 28
    assert {each.noise.dof for each in found} == {dof}
    assert values.mean() == pytest.approx(dof, rel=0.045)
    assert values.std() == pytest.approx(np.sqrt(2.0 * dof), rel=0.15)
    assert np.mean([each.noise.consistent for each in found]) > 0.98
    assert np.mean([each.noise.p < 0.1 for each in found]) == pytest.approx(0.1, abs=0.07)


@pytest.mark.parametrize(
    ("chi2", "consistent"), [(100.0, True), (160.0, False), (55.0, False), (140.0, True)]
)
def test_chi_squared_may_be_too_large_and_too_small(chi2, consistent):
    assert information.chi_square_test(chi2, 100).consistent is consistent


def test_sigma_follow_the_scatter_only_upwards_when_the_stated_variance_counts_as_known(joints):
    stated, wild, calm = (
        estimate(
            points(joints, measured_points(TABLE1, joints, factor * TRACKER_STD_MM, 1)),
            22,
            exclude=False,
            known_variance=True,
        )
        for factor in (1.0, 5.0, 0.1)
    )
    assert stated.noise.sigma0 == calm.noise.sigma0 == 1.0
    assert wild.noise.sigma0 == pytest.approx(5.0, rel=0.1)
    assert wild.covariance[0, 0] == pytest.approx(25.0 * stated.covariance[0, 0], rel=0.2)
    assert calm.covariance[0, 0] == pytest.approx(stated.covariance[0, 0], rel=0.01)


def test_sigma_follow_the_scatter_both_ways_when_it_does_not(joints):
    for factor in (0.1, 1.0, 30.0):
        measured = measured_points(TABLE1, joints, factor * TRACKER_STD_MM, 1)
        found = estimate(distances(joints, measured), 22, exclude=False, known_variance=False)
        assert found.noise.sigma0 == pytest.approx(factor, rel=0.25)


@pytest.mark.parametrize("build", [points, distances])
def test_what_nothing_tells_stays_nominal_along_its_combination(joints, measured, build):
    """Freeing the first motor's place lets the robot shift: the mean shift must be none."""
    free = (*FREE, "arm0.x_mm")
    found = estimate(build(joints, measured, free), 23, exclude=False, known_variance=True)
    along_x = [free.index(f"arm{arm}.x_mm") for arm in range(4)]
    assert (found.seen.rank, found.fit.converged) == (22, True)
    assert not found.identifiable[along_x].any()
    assert found.identifiable.sum() == 19
    (lost,) = unobservable_combinations(found.seen, free)
    assert {free[place] for place in along_x} == set(lost)
    held = estimate(build(joints, measured), 22, exclude=False, known_variance=True)
    known = np.flatnonzero(found.identifiable)
    std = np.sqrt(np.diag(held.covariance)[[FREE.index(free[k]) for k in known]])
    np.testing.assert_allclose(np.sqrt(np.diag(found.covariance)[known]), std, rtol=1e-3)
    others = [FREE.index(free[k]) for k in known]
    assert np.abs((found.x[known] - held.x[others]) / std).max() < 0.01
    steps = found.x[along_x] - [nominal(free[place]) for place in along_x]
    assert np.abs(steps).max() < 10.0
    data = build(joints, measured, free).data
    weights = (
        observability(project_out_nuisance(data.jacobian(data.start()), 23)).scale[along_x] ** 2
    )
    assert abs(steps @ weights) < 1e-9 * np.abs(steps) @ weights, (
        "their weighted mean stays nominal"
    )


def test_a_sharp_prior_is_believed_and_a_broad_one_is_not_noticed(joints, measured):
    free = estimate(points(joints, measured), 22, exclude=False, known_variance=True)
    place = FREE.index("arm2.forearm_mm")
    for std, believed in ((1e-5, True), (1e3, False)):
        known = prior("arm2.forearm_mm", std, mean=true()[place])
        informed = points(joints, measured, priors=known)
        found = estimate(informed, 22, exclude=False, known_variance=True)
        if believed:
            assert found.x[place] == pytest.approx(true()[place], abs=1e-6)
            assert np.sqrt(found.covariance[place, place]) == pytest.approx(std, rel=0.01)
        else:
            np.testing.assert_allclose(found.x, free.x, rtol=1e-6, atol=1e-7)
            np.testing.assert_allclose(found.covariance, free.covariance, rtol=1e-4, atol=1e-12)


@pytest.mark.parametrize(("build", "known"), [(points, True), (distances, False)])
def test_priors_count_against_the_scatter_that_there_is_and_stay_as_given(joints, build, known):
    """Shots that scatter 20 times more than stated: the answer is the weighted mean of both."""
    measured = measured_points(TABLE1, joints, 20.0 * TRACKER_STD_MM, 5)
    place = FREE.index("arm2.forearm_mm")
    alone = estimate(build(joints, measured), 22, exclude=False, known_variance=known)
    variance = alone.covariance[place, place]
    told = prior("arm2.forearm_mm", np.sqrt(variance), mean=alone.x[place] + np.sqrt(variance))
    both = estimate(build(joints, measured, priors=told), 22, exclude=False, known_variance=known)
    half_way = alone.x[place] + 0.5 * np.sqrt(variance)
    assert both.x[place] == pytest.approx(half_way, abs=0.05 * np.sqrt(variance))
    assert both.covariance[place, place] == pytest.approx(variance / 2.0, rel=0.05)


def test_parameters_alone_have_the_covariance_that_they_have_beside_a_frame(joints, measured):
    problem = points(joints, measured)
    jacobian = problem.data.jacobian(problem.data.start())
    whole = np.linalg.inv(jacobian.T @ jacobian)[:22, :22]
    alone = project_out_nuisance(jacobian, 22)
    np.testing.assert_allclose(np.linalg.inv(alone.T @ alone), whole, rtol=1e-6)


def test_a_fit_within_a_subspace_never_leaves_it(joints, measured):
    problem = points(joints, measured)
    start = problem.data.start()
    directions = np.linalg.qr(np.random.default_rng(1).standard_normal((28, 5)))[0]
    inside = replace(problem, subspace=least_squares.IdentifiableSubspace(start, directions))
    step = inside.x(least_squares.solve(inside.weighted(np.ones(120))).x) - start
    assert np.linalg.norm(step) > 0.0
    assert np.abs(step - directions @ (directions.T @ step)).max() < 1e-9
