"""Fit of measured shots: outliers, the robot's own scatter, and the estimate that follows.

Whatever estimator is asked for, all coordinates of the same shots, with a free frame, say which of
them are wrong and how much the robot scatters: three times as many numbers as distances, and the
frame is no concern of theirs.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsMissing
from campaigns.estimation import information, variance_components
from campaigns.estimation.estimate import Estimate, estimate
from campaigns.estimation.estimators import Estimator, Outliers
from campaigns.estimation.tracker_noise import TrackerUncertainty, common_shifts_mm
from campaigns.identification.observations import (
    Inputs,
    Observations,
    distance_observations,
    point_observations,
)
from campaigns.mechanisms.mechanism import NoSolution

SCATTER_ROUNDS = 5
SCATTER_SETTLED = 0.02
"""Relative change of a component below which another round would tell nothing new."""


@dataclass(frozen=True, slots=True, eq=False)
class PointFit:
    """Fit of all coordinates, with the robot's scatter in the covariances."""

    observations: Observations
    found: Estimate
    scatter: variance_components.VarianceComponents

    @property
    def stated_noise(self) -> information.ChiSquareTest:
        """Test of what the tracker alone states, whatever the robot adds."""
        found = self.found
        if not self.scatter.any:
            return found.noise
        misfit_mm = self.observations.misfits_mm(found.x)[found.kept]
        stated = self.observations.stated_mm2[found.kept]
        explained = np.linalg.solve(stated, misfit_mm[:, :, None])[:, :, 0]
        chi2 = float(np.sum(misfit_mm * explained))
        return information.chi_square_test(chi2, found.noise.dof, found.noise.sigma0)


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """Fit by the estimator asked for, and that of all coordinates beside it."""

    observations: Observations
    found: Estimate
    points: PointFit | None
    """Plain and without outliers; None where coordinates cannot be fitted, or were not asked."""
    asked: PointFit | None = None
    """That of the coordinates as it was asked for; None where distances were."""
    left_out: PointFit | None = None
    """That by which shots of pairs were left out; None where pairs were not asked for."""

    @property
    def stated_noise(self) -> information.ChiSquareTest:
        """Test of what the tracker states by what was fitted."""
        return self.found.noise if self.asked is None else self.asked.stated_noise

    @property
    def variance_dof(self) -> int | None:
        """Degrees of freedom by which the variance is known; None: it counts as known."""
        return information.variance_dof(self.found.noise, known_variance=self.points is not None)

    def uncertainty(
        self,
        free: tuple[str, ...],
        hold_out: information.HoldOut | None = None,
        instrument: TrackerUncertainty | None = None,
    ) -> information.Uncertainty | None:
        """Uncertainty of the parameters that were looked for; None where nothing tells it.

        With what all shots have in common where the `instrument` is given.
        """
        found, count = self.found, len(free)
        if found.covariance is None or found.noise.sigma0 is None:
            return None
        points = self.observations.shots.points_in_tracker_mm
        shifts = common_shifts_mm(points, instrument) if instrument else {}
        common = self._changes(found.covariance, shifts.values())
        return information.Uncertainty.of(
            free,
            self.observations.model.mechanism.parameters.units(free),
            found.covariance[:count, :count],
            sigma0=found.noise.sigma0,
            dof=self.variance_dof,
            hold_out_ratio=1.0 if hold_out is None else hold_out.applied_ratio,
            common={name: each[:count] for name, each in zip(shifts, common, strict=True)},
        )

    def _changes(self, covariance: Array, shifts_mm: Iterable[Array]) -> Iterator[Array]:
        """Changes of all unknowns, (P,), by shifts of the fitted shots (N, 3)."""
        fitted, found = self.observations, self.found
        kept = np.repeat(found.kept, fitted.problem.block)
        jacobian = fitted.residuals.jacobian(found.x) * kept[:, None]
        for each in shifts_mm:
            shift = fitted.whitened_shifts(each) * kept
            sigma0 = found.noise.sigma0 or 1.0
            yield information.common_changes(jacobian, covariance, sigma0, shift)

    @property
    def scatter(self) -> variance_components.VarianceComponents:
        """The robot's own that the estimate takes in."""
        weighed_by = self.asked or self.points
        return variance_components.NONE if weighed_by is None else weighed_by.scatter


def unknown_at(found: Estimate, place: int) -> tuple[float, float]:
    """Unknown of an estimate behind the parameters, and its σ, which is NaN if lost."""
    variance = np.nan if found.covariance is None else found.covariance[place, place]
    return float(found.x[place]), float(np.sqrt(variance))


