"""Fits of many campaigns of one plan at once, where `fit_shots` would find nothing out of order.

A row is given up, and left to `fit_shots`, as soon as its fit is not plain: a step that leads
nowhere, a shot apart from the others, noise that is not as stated, scatter of the robot's own.
"""

from dataclasses import dataclass
from types import ModuleType

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation import information, variance_components
from campaigns.estimation.estimators import Estimator, LossShape, Outliers, Weights
from campaigns.estimation.gauss_newton import StackSolution, gauss_newton
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residual_stacks import DistanceStack, PointStack, RobotStack
from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.estimation.robust import rejection_threshold
from campaigns.estimation.tracker_noise import (
    distance_variance_mm2,
    inverse_roots,
    point_covariance_mm2,
    pooled_variance_mm2,
)
from campaigns.identification.observations import COORDINATES, SHORTEST_MM, Inputs
from campaigns.shots.shot_sets import ShotSet


@dataclass(frozen=True, slots=True, eq=False)
class FitStack:
    """Fits of C campaigns; rows that were given up say nothing else."""

    x: Array
    """Parameters, mm and rad, (C, F)."""
    covariance: Array
    """(C, F, F)"""
    plain: Mask
    """Rows that were not given up, (C,)."""


def fit_stack(inputs: Inputs, points_mm: Array, kernel: ModuleType | None = None) -> FitStack:
    """Fits of campaigns with the same inputs but for their points (C, N, 3).

    By compiled loops where there is a `kernel`: the same fits but for rounding.
    """
    count, free = len(points_mm), len(inputs.selection.free)
    if not _may_be_plain(inputs):
        return _given_up(count, free)
    try:
        found = _fit_points(inputs, points_mm, kernel)
        if inputs.options.estimator is Estimator.DISTANCES:
            found = _fit_distances(inputs, points_mm, found, kernel)
    except ValueError:  # points that fix no frame, a covariance that is none, a lost rank
        if count == 1:
            return _given_up(count, free)
        each = [fit_stack(inputs, points_mm[row, None], kernel) for row in range(count)]
        parts = ((one.x, one.covariance, one.plain) for one in each)
        return FitStack(*(np.concatenate(part) for part in zip(*parts, strict=True)))
    return FitStack(found.x[:, :free], found.covariance[:, :free, :free], found.plain)


def _given_up(count: int, free: int) -> FitStack:
    x, plain = np.zeros((count, free)), np.zeros(count, dtype=bool)
    return FitStack(x, np.zeros((count, free, free)), plain)


def _may_be_plain(inputs: Inputs) -> bool:
    """Whether nothing but the points can make these fits more than plain ones."""
    nominal, selection, options = inputs.nominal, inputs.selection, inputs.options
    space = nominal.mechanism.parameters
    places = space.places(selection.free)
    asked = options.loss is LossShape.LINEAR and options.outliers is Outliers.EXCLUDE
    asked &= options.estimator is Estimator.POINTS or options.weights is Weights.STATED
    more = selection.priors or options.sessions or options.frees_reflector_constant
    shots = inputs.shots
    return bool(
        asked
        and not more
        and (places < len(space.names)).all()
        and not nominal.p[len(space.names) :].any()
        and inputs.at_nominal.found.all()
        and not np.isfinite(shots.stated_covariance_mm2).any()
        and not shots.approach.any()
    )


def _fit_points(inputs: Inputs, points_mm: Array, kernel: ModuleType | None) -> FitStack:
    shots, near = inputs.shots, inputs.at_nominal.values
    rows = shots.rows_of(ShotSet.IDENTIFICATION)
    measured, every = points_mm[:, rows], np.arange(len(points_mm))
    stated = point_covariance_mm2(measured.reshape(-1, 3), inputs.options.instrument)
    whitening = inverse_roots(stated).reshape(*measured.shape, 3)
    robots = _robots(inputs, rows, np.tile(near[rows].T, (len(every), 1, 1)), kernel)
    frames = [fit_transform(near[rows][:, :3], each) for each in measured]
    guesses = (
        np.array([frame.rotation for frame in frames]),
        np.array([frame.translation_mm for frame in frames]),
    )
    points, roots = (np.ascontiguousarray(np.moveaxis(e, 1, -1)) for e in (measured, whitening))
    problem = PointStack(robots, points, roots, guesses)
    solution, found = _solved(problem, problem.start(), COORDINATES)
    left = solution.residual.reshape(len(every), 3, -1)
    by_joints = problem.whitened_by_joints(found.x, every)
    scores = _scores(problem, found, left, roots.swapaxes(1, 2), by_joints)
    hopeful = found.plain & ~(scores < variance_components.HOPELESS_SCORE)
    for row in np.flatnonzero(hopeful):
        back = np.linalg.inv(whitening[row])
        by_x = problem.jacobians[row].reshape(3, -1, found.x.shape[1])
        by_shot = (left[row].T[:, :, None], by_x.swapaxes(0, 1), by_joints[row].transpose(2, 1, 0))
        misfit, jacobian, through = (back @ each for each in by_shot)
        covariance = stated.reshape(*measured.shape, 3)[row]
        linearized = variance_components.LinearizedShots(
            misfit[:, :, 0], jacobian, covariance, through
        )
        found.plain[row] = not variance_components.estimate_components(linearized, kernel).any
    return found


