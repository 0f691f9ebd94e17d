"""Parameter estimation: values with their covariance, what was held, and what was left out."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.estimation import information
from campaigns.estimation.least_squares import (
    IdentifiableSubspace,
    LeastSquaresProblem,
    Priors,
    Solution,
    solve,
)
from campaigns.estimation.observability import (
    Observability,
    observability,
    project_out_nuisance,
    triangle_of,
)
from campaigns.estimation.robust import ROUNDING, Inliers, Outlier, reject_outliers

CONSTRAINT_ROUNDS = 3
VARIANCE_ROUNDS = 6
VARIANCE_SETTLED = 0.01
CONFLICT_SIGMAS = 4.0
"""Standard deviations by which measurements and a prior may differ."""
LEAST_FREEDOM = 0.5
"""With less left of the measurements than this their scatter says nothing."""
LEAST_VARIANCE_FACTOR = 1e-3
"""Priors never weigh against less scatter than this part of the stated one."""
NOTHING_MOVES = 1e-6
"""A parameter with less than this share in an unobservable combination takes no part in it."""


PriorConflict: TypeAlias = tuple[int, float, float, float]
"""Place of a prior that the measurements contradict, what they alone say with its σ, in mm or rad,
and how far that is from the prior's mean, by both their standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """The unknowns, the parameters among them first, and how well they are known."""

    x: Array
    """(P,), mm and rad."""
    covariance: Array | None
    """(P, P); of what was free to move. None where nothing tells it."""
    identifiable: Mask
    """Parameters that take part in no combination held at its nominal value, (F,)."""
    seen: Observability
    """Of the parameters alone, with the priors."""
    data_seen: Observability
    """Of the parameters alone, by the measurements alone."""
    noise: information.ChiSquareTest
    kept: Mask
    """(blocks,)"""
    outliers: tuple[Outlier, ...]
    fit: Solution
    """How the solver ended."""
    conflicts: tuple[PriorConflict, ...] = ()
    """Known only where the measurements alone tell all parameters."""


def estimate(
    problem: LeastSquaresProblem,
    parameters: int,
    *,
    known_variance: bool,
    exclude: bool = True,
    start: Estimate | None = None,
) -> Estimate:
    """Estimate with the first unknowns being parameters, the others (a frame) nuisance.

    What neither data nor priors identify is held where it starts, also if it comes to be identified
    a little once the others have moved. `known_variance`: as `variance_scale` has it. `exclude`
    leaves out what all others contradict. `start` has values near the first unknowns, where the
    solver begins, if not where the problem does, and its evaluations count. Raises `NoSolution`
    when the problem's own start has no answer.
    """
    at, kept = problem.data.start(), np.ones(problem.blocks, dtype=bool)
    for _ in range(CONSTRAINT_ROUNDS):
        seen = _observed(problem, _triangle(problem, at, kept), parameters)
        held = replace(problem, subspace=_subspace(problem, seen))
        near = start if held.subspace is None else None
        begin, spent = (None, 0) if near is None else (near.x[: len(at)], near.fit.evaluations)
        agreed = reject_outliers(held, begin, spent) if exclude else Inliers(kept, ())
        kept = agreed.kept
        first = agreed.fit
        if first is None:
            first = solve(held.weighted(kept.astype(np.float64)), start=begin, spent=spent)
        last, fit, noise = _solved(held, first, kept=kept, known_variance=known_variance)
        at = last.x(fit.x)
        triangle = _triangle(last, at, kept)
        found = _observed(last, triangle, parameters)
        if found.rank >= seen.rank:
            break
    observed = found if found.rank == seen.rank else seen
    by_data = observed
    if len(problem.priors):
        by_data = _observed(replace(last, priors=Priors.none()), triangle, parameters)
    with_conflicts = len(problem.priors) > 0 and by_data.rank == parameters
    return Estimate(
        at,
        _covariance(last, triangle, noise),
        _identifiable(seen),
        observed,
        by_data,
        noise,
        kept,
        agreed.outliers,
        fit,
        tuple(_prior_conflicts(problem, at, kept)) if with_conflicts else (),
    )


def _prior_conflicts(problem: LeastSquaresProblem, x: Array, kept: Mask) -> Iterator[PriorConflict]:
    """Priors far from where a step to the minimum of the measurements alone leads."""
    rows = problem.data.jacobian(x)[np.repeat(kept, problem.block)]
    misfit = problem.data.residual(x)[np.repeat(kept, problem.block)]
    freedom = len(rows) - len(x)
    if freedom < 1:
        return
    try:
        of_all = information.covariance(rows)
    except np.linalg.LinAlgError:
        return
    step = -of_all @ (rows.T @ misfit)
    tested = information.chi_square_test(float(np.sum((misfit + rows @ step) ** 2)), freedom)
    alone, variance, priors = x + step, tested.widening**2 * np.diag(of_all), problem.priors
    for place, mean, std in zip(priors.places.tolist(), priors.mean, priors.std, strict=True):
        sigmas = abs(alone[place] - mean) / np.sqrt(std**2 + variance[place])
        if sigmas > CONFLICT_SIGMAS:
            own_std = float(np.sqrt(variance[place]))
            yield place, float(alone[place]), own_std, float(sigmas)


def _jacobian(problem: LeastSquaresProblem, x: Array, kept: Mask) -> Array:
    """∂(whitened measurements, priors)/∂unknowns, (M + K, P); zeros for what was left out."""
    data = problem.data.jacobian(x)
    if problem.sigma0 != 1.0 or not kept.all():
        data = data * (np.repeat(kept, problem.block) / problem.sigma0)[:, None]
    if not len(problem.priors):
        return data
    return np.vstack([data, problem.priors.jacobian(len(x))])


