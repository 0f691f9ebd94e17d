"""Fits of many campaigns of one plan at once, where `fit_shots` would find nothing out of order.

A row is given up, and left to `fit_shots`, as soon as its fit is not plain: a step that leads
nowhere, a shot that may or may not stand apart, noise that no scatter of the robot's own explains.
"""

from dataclasses import dataclass
from functools import partial
from types import ModuleType
from typing import TypeAlias

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation import information, variance_components
from campaigns.estimation.estimators import Estimator, LossShape, Outliers, Weights
from campaigns.estimation.gauss_newton import SETTLED, StackSolution, gauss_newton
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residual_stacks import (
    DistanceStack,
    PointStack,
    RobotStack,
    can_be_stacked,
)
from campaigns.estimation.rigid_transforms import fit_frames
from campaigns.estimation.robust import linear_inliers, rejection_threshold
from campaigns.estimation.tracker_noise import (
    TrackerUncertainty,
    distance_variance_mm2,
    inverse_roots,
    point_covariance_mm2,
    pooled_variance_mm2,
    pooled_variances_mm2,
)
from campaigns.identification.fit import SCATTER_ROUNDS, settled
from campaigns.identification.observations import COORDINATES, SHORTEST_MM, Inputs
from campaigns.shots.shot_sets import ShotSet

NEARLY = 1e-4
"""Expected length of the next step over the residual's, behind which a fit that only judges shots
is near enough: steps shrink by their square, and what is left moves no residual by 1e-5 σ."""
CLOSE = 1e-3
"""Share of the limit by which the largest size has to be beside it to be judged by such a fit."""
WORTH_A_LOOK = 4.0 / 3.0
"""Score of a component, times the hopeless one, beside which such a fit is ended."""

FittedPoints: TypeAlias = tuple[RobotStack, Array, Mask]
"""Of shots: robots, covariances (C, N, 3, 3) that weighed them, those kept (C, N)."""


@dataclass(frozen=True, slots=True, eq=False)
class FitStack:
    """Fits of C campaigns; rows that were given up say nothing else."""

    x: Array
    """Parameters, mm and rad, (C, F)."""
    covariance: Array
    """(C, F, F)"""
    plain: Mask
    """Rows that were not given up, (C,)."""
    robots: RobotStack | None = None
    """Robots at their fitted shots, whose closures are known."""


def fit_stack(inputs: Inputs, points_mm: Array, kernel: ModuleType | None = None) -> FitStack:
    """Fits of campaigns with the same inputs but for their points (C, N, 3).

    By compiled loops where there is a `kernel`: the same fits but for rounding.
    """
    count, free = len(points_mm), len(inputs.selection.free)
    if not _may_be_plain(inputs):
        return _given_up(count, free)
    try:
        found, points = _fit_points(inputs, points_mm, kernel)
        if inputs.options.estimator is Estimator.DISTANCES:
            found = _fit_distances(inputs, points_mm, found, points, kernel)
    except ValueError:  # points that fix no frame, a covariance that is none, a lost rank
        if count == 1:
            return _given_up(count, free)
        each = [fit_stack(inputs, points_mm[row, None], kernel) for row in range(count)]
        parts = zip(*((one.x, one.covariance, one.plain) for one in each), strict=True)
        x, covariance, plain = (np.concatenate(part) for part in parts)
        return FitStack(x, covariance, plain)
    covariance = found.covariance[:, :free, :free]
    return FitStack(found.x[:, :free], covariance, found.plain, points[0])


def _given_up(count: int, free: int) -> FitStack:
    x, plain = np.zeros((count, free)), np.zeros(count, dtype=bool)
    return FitStack(x, np.zeros((count, free, free)), plain)


def _may_be_plain(inputs: Inputs) -> bool:
    """Whether nothing but the points can make these fits more than plain ones."""
    nominal, selection, options = inputs.nominal, inputs.selection, inputs.options
    space = nominal.mechanism.parameters
    places = space.places(selection.free)
    asked = options.loss is LossShape.LINEAR and options.outliers is Outliers.EXCLUDE
    if options.estimator is Estimator.DISTANCES:
        pairs = inputs.shots.whole_pairs(ShotSet.IDENTIFICATION).rows
        asked &= options.weights is Weights.STATED and len(pairs) > 0
    more = selection.priors or options.sessions or options.frees_reflector_constant
    shots = inputs.shots
    return bool(
        asked
        and not more
        and can_be_stacked(space, nominal.p[None], places)
        and inputs.at_nominal.found.all()
        and not np.isfinite(shots.stated_covariance_mm2).any()
        and not shots.approach.any()
    )


