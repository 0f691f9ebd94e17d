"""Hold-out: pairs that were never fitted, and what they say of the fit's uncertainty."""

from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.information import HoldOut
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residuals import DistanceResiduals, PositionModel
from campaigns.estimation.tracker_noise import distance_variance_mm2
from campaigns.identification.fit import Fit
from campaigns.identification.observations import Inputs, without_assembly
from campaigns.identification.result import Excluded, ResidualTable
from campaigns.mechanisms.mechanism import KinematicSolution, NoSolution
from campaigns.shots.shot_sets import ShotSet


@dataclass(frozen=True, slots=True, eq=False)
class UnseenPairs:
    """Pairs that were never fitted: their errors, and what of them could not be used."""

    errors: ResidualTable | None
    tested: HoldOut | None
    """None without pairs, or where no σ is known."""
    unusable: tuple[Excluded, ...]
    lost: tuple[Excluded, ...]
    """By the identified robot."""
    rows: Index
    """Of the shots of the pairs that could be used, (M, 2)."""
    identified: KinematicSolution
    """The identified robot's poses at all shots."""


def unseen_pairs(inputs: Inputs, fit: Fit) -> UnseenPairs:
    """Errors of the pairs that were not fitted, with the nominal and the found parameters."""
    shots, x = inputs.shots, fit.found.x[: len(inputs.selection.free)]
    usable, excluded = inputs.usable_pairs(ShotSet.VALIDATION)
    model = inputs.model_of(shots)
    solution = model.kinematics(x).forward(shots.joints, approach=shots.approach)
    whole = solution.found[usable].all(axis=1)
    lost = without_assembly(shots, usable[~whole], solution.found, "identified")
    kept = usable[whole]
    if len(kept) == 0:
        return UnseenPairs(None, None, excluded, lost, kept, solution)
    measured_mm = shots.measured_distances_mm(kept)
    before, after = (
        (distances_mm(values[:, :3], kept[:, 0], kept[:, 1]) - measured_mm)[:, None]
        for values in (inputs.at_nominal.values, solution.values)
    )
    pairs = tuple(shots.pairs[row] or 0 for row in kept[:, 0].tolist())
    errors = ResidualTable.from_arrays("pairs", pairs, before, after)
    rows, places = np.unique(kept, return_inverse=True)
    some = replace(inputs, shots=shots.rows(rows))
    tested = _tested(some, solution.values[rows], places.reshape(kept.shape), fit)
    return UnseenPairs(errors, tested, excluded, lost, kept, solution)


def _tested(inputs: Inputs, near: Array, pairs: Index, fit: Fit) -> HoldOut | None:
    """Test of hold-out pairs (M, 2) against the covariance of parameters and shots."""
    found, shots, parameters = fit.found, inputs.shots, len(inputs.selection.free)
    if found.covariance is None or found.noise.sigma0 is None:
        return None
    x = found.x[:parameters]
    model = inputs.model_of(shots, near)
    try:
        unseen = DistanceResiduals.in_mm(
            model, pairs[:, 0], pairs[:, 1], shots.measured_distances_mm(pairs)
        )
        error_mm, by_x = unseen.errors_mm(x), unseen.jacobian(x)
        variance = _pair_variance_mm2(inputs, pairs, model, x, fit)
    except (NoSolution, np.linalg.LinAlgError):
        return None
    covariance = found.covariance[:parameters, :parameters]
    return HoldOut.of(error_mm, variance, by_x, covariance, fit.variance_dof)


def _pair_variance_mm2(
    inputs: Inputs, pairs: Index, model: PositionModel, x: Array, fit: Fit
) -> Array:
    """Variance of each measured distance, the robot's own scatter included, (M,)."""
    shots, sigma0 = inputs.shots, fit.found.noise.sigma0 or 1.0
    if isinstance(fit.observations.residuals, DistanceResiduals) and fit.points is None:
        own = fit.observations.residuals.whitening
        return np.full(len(pairs), sigma0**2 / float(np.mean(own**2)))
    first, second = pairs.T
    points_mm, stated = shots.points_in_tracker_mm, shots.covariance_mm2(inputs.options.instrument)
    variance = distance_variance_mm2(points_mm, stated, first, second)
    if fit.points is not None:
        # in the base frame: the robot's scatter is along the distance there, too
        own = fit.points.scatter.covariance_mm2(np.zeros_like(stated), model.by_joints(x))
        variance = variance + distance_variance_mm2(model.positions_mm(x), own, first, second)
        sigma0 = fit.points.found.noise.sigma0 or 1.0
    return sigma0**2 * variance
