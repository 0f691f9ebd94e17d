"""Hold-out pairs: shots that were never fitted, whose distances test the whole result.

Residuals of fitted shots cannot show errors that the model took over into wrong parameters. The
distance between two unseen points can: it needs no frame, and the posterior states how far it may
be off. χ² of all pairs by that covariance tests the model; the ratio of real to stated errors
widens σ of positions where the test fails.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.evaluation.decision import chance_of_larger, decide_change, effective_dof
from campaigns.evaluation.summary import distance_requirements
from campaigns.fit.error_model import Observations
from campaigns.fit.fit import Fit, noise_parts
from campaigns.fit.rigid_transforms import directions
from campaigns.fit.uncertainty import unseen_covariances
from campaigns.identification.findings import HoldOut
from campaigns.identification.result import Excluded, ResidualTable
from campaigns.kinematics.model import KinematicSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots


@dataclass(frozen=True, slots=True, eq=False)
class UnseenPairs:
    """Validation pairs: their rows, errors and test, and pairs that the identified robot lost."""

    rows: Index
    """(M, 2)"""
    errors: ResidualTable | None
    test: HoldOut | None
    lost: tuple[Excluded, ...]

    @property
    def got_worse(self) -> bool:
        """Whether errors grew beyond chance, pair by pair (Student's t)."""
        # A paired test: before and after are of the same points, so their common noise drops out.
        # It does not use stated σ, which may be what is wrong. Two pairs have no useful scatter.
        if self.errors is None:
            return False
        growth = self.errors.after[:, 0] ** 2 - self.errors.before[:, 0] ** 2
        count, mean = len(growth), float(growth.mean())
        if count < 3:
            return mean > 0.0
        std = float(growth.std(ddof=1)) / count**0.5
        return decide_change(mean, std, count - 1) == "larger"


@dataclass(frozen=True, slots=True, eq=False)
class PredictedPoints:
    """Points that were never fitted, by the fit: how far off they are, and how far they may be."""

    residual: Array
    """Predicted minus measured, (N, 3), mm."""
    jacobian: Array
    """Derivatives by all unknowns of the fit, (N, 3, Q)."""
    scatter: Array
    """Covariance by the robot's scatter, (N, 3, 3), mm²."""
    noise: Array
    """Covariance by all that is no unknown: scatter, tracker, layers between shots, (N, 3, 3)."""


def predict_points(fit: Fit, unseen: Observations) -> PredictedPoints:
    """Predict points at the identified unknowns, effects included."""
    at = fit.model.predict(fit.at.x, fit.at.frames, unseen, unseen.near)
    noise_of = noise_parts(fit.model, unseen, at.by_joint)
    noise = sum(fit.factors.get(part, 1.0) * covariance for part, covariance in noise_of.items())
    scatter = sum(fit.factors[part] * noise_of[part] for part in ("points", "joints"))
    return PredictedPoints(
        at.residual,
        at.jacobian,
        np.asarray(scatter),
        noise + unseen_covariances(fit, at.by_moves, unseen),
    )


def unseen_pairs(
    fit: Fit,
    shots: Shots,
    at_nominal: KinematicSolution,
    identified: KinematicSolution,
    observations: Observations,
    left_out: Collection[int],
) -> UnseenPairs:
    """Compare the measured distances of the validation pairs with those of the identified robot.

    `at_nominal` and `identified` hold the poses of all shots by both robots, `observations` are of
    all shots, `left_out` are the numbers of wrong ones. Both shots of a pair must be of one session
    that was fitted.
    """
    # Where the nominal robot already cannot be assembled, a pair is not counted, nor is one with a
    # wrong shot. Where only the identified robot cannot, the pair contradicts the result and is
    # reported as lost.
    pairs = shots.whole_pairs(ShotSet.VALIDATION).rows
    is_wrong = np.isin(np.array(shots.numbers), list(left_out))
    usable = at_nominal.is_solved[pairs].all(axis=1) & ~is_wrong[pairs].any(axis=1)
    frame = observations.frame[pairs]
    usable &= (frame[:, 0] == frame[:, 1]) & (frame[:, 0] >= 0)
    can_be_taken = identified.is_solved[pairs].all(axis=1)
    lost = tuple(
        Excluded("the identified robot cannot be assembled there", pair=shots.pairs[row])
        for row in pairs[usable & ~can_be_taken][:, 0].tolist()
    )
    rows = pairs[usable & can_be_taken]
    if not len(rows):
        return UnseenPairs(rows, None, None, lost)
    before, after = map(fit.model.nominal.points, (at_nominal.values, identified.values))
    table = distance_errors(shots, rows, before, after)
    return _predicted_pairs(fit, table, rows, observations, lost)


def _predicted_pairs(
    fit: Fit,
    table: ResidualTable,
    rows: Index,
    observations: Observations,
    lost: tuple[Excluded, ...],
) -> UnseenPairs:
    """Test the distances of pairs (M, 2) by their covariance: of parameters, and of both points.

    `table` has the errors of the identified parameters alone, by which limits are judged.
    """
    # 1. Predict the points of the pairs at the identified unknowns, effects included.
    # 2. Project the residuals of both points on the line between them: the distance's error.
    # 3. Propagate the covariance of the unknowns and the noise of the points to the distances.
    # 4. χ² by the full covariance, since all pairs have the parameters' errors in common.
    used, places = np.unique(rows, return_inverse=True)  # pairs may share a shot
    unseen = observations.rows(used)
    at = predict_points(fit, unseen)
    by_points = _distances_by_points(unseen.points, places.reshape(rows.shape))
    errors = (by_points * at.residual).sum(axis=(1, 2))
    by_unknowns = np.einsum("mnk,nkq->mq", by_points, at.jacobian)
    covariance = by_unknowns @ fit.covariance @ by_unknowns.T
    covariance += np.einsum("ank,nkl,bnl->ab", by_points, at.noise, by_points, optimize=True)
    chi2 = float(errors @ np.linalg.solve(covariance, errors))
    # The robot's scatter was estimated from few shots: χ² has its degrees of freedom.
    estimated = np.einsum("mnk,nkl,mnl->", by_points, at.scatter, by_points, optimize=True)
    dof = effective_dof(float(np.trace(covariance)), float(estimated), max(fit.freedom, 1.0))
    p = chance_of_larger(chi2, len(rows), dof)
    ratio = float(np.sqrt((errors**2).sum() / np.trace(covariance)))
    requirements = distance_requirements(
        table.after[:, 0], covariance, {"mean": 0.0, "max": 0.0}, dof
    )
    reach_mm = {
        name: float(abs(requirement.error or 0.0) + (requirement.expanded_uncertainty or 0.0))
        for name, requirement in zip(("mean", "max"), requirements, strict=True)
    }
    return UnseenPairs(rows, table, HoldOut(len(rows), chi2, p, ratio, reach_mm), lost)


def distance_errors(shots: Shots, rows: Index, before: Array, after: Array) -> ResidualTable:
    """Return modelled minus measured distances of pairs (M, 2), by points (N, 3) of all shots."""
    errors = (shots.distance_errors_mm(rows, points)[:, None] for points in (before, after))
    numbers = [shots.pairs[row] or 0 for row in rows[:, 0].tolist()]
    return ResidualTable.from_arrays("pairs", numbers, *errors)


def _distances_by_points(points_mm: Array, pairs: Index) -> Array:
    """Return the derivatives (M, N, 3) of the distances of pairs (M, 2) by all points (N, 3)."""
    first, second = pairs.T
    along = directions(points_mm, first, second)
    by_points = np.zeros((len(pairs), len(points_mm), 3))
    pair = np.arange(len(pairs))
    by_points[pair, second] += along
    by_points[pair, first] -= along
    return by_points