def _fit_points(
    inputs: Inputs, points_mm: Array, kernel: ModuleType | None
) -> tuple[FitStack, FittedPoints]:
    """Fits of coordinates, and what distances of the same shots take from them."""
    shots, near = inputs.shots, inputs.at_nominal.values
    rows = shots.rows_of(ShotSet.IDENTIFICATION)
    measured, joints, near = points_mm[:, rows], shots.joints[rows], near[rows]
    guesses, kept = fit_frames(near[:, :3], measured), np.ones(measured.shape[:2], bool)
    near_all = np.broadcast_to(near.T, (len(measured), *near.T.shape))
    robots = _robots(inputs, joints, near_all, kernel)
    stated, problem = _weighed(robots, measured, inputs.options.instrument, guesses)
    covariance = stated
    of_points = inputs.options.estimator is Estimator.POINTS
    solution, plain = _solved(problem, problem.start(), kept, SETTLED if of_points else NEARLY)
    unknowns = solution.x.shape[1]
    found = FitStack(solution.x, np.zeros((len(plain), unknowns, unknowns)), plain)
    if not (every := np.flatnonzero(plain)).size:
        return found, (robots, covariance, kept)
    found.covariance[every], scores = _scored(problem, solution, every)
    least = variance_components.hopeless_score(measured[0].size - unknowns)
    hopeful = (scores >= least).any(axis=0)
    plain[every[hopeful]] &= kept[every[hopeful]].all(axis=1)
    scores, every = scores[:, hopeful & plain[every]], every[hopeful & plain[every]]
    if not every.size:
        return found, (robots, covariance, kept)
    if not of_points:
        _solve_on(problem, solution, every[(scores >= WORTH_A_LOOK * least).any(axis=0)])
        plain &= solution.converged
    by_x = problem.last_jacobians(solution.x[every], every)
    by_joints = problem.whitened_by_joints(solution.x[every], every)
    for at, row in enumerate(every.tolist()):
        own, one = slice(row, row + 1), np.zeros(1, dtype=np.intp)
        shots_of = partial(_linearized, stated_mm2=stated[row], kernel=kernel)
        linearized = shots_of(
            problem.whitening[row], covariance[row], solution.residual[row], by_x[at], by_joints[at]
        )
        scatter = variance_components.NONE
        known: Array | None = scores[:, at]
        for _ in range(SCATTER_ROUNDS):  # as `fit_points` does
            anew = variance_components.estimate_components(linearized, kernel, known, scatter)
            known = None
            if settled(scatter, anew):
                break
            scatter, covariance = anew, stated.copy() if covariance is stated else covariance
            covariance[row] = scatter.covariance_mm2(stated[row], linearized.by_joints)
            again = _robots(inputs, joints, robots.poses[own], kernel)
            frames = (guesses[0][own], guesses[1][own])
            fitted = _points(again, measured[own], covariance[own], frames)
            agree = kept[own].copy()
            refit, is_plain = _solved(fitted, found.x[own], agree)
            found.x[row], robots.poses[row] = refit.x[0], again.poses[0]
            plain[row] = is_plain[0] and agree.all()
            if not plain[row]:
                break
            found.covariance[own], _ = _scored(fitted, refit, one)
            of_refit = (
                each(refit.x, one)[0] for each in (fitted.last_jacobians, fitted.whitened_by_joints)
            )
            linearized = shots_of(
                fitted.whitening[0], covariance[row], refit.residual[0], *of_refit
            )
            if not scatter.any:
                break
    return found, (robots, covariance, kept)


def _weighed(
    robots: RobotStack,
    measured: Array,
    instrument: TrackerUncertainty,
    guesses: tuple[Array, Array],
) -> tuple[Array, PointStack]:
    """Covariances (C, N, 3, 3) that a tracker states of points (C, N, 3), and these so weighed."""
    if robots.kernel is None:
        stated = point_covariance_mm2(measured, instrument)
        return stated, _points(robots, measured, stated, guesses)
    points_mm, stated, roots, is_regular = robots.kernel.weighed_points(
        measured,
        instrument.along_mm,
        instrument.along_per_mm,
        instrument.across_mm,
        instrument.across_per_mm,
        instrument.robot_scatter_mm,
    )
    if not is_regular:
        raise np.linalg.LinAlgError("a covariance is not positive definite")
    return stated, PointStack(robots, points_mm, roots, guesses)