def _scores(problem: PointStack, found: FitStack, left: Array, *columns: Array) -> Array:
    """The larger score of the components, (C,), of residuals (C, 3, N).

    Each component's whitened columns are (C, k, 3, N).
    """
    kernel, scores = problem.robots.kernel, list[Array]()
    across = [each.swapaxes(1, 2) for each in columns]
    if kernel is None:
        by_x = problem.jacobians.reshape(*left.shape, -1)
        known = by_x @ found.covariance[:, None]
        leverage = np.einsum("cinp,cjnp->cijn", known, by_x)
        scores.extend(variance_components.component_scores(left, leverage, *across))
    else:
        _, _, bases, _ = kernel.triangles(np.ascontiguousarray(problem.jacobians.swapaxes(1, 2)))
        bases = bases.reshape(*bases.shape[:2], *left.shape[1:])
        for each, turned in zip(columns, across, strict=True):
            own = np.einsum("ckin,ckjn->cijn", each, each)
            taken = kernel.taken_squares(bases, np.ascontiguousarray(each))
            scores.append(variance_components.component_score(left, turned, own, taken))
    return np.asarray(np.max(scores, axis=0))


def _fit_distances(
    inputs: Inputs, points_mm: Array, points: FitStack, kernel: ModuleType | None
) -> FitStack:
    """Distances weighed as the tracker states, from where the points' fits ended."""
    pairs = inputs.shots.whole_pairs(ShotSet.IDENTIFICATION).rows
    measured, (first, second) = points_mm[:, pairs.ravel()], np.arange(pairs.size).reshape(-1, 2).T
    count, free = len(measured), len(inputs.selection.free)
    lengths, variance = np.empty((2, count, len(pairs)))
    for row, each in enumerate(measured):
        stated = point_covariance_mm2(each, inputs.options.instrument)
        lengths[row] = distances_mm(each, first, second)
        variance[row] = pooled_variance_mm2(distance_variance_mm2(each, stated, first, second))
    near = np.tile(inputs.at_nominal.values[pairs.ravel()].T, (count, 1, 1))
    robots = _robots(inputs, pairs.ravel(), near, kernel)
    problem = DistanceStack(robots, first, second, lengths, np.sqrt(1.0 / variance))
    _, found = _solved(problem, points.x[:, :free], 1)
    found.plain[:] &= points.plain & (lengths >= SHORTEST_MM).all(axis=1)
    return found


def _robots(inputs: Inputs, rows: Index, near: Array, kernel: ModuleType | None) -> RobotStack:
    mechanism, p = inputs.nominal.mechanism, np.tile(inputs.nominal.p, (len(near), 1))
    places = mechanism.parameters.places(inputs.selection.free)
    return RobotStack(mechanism, p, places, inputs.shots.joints[rows], near, kernel=kernel)


def _solved(
    problem: PointStack | DistanceStack, start: Array, block: int
) -> tuple[StackSolution, FitStack]:
    """Fits whose blocks and χ² chance explains, with their covariance."""
    solution = gauss_newton(problem, start)
    count, unknowns = start.shape
    sizes = np.linalg.norm(solution.residual.reshape(count, block, -1), axis=1)
    plain = solution.converged.copy()
    if block > 1:  # outliers among distances were looked for among the points
        plain &= sizes.max(axis=1) <= rejection_threshold(sizes.shape[1], block)
    dof, covariance = solution.residual.shape[1] - unknowns, np.zeros((count, unknowns, unknowns))
    for row in np.flatnonzero(plain):
        tested = information.chi_square_test(float(np.sum(sizes[row] ** 2)), dof)
        plain[row] = bool(tested.consistent)
    if plain.any():
        covariance[plain] = _covariance(problem.robots.kernel, problem.jacobians[plain])
    return solution, FitStack(solution.x, covariance, plain)


def _covariance(kernel: ModuleType | None, jacobians: Array) -> Array:
    """Covariances (R, P, P) of Jacobians (R, M, P); raises `LinAlgError` for a lost rank."""
    if kernel is not None:
        triangle, norms, _, regular = kernel.triangles(
            np.ascontiguousarray(jacobians.swapaxes(1, 2))
        )
        if regular.all():
            return information.covariance_of_triangle(triangle, norms)
    return information.covariance(jacobians)