def _triangle(problem: LeastSquaresProblem, x: Array, kept: Mask) -> Array:
    """Triangle (P, P) of ∂(whitened measurements)/∂unknowns, without what was left out."""
    rows = problem.data.jacobian(x)
    return triangle_of(rows if kept.all() else rows[np.repeat(kept, problem.block)])


def _beside_priors(problem: LeastSquaresProblem, triangle: Array) -> Array:
    """Rows that tell as much as measurements of this triangle, and priors, (P + K, P)."""
    return np.vstack([triangle / problem.sigma0, problem.priors.jacobian(triangle.shape[1])])


def _observed(problem: LeastSquaresProblem, triangle: Array, parameters: int) -> Observability:
    """Observability of the parameters, the first unknowns, by measurements of this triangle."""
    alone = project_out_nuisance(_beside_priors(problem, triangle), parameters)
    return replace(observability(alone), rows=problem.rows)


def _subspace(problem: LeastSquaresProblem, seen: Observability) -> IdentifiableSubspace | None:
    """Steps that leave the unobservable combinations as they are; None when there are none."""
    count = len(seen.scale)
    if seen.rank == count:
        return None
    start = problem.data.start()
    others = len(start) - count
    directions = np.zeros((len(start), seen.rank + others))
    directions[:count, : seen.rank] = seen.identifiable_directions.T / seen.scale[:, None]
    directions[count:, seen.rank :] = np.eye(others)
    return IdentifiableSubspace(start, directions)


def _solved(
    problem: LeastSquaresProblem, first: Solution, *, kept: Mask, known_variance: bool
) -> tuple[LeastSquaresProblem, Solution, information.ChiSquareTest]:
    """Fit whose priors count against the scatter that the measurements turn out to have.

    With the problem as it is by that scatter, and the test of it.
    """
    tested = _tested(problem, first, kept)
    is_stated = information.variance_is_stated(tested, known_variance=known_variance)
    fit, scatter = first, None if is_stated else _scatter(problem, first, kept)
    scale_of = partial(information.variance_scale, tested=tested, known_variance=known_variance)
    for _ in range(VARIANCE_ROUNDS if len(problem.priors) else 0):
        sigma0 = max(scale_of(scatter) or 1.0, LEAST_VARIANCE_FACTOR)
        if abs(sigma0 / problem.sigma0 - 1.0) < VARIANCE_SETTLED:
            break
        problem = replace(problem, sigma0=sigma0)
        fit = solve(problem.weighted(kept.astype(np.float64)))
        scatter = _scatter(problem, fit, kept)
    tested = information.chi_square_test(tested.chi2, tested.dof, scale_of(scatter))
    return problem, fit, tested


def _tested(problem: LeastSquaresProblem, fit: Solution, kept: Mask) -> information.ChiSquareTest:
    """χ² of what was kept, and of the priors, by the stated noise."""
    priors, x = problem.priors, problem.x(fit.x)
    surprises = priors.residual(x)
    chi2 = float(np.sum(problem.sizes(fit.x)[kept] ** 2) + surprises @ surprises)
    dof = int(problem.block * kept.sum()) + len(priors) - len(fit.x)
    return information.chi_square_test(chi2, dof)


def _scatter(problem: LeastSquaresProblem, fit: Solution, kept: Mask) -> float | None:
    """Standard deviation of the whitened residuals as it acts on the unknowns.

    The freedom that the data have is what their leverages leave of them; priors have the rest.
    """
    freedom = problem.block * kept.sum() - _leverage(problem, fit, kept)
    if freedom < LEAST_FREEDOM:
        return None
    sizes = problem.sizes(fit.x)[kept]
    return float(np.sqrt(np.sum(sizes**2) / freedom))


def _leverage(problem: LeastSquaresProblem, fit: Solution, kept: Mask) -> float:
    """Degrees of freedom that the measurements give away; without priors one an unknown."""
    if not len(problem.priors):
        return float(len(fit.x))
    basis, _ = np.linalg.qr(_reduced_jacobian(problem, fit, kept))
    return float(np.sum(basis[: problem.block * problem.blocks] ** 2))


def _reduced_jacobian(problem: LeastSquaresProblem, fit: Solution, kept: Mask) -> Array:
    """Rows by what is free to move, columns scaled, (M + K, R)."""
    rows = _jacobian(problem, problem.x(fit.x), kept)
    if problem.subspace is not None:
        rows = rows @ problem.subspace.directions
    return np.asarray(rows / np.linalg.norm(rows, axis=0))


def _covariance(
    problem: LeastSquaresProblem, triangle: Array, noise: information.ChiSquareTest
) -> Array | None:
    """(P, P), of measurements at their allowed scatter and the priors as they are."""
    if (sigma0 := noise.sigma0) is None:
        return None
    rows = _beside_priors(replace(problem, sigma0=max(sigma0, ROUNDING)), triangle)
    subspace = problem.subspace
    directions = np.eye(rows.shape[1]) if subspace is None else subspace.directions
    try:
        moving = information.covariance(rows @ directions)
    except np.linalg.LinAlgError:  # more was lost on the way than where it began
        return None
    return np.asarray(directions @ moving @ directions.T)


def _identifiable(seen: Observability) -> Mask:
    """Mask of parameters that take part in no unobservable combination, (F,)."""
    return np.asarray(np.abs(seen.null_directions).max(axis=0, initial=0.0) < NOTHING_MOVES)