def _points(
    robots: RobotStack, measured: Array, covariance_mm2: Array, guesses: tuple[Array, Array]
) -> PointStack:
    """Points (C, N, 3) weighed by covariances (C, N, 3, 3)."""
    roots = np.ascontiguousarray(np.moveaxis(inverse_roots(covariance_mm2), 1, -1))
    return PointStack(robots, np.ascontiguousarray(measured.swapaxes(1, 2)), roots, guesses)


def _linearized(
    whitening: Array,
    covariance_mm2: Array,
    residual: Array,
    by_x: Array,
    by_joints: Array,
    stated_mm2: Array,
    kernel: ModuleType | None,
) -> variance_components.LinearizedShots:
    """Shots of one campaign about its fit, from what (3, 3, N) whitens of covariances (N, 3, 3).

    Residuals (3 N,), their derivatives (3 N, P), those of points by the joints (n, 3, N).
    """
    if kernel is not None:
        flat = by_x.T.reshape(-1, COORDINATES, len(stated_mm2)), by_joints
        every = (residual.reshape(1, COORDINATES, -1), *flat)
        misfit, *columns = (kernel.unwhitened(whitening, covariance_mm2, each).T for each in every)
        return variance_components.LinearizedShots(
            misfit[:, :, 0], columns[0], stated_mm2, columns[1]
        )
    back = covariance_mm2 @ whitening.T  # W C Wᵀ = 1
    of_x = (each.reshape(COORDINATES, len(back), -1).swapaxes(0, 1) for each in (residual, by_x))
    by_shot = (*of_x, by_joints.transpose(2, 1, 0))
    misfit_mm, jacobian, through = (back @ each for each in by_shot)
    return variance_components.LinearizedShots(misfit_mm[:, :, 0], jacobian, stated_mm2, through)


def _scored(problem: PointStack, solution: StackSolution, rows: Index) -> tuple[Array, Array]:
    """Covariances (R, P, P) of rows, and scores of components, (2, R).

    Raises `LinAlgError` for a lost rank.
    """
    x, residual = solution.x[rows], solution.residual[rows]
    if compiled := problem.scored(x, residual, rows):
        own, regular, scores = compiled
        if not regular.all():  # by another way others' rounding would depend on it
            raise np.linalg.LinAlgError("a Jacobian is all but singular")
        return own, scores
    jacobians, left = problem.last_jacobians(x, rows), residual.reshape(len(x), COORDINATES, -1)
    own = information.covariance(jacobians)
    by_x = jacobians.reshape(*left.shape, x.shape[1])
    leverage = np.einsum("cinp,cjnp->cijn", by_x @ own[:, None], by_x)
    columns = (problem.whitening[rows], problem.whitened_by_joints(x, rows).swapaxes(1, 2))
    return own, variance_components.component_scores(left, leverage, *columns)


def _fit_distances(
    inputs: Inputs,
    points_mm: Array,
    points: FitStack,
    fitted: FittedPoints,
    kernel: ModuleType | None,
) -> FitStack:
    """Distances of shots that were kept, weighed as points were, from where their fits ended."""
    shots, (seen, covariance_mm2, kept) = inputs.shots, fitted
    pairs = shots.whole_pairs(ShotSet.IDENTIFICATION).rows
    own_rows = np.searchsorted(shots.rows_of(ShotSet.IDENTIFICATION), pairs.ravel())
    measured, (first, second) = points_mm[:, pairs.ravel()], np.arange(pairs.size).reshape(-1, 2).T
    free = len(inputs.selection.free)
    lengths = distances_mm(measured, first, second)
    own = distance_variance_mm2(measured, covariance_mm2[:, own_rows], first, second)
    whole: Mask = kept[:, own_rows[::2]] & kept[:, own_rows[1::2]]
    variances_mm2 = pooled_variances_mm2(own)
    for row in np.flatnonzero(~whole.all(axis=1) & whole.any(axis=1)):
        variances_mm2[row] = pooled_variance_mm2(own[row, whole[row]])
    whitening = whole / np.sqrt(variances_mm2)[:, None]
    joints, near = shots.joints[pairs.ravel()], seen.poses[:, :, own_rows]
    robots = _robots(inputs, joints, near, kernel, seen)
    problem = DistanceStack(robots, first, second, lengths, whitening)
    solution, plain = _solved(problem, points.x[:, :free], whole)
    plain &= points.plain & (lengths >= SHORTEST_MM).all(axis=1)
    rows, covariance = np.flatnonzero(plain), np.zeros((len(plain), free, free))
    if rows.size:
        jacobians = problem.last_jacobians(solution.x[rows], rows)
        covariance[rows] = covariances(kernel, jacobians)
    return FitStack(solution.x, covariance, plain)


