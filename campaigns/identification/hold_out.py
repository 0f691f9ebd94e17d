"""Hold-out pairs: shots that were never fitted, whose distances test the whole result.

Residuals of fitted shots cannot show errors that the model took over into wrong parameters. The
distance between two unseen points can: it needs no frame, and the posterior states how far it may
be off. χ² of all pairs by that covariance tests the model; the ratio of real to stated errors
widens σ of positions where the test fails.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from campaigns.arrays import Array, Index
from campaigns.fit.error_model import Observations
from campaigns.fit.posterior import Posterior, noise_parts
from campaigns.fit.rigid_transforms import directions, distances_mm
from campaigns.identification.findings import HoldOut
from campaigns.identification.observations import observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import Excluded, ResidualTable
from campaigns.kinematics.mechanism import KinematicSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

WORSE_LEVEL = 0.99
"""Probability that errors of equal models stay below, from which hold-out pairs got worse."""


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
        limit = float(scipy.special.stdtrit(count - 1, WORSE_LEVEL))
        return bool(mean > limit * float(growth.std(ddof=1)) / count**0.5)


def unseen_pairs(
    posterior: Posterior,
    shots: Shots,
    at_nominal: KinematicSolution,
    identified: KinematicSolution,
    options: IdentificationOptions,
) -> UnseenPairs:
    """Compare the measured distances of the validation pairs with those of the identified robot.

    `at_nominal` and `identified` hold the poses of all shots by both robots. With a frame for each
    session, both shots of a pair must be of one session that was fitted.
    """
    # Where the nominal robot already cannot be assembled, a pair is not counted. Where only the
    # identified robot cannot, the pair contradicts the result and is reported as lost.
    pairs = shots.whole_pairs(ShotSet.VALIDATION).rows
    usable = at_nominal.is_solved[pairs].all(axis=1)
    if options.sessions:
        session = shots.session[pairs]
        sessions = shots.session[shots.rows_of(ShotSet.IDENTIFICATION)]
        usable &= (session[:, 0] == session[:, 1]) & np.isin(session[:, 0], sessions)
    can_be_taken = identified.is_solved[pairs].all(axis=1)
    lost = tuple(
        Excluded("the identified robot cannot be assembled there", pair=shots.pairs[row])
        for row in pairs[usable & ~can_be_taken][:, 0].tolist()
    )
    rows = pairs[usable & can_be_taken]
    if not len(rows):
        return UnseenPairs(rows, None, None, lost)
    table = distance_errors(shots, rows, at_nominal.values, identified.values)
    test = _test_distances(posterior, shots, at_nominal.values, rows, options)
    return UnseenPairs(rows, table, test, lost)


def distance_errors(shots: Shots, rows: Index, before: Array, after: Array) -> ResidualTable:
    """Return modelled minus measured distances of pairs (M, 2), by poses (N, t) of all shots."""
    measured = shots.measured_distances_mm(rows)
    errors = (
        (distances_mm(poses[:, :3], rows[:, 0], rows[:, 1]) - measured)[:, None]
        for poses in (before, after)
    )
    numbers = [shots.pairs[row] or 0 for row in rows[:, 0].tolist()]
    return ResidualTable.from_arrays("pairs", numbers, *errors)


def _test_distances(
    posterior: Posterior, shots: Shots, near: Array, rows: Index, options: IdentificationOptions
) -> HoldOut:
    """Test the distances of pairs (M, 2) by their covariance: of parameters, and of both points."""
    # 1. Linearise the model at the identified unknowns for the shots of the pairs.
    # 2. Project the residuals of both points on the line between them: the distance's error.
    # 3. Propagate the covariance of the unknowns and the noise of the points to the distances.
    # 4. χ² by the full covariance, since all pairs have the parameters' errors in common.
    used, places = np.unique(rows, return_inverse=True)  # pairs may share a shot
    observations = _unseen_observations(shots, used, near, options)
    model = posterior.model
    at = model.linearise(observations, posterior.x, posterior.at.frames, observations.near)
    by_points = _distances_by_points(observations.points, places.reshape(rows.shape))
    errors = (by_points * at.residual).sum(axis=(1, 2))
    by_unknowns = np.einsum("mnk,nkq->mq", by_points, at.jacobian)
    covariance = by_unknowns @ _covariance_without_changes(posterior) @ by_unknowns.T
    factors = posterior.components.factors
    parts = noise_parts(model, observations, at.by_joint).items()
    noise = sum(factors.get(part, 1.0) * part_covariance for part, part_covariance in parts)
    covariance += np.einsum("ank,nkl,bnl->ab", by_points, noise, by_points, optimize=True)
    chi2 = float(errors @ np.linalg.solve(covariance, errors))
    p = float(scipy.special.chdtrc(len(rows), chi2))
    ratio = float(np.sqrt((errors**2).sum() / np.trace(covariance)))
    return HoldOut(len(rows), chi2, p, ratio)


def _unseen_observations(
    shots: Shots, rows: Index, near: Array, options: IdentificationOptions
) -> Observations:
    """Return the observations of some rows, each in the frame that its session was fitted with."""
    unseen = shots.rows(rows)
    observations = observations_of(unseen, near[rows], options)
    if not options.sessions:
        return observations
    fitted_sessions = np.unique(shots.session[shots.rows_of(ShotSet.IDENTIFICATION)])
    return replace(observations, frame=np.searchsorted(fitted_sessions, unseen.session))


def _distances_by_points(points_mm: Array, pairs: Index) -> Array:
    """Return the derivatives (M, N, 3) of the distances of pairs (M, 2) by all points (N, 3)."""
    first, second = pairs.T
    along = directions(points_mm, first, second)
    by_points = np.zeros((len(pairs), len(points_mm), 3))
    pair = np.arange(len(pairs))
    by_points[pair, second] += along
    by_points[pair, first] -= along
    return by_points


def _covariance_without_changes(posterior: Posterior) -> Array:
    """Return the covariance of the model's unknowns and frames; no unseen shot has changes."""
    changes = range(len(posterior.model.names), len(posterior.at.x))
    return np.delete(np.delete(posterior.covariance, changes, axis=0), changes, axis=1)