def fit_shots(inputs: Inputs) -> Fit:
    """Fit of the identification shots.

    Raises `ShotsMissing` for too few of them, `ShotsInvalid` for a covariance that is none, and
    `NoSolution` where no robot explains them.
    """
    options = inputs.options
    if options.estimator is Estimator.POINTS:
        points = fit_points(inputs)
        plain = points if options.outliers is Outliers.EXCLUDE else plain_fit(inputs)
        return Fit(points.observations, points.found, plain, asked=points)
    beside = None if options.equal_weights else plain_fit(inputs)
    return _fit_distances(inputs, beside)


def fit_points(inputs: Inputs) -> PointFit:
    """Fit of coordinates, the robot's scatter and outliers in turn until neither changes."""
    fitted = stated = point_observations(inputs)
    options = inputs.options
    estimated = partial(
        estimate,
        parameters=len(inputs.selection.free),
        known_variance=True,
        exclude=options.outliers is Outliers.EXCLUDE,
    )
    found = estimated(fitted.problem)
    scatter = before = variance_components.NONE
    for _ in range(SCATTER_ROUNDS):
        kept = found.kept
        anew = variance_components.estimate_components(
            linearized(fitted, found.x).rows(kept), before=before
        )
        if settled(scatter, anew):
            break
        scatter = anew
        covariance_mm2 = covariance_of(stated, found.x, scatter)
        fitted = replace(stated, residuals=stated.points.with_covariance(covariance_mm2))
        found = estimated(fitted.problem, start=found)
        same = np.array_equal(found.kept, kept)
        if same and not scatter.any:
            break
        before = scatter if same else variance_components.NONE
    return PointFit(fitted, found, scatter)


def plain_fit(inputs: Inputs) -> PointFit | None:
    """Plain fit of the coordinates by the shots alone, to judge them by; None for too few."""
    plain = replace(inputs.options, outliers=Outliers.EXCLUDE)
    alone = replace(inputs.selection, priors={})
    try:
        return fit_points(replace(inputs, selection=alone, options=plain))
    except (ShotsMissing, NoSolution):
        return None


def linearized(fitted: Observations, x: Array) -> variance_components.LinearizedShots:
    """All shots about the unknowns x, in the tracker's axes."""
    points, count = fitted.points, len(fitted.numbers)
    whitened = points.jacobian(x).reshape(count, 3, -1)
    return variance_components.LinearizedShots(
        fitted.misfits_mm(x),
        np.linalg.inv(points.whitening) @ whitened,
        fitted.stated_mm2,
        points.rotations(x) @ points.model.by_joints(points.parameters(x)),
    )


def covariance_of(
    fitted: Observations, x: Array, scatter: variance_components.VarianceComponents
) -> Array:
    """Covariances (N, 3, 3) of points, in the tracker's axes."""
    if not scatter.any:
        return fitted.stated_mm2
    points = fitted.points
    by_joints = points.rotations(x) @ points.model.by_joints(points.parameters(x))
    return scatter.covariance_mm2(fitted.stated_mm2, by_joints)


def _fit_distances(inputs: Inputs, points: PointFit | None) -> Fit:
    """Distances weighed by what the coordinates of the same shots say of them, if they do."""
    count = len(inputs.selection.free)
    exclude = inputs.options.outliers is Outliers.EXCLUDE
    if points is None:
        fitted = distance_observations(inputs)
        found = estimate(fitted.problem, count, known_variance=False, exclude=exclude)
        return Fit(fitted, found, None)
    sigma0, numbers = points.found.noise.sigma0 or 1.0, points.observations.numbers
    whole = sigma0**2 * covariance_of(points.observations, points.found.x, points.scatter)
    covariance = dict(zip(numbers, whole, strict=True))
    wrong = np.array(numbers)[~points.found.kept].tolist() if exclude else ()
    fitted = distance_observations(inputs, covariance, frozenset(wrong))
    found = estimate(
        fitted.problem,
        count,
        known_variance=True,
        exclude=False,
        start=points.found,  # the same robot within σ: a step or two are left
    )
    return Fit(fitted, found, points, left_out=points if exclude else None)


def settled(
    old: variance_components.VarianceComponents, new: variance_components.VarianceComponents
) -> bool:
    """Whether another round would tell nothing new of the robot's scatter."""
    pairs = ((old.point_mm, new.point_mm), (old.joint, new.joint))
    return all(abs(a - b) <= SCATTER_SETTLED * max(a, b) for a, b in pairs)