def _robots(
    inputs: Inputs,
    joints: Array,
    near: Array,
    kernel: ModuleType | None,
    about: RobotStack | None = None,
) -> RobotStack:
    mechanism, p = inputs.nominal.mechanism, np.tile(inputs.nominal.p, (len(near), 1))
    places = mechanism.parameters.places(inputs.selection.free)
    return RobotStack(mechanism, p, places, joints, near, kernel=kernel, about=about)


def _solved(
    problem: PointStack | DistanceStack, start: Array, kept: Mask, settled_at: float = SETTLED
) -> tuple[StackSolution, Mask]:
    """Fits of blocks (C, B) that are kept, and where chance explains these and χ², (C,).

    Outliers among points are left out of what is kept, here too.
    """
    solution = gauss_newton(problem, start, settled_at=settled_at)
    if isinstance(problem, PointStack):  # those among distances were looked for among the points
        _leave_out(problem, solution, kept)
    block = solution.residual.shape[1] // kept.shape[1]
    dof, chi2 = block * kept.sum(axis=1) - start.shape[1], np.sum(solution.residual**2, axis=1)
    # less than chance explains widens no σ
    plain = solution.converged & (dof > 0) & ~information.is_beyond_chance(chi2, dof)
    return solution, plain


def _leave_out(problem: PointStack, solution: StackSolution, kept: Mask) -> None:
    """Take shots apart from the others out of the problem, `kept` and solution.

    A row where these may be told otherwise has not converged.
    """
    limit = rejection_threshold(kept.shape[1], COORDINATES)
    rows = np.flatnonzero(solution.converged & (_largest(solution) > (1.0 - CLOSE) * limit))
    _solve_on(problem, solution, rows)
    rows = rows[solution.converged[rows] & (_largest(solution)[rows] > limit)]
    if not rows.size:
        return
    solution.converged[rows] = False
    jacobians = problem.last_jacobians(solution.x[rows], rows)
    for row, jacobian in zip(rows.tolist(), jacobians, strict=True):
        shots = jacobian.reshape(COORDINATES, kept.shape[1], -1).swapaxes(0, 1)
        left = solution.residual[row].reshape(COORDINATES, -1).T.ravel()
        inliers = linear_inliers(shots.reshape(jacobian.shape), left, COORDINATES)
        if inliers is not None:
            solution.converged[row], kept[row] = True, inliers
            problem.whitening[row] *= inliers
    _solve_on(problem, solution, rows[~kept[rows].all(axis=1)])


def _largest(solution: StackSolution) -> Array:
    """Size of the largest misfit of a shot, (C,)."""
    by_shot = solution.residual.reshape(len(solution.x), COORDINATES, -1)
    return np.asarray(np.linalg.norm(by_shot, axis=1).max(axis=1))


def _solve_on(problem: PointStack, solution: StackSolution, rows: Index) -> None:
    """Solve some rows on from where they are, to the end."""
    if rows.size:
        again = gauss_newton(problem, solution.x, rows)
        solution.x[rows], solution.residual[rows] = again.x[rows], again.residual[rows]
        solution.converged[rows] = again.converged[rows]


def covariances(kernel: ModuleType | None, jacobians: Array) -> Array:
    """Covariances (R, P, P) of Jacobians (R, M, P); `LinAlgError` for a lost rank."""
    if kernel is None:
        return information.covariance(jacobians)
    found, regular = kernel.covariances(np.ascontiguousarray(jacobians.swapaxes(1, 2)))
    if not regular.all():
        found[~regular] = information.covariance(jacobians[~regular])
    return np.asarray(found)
