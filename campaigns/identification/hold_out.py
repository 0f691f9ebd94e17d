"""Hold-out pairs: shots that were never fitted, whose distances test the whole result."""

from dataclasses import dataclass, replace

import numpy as np
import scipy

from campaigns.arrays import Array, Index
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
        if self.errors is None:
            return False
        more = self.errors.after[:, 0] ** 2 - self.errors.before[:, 0] ** 2
        count, mean = len(more), float(more.mean())
        if count < 3:
            return mean > 0.0
        limit = float(scipy.special.stdtrit(count - 1, WORSE_LEVEL))
        return bool(mean > limit * float(more.std(ddof=1)) / count**0.5)


def unseen_pairs(
    posterior: Posterior,
    shots: Shots,
    at_nominal: KinematicSolution,
    identified: KinematicSolution,
    options: IdentificationOptions,
) -> UnseenPairs:
    """Compare the distances of the validation pairs with the identified robot's.

    `at_nominal` and `identified` hold the poses of all shots by both robots. With a frame for each
    session, both shots of a pair must be of one session that was fitted.
    """
    pairs = shots.whole_pairs(ShotSet.VALIDATION).rows
    usable = at_nominal.is_solved[pairs].all(axis=1)
    if options.sessions:
        session = shots.session[pairs]
        sessions = shots.session[shots.rows_of(ShotSet.IDENTIFICATION)]
        usable &= (session[:, 0] == session[:, 1]) & np.isin(session[:, 0], sessions)
    taken = identified.is_solved[pairs].all(axis=1)
    lost = tuple(
        Excluded("the identified robot cannot be assembled there", pair=shots.pairs[row])
        for row in pairs[usable & ~taken][:, 0].tolist()
    )
    rows = pairs[usable & taken]
    if not len(rows):
        return UnseenPairs(rows, None, None, lost)
    table = distance_errors(shots, rows, at_nominal.values, identified.values)
    test = _tested(posterior, shots, at_nominal.values, rows, options)
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


def _tested(
    posterior: Posterior, shots: Shots, near: Array, rows: Index, options: IdentificationOptions
) -> HoldOut:
    """Test the distances of pairs (M, 2) by their covariance: of parameters, and of both points."""
    used, places = np.unique(rows, return_inverse=True)
    subset = shots.rows(used)
    observations = observations_of(subset, near[used], options)
    if options.sessions:
        sessions = np.unique(shots.session[shots.rows_of(ShotSet.IDENTIFICATION)])
        observations = replace(observations, frame=np.searchsorted(sessions, subset.session))
    model, factors = posterior.model, posterior.components.factors
    at = model.linearise(observations, posterior.x, posterior.at.frames, observations.near)
    parts = noise_parts(model, observations, at.by_joint).items()
    noise = sum(factors.get(part, 1.0) * covariance for part, covariance in parts)
    first, second = places.reshape(rows.shape).T
    along = directions(subset.points_in_tracker_mm, first, second)
    by_points = np.zeros((len(rows), len(used), 3))
    pair = np.arange(len(rows))
    by_points[pair, second] += along
    by_points[pair, first] -= along
    errors = (by_points * at.residual).sum(axis=(1, 2))
    by_unknowns = np.einsum("mnk,nkq->mq", by_points, at.jacobian)
    changes = range(len(model.names), len(posterior.at.x))  # they touch no pair
    unknowns = np.delete(np.delete(posterior.covariance, changes, axis=0), changes, axis=1)
    covariance = by_unknowns @ unknowns @ by_unknowns.T
    covariance += np.einsum("ank,nkl,bnl->ab", by_points, noise, by_points, optimize=True)
    chi2 = float(errors @ np.linalg.solve(covariance, errors))
    p = float(scipy.special.chdtrc(len(rows), chi2))
    ratio = float(np.sqrt((errors**2).sum() / np.trace(covariance)))
    return HoldOut(len(rows), chi2, p, ratio)
