"""Fit of measured shots: outliers, the robot's own scatter, and the estimate that follows.

Whatever estimator is asked for, all coordinates of the same shots, with a free frame, say which of
them are wrong and how much the robot scatters: three times as many numbers as distances, and the
frame is no concern of theirs.
"""

from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsMissing
from campaigns.estimation.estimate import Estimate, OutlierPolicy, Start, estimate
from campaigns.estimation.estimators import Estimator, LossShape, Outliers, Weights
from campaigns.estimation.information import (
    ChiSquareTest,
    HoldOut,
    Uncertainty,
    chi_square_test,
    variance_dof,
)
from campaigns.estimation.variance_components import (
    NONE,
    LinearizedShots,
    VarianceComponents,
    estimate_components,
)
from campaigns.identification.observations import (
    Observations,
    distance_observations,
    point_observations,
)
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics, KinematicSolution, NoSolution
from campaigns.shots.shots import Shots

SCATTER_ROUNDS = 5
SCATTER_SETTLED = 0.02
"""Relative change of a component below which another round would tell nothing new."""


@dataclass(frozen=True, slots=True, eq=False)
class PointFit:
    """Fit of all coordinates, with the robot's scatter in the covariances."""

    observations: Observations
    found: Estimate
    scatter: VarianceComponents

    @property
    def stated_noise(self) -> ChiSquareTest:
        """Test of what the tracker alone states, whatever the robot adds."""
        found = self.found
        if not self.scatter.any:
            return found.noise
        misfit_mm = self.observations.misfits_mm(found.x)[found.kept]
        stated = self.observations.stated_mm2[found.kept]
        explained = np.linalg.solve(stated, misfit_mm[:, :, None])[:, :, 0]
        chi2 = float(np.sum(misfit_mm * explained))
        return chi_square_test(chi2, found.noise.dof, found.noise.sigma0)

    def linearized(self) -> LinearizedShots:
        """All shots about the estimate, those left out too."""
        return linearized(self.observations, self.found.x)

    def covariance_mm2(self) -> Array:
        """Covariances of the points, the robot's scatter included, (N, 3, 3)."""
        return covariance_of(self.observations, self.found.x, self.scatter)


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
    def stated_noise(self) -> ChiSquareTest:
        """Test of what the tracker states by what was fitted."""
        return self.found.noise if self.asked is None else self.asked.stated_noise

    @property
    def variance_dof(self) -> int | None:
        """Degrees of freedom by which the variance is known; None: it counts as known."""
        return variance_dof(self.found.noise, known_variance=self.points is not None)

    def uncertainty(
        self, free: tuple[str, ...], hold_out: HoldOut | None = None
    ) -> Uncertainty | None:
        """Uncertainty of the parameters that were looked for; None where nothing tells it."""
        found, count = self.found, len(free)
        if found.covariance is None or found.noise.sigma0 is None:
            return None
        return Uncertainty.of(
            free,
            self.observations.model.mechanism.parameters.units(free),
            found.covariance[:count, :count],
            sigma0=found.noise.sigma0,
            dof=self.variance_dof,
            hold_out_ratio=1.0 if hold_out is None else hold_out.applied_ratio,
        )

    @property
    def scatter(self) -> VarianceComponents:
        """The robot's own that the estimate takes in."""
        weighed_by = self.asked or self.points
        return NONE if weighed_by is None else weighed_by.scatter


def fit_shots(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions,
    at_nominal: KinematicSolution | None = None,
) -> Fit:
    """Fit of the identification shots; `at_nominal`: the nominal robot's poses at all of them.

    Raises `ShotsMissing` for too few of them, `ShotsInvalid` for a covariance that is none, and
    `NoSolution` where no robot explains them.
    """
    at_nominal = at_nominal or nominal.forward(shots.joints)
    asked = (nominal, shots, selection, options, at_nominal)
    if options.estimator is Estimator.POINTS:
        points = fit_points(*asked)
        plain = points if _is_plain(options) else plain_fit(*asked)
        return Fit(points.observations, points.found, plain, asked=points)
    if options.weights is Weights.EQUAL:
        return _fit_distances_alone(*asked)
    return _fit_distances(*asked)


def fit_points(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions,
    at_nominal: KinematicSolution | None = None,
) -> PointFit:
    """Fit of coordinates, the robot's scatter and outliers in turn until neither changes."""
    fitted = stated = point_observations(nominal, shots, selection, options, at_nominal=at_nominal)
    policy, count = _policy(options), len(selection.free)
    found = estimate(fitted.problem, count, policy, known_variance=True)
    scatter = NONE
    if options.loss is not LossShape.LINEAR:
        return PointFit(fitted, found, scatter)
    for _ in range(SCATTER_ROUNDS):
        kept = found.kept
        anew = estimate_components(linearized(fitted, found.x).rows(kept))
        if _settled(scatter, anew):
            break
        scatter = anew
        fitted = replace_covariance(stated, covariance_of(stated, found.x, scatter))
        found = estimate(fitted.problem, count, policy, known_variance=True, start=Start.of(found))
        if np.array_equal(found.kept, kept) and not scatter.any:
            break
    return PointFit(fitted, found, scatter)


def plain_fit(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions,
    at_nominal: KinematicSolution | None = None,
) -> PointFit | None:
    """Plain fit of the coordinates by the shots alone, to judge them by; None for too few."""
    plain = replace(options, loss=LossShape.LINEAR, outliers=Outliers.EXCLUDE)
    alone = replace(selection, priors=())
    try:
        return fit_points(nominal, shots, alone, plain, at_nominal)
    except (ShotsMissing, NoSolution):
        return None


def linearized(fitted: Observations, x: Array) -> LinearizedShots:
    """All shots about the unknowns x, in the tracker's axes."""
    points, count = fitted.points, len(fitted.numbers)
    whitened = points.jacobian(x).reshape(count, 3, -1)
    return LinearizedShots(
        fitted.misfits_mm(x),
        np.linalg.inv(points.whitening) @ whitened,
        fitted.stated_mm2,
        points.rotations(x) @ points.model.by_joints(points.parameters(x)),
    )


def covariance_of(fitted: Observations, x: Array, scatter: VarianceComponents) -> Array:
    """Covariances (N, 3, 3) of points, in the tracker's axes."""
    if not scatter.any:
        return fitted.stated_mm2
    points = fitted.points
    by_joints = points.rotations(x) @ points.model.by_joints(points.parameters(x))
    return scatter.covariance_mm2(fitted.stated_mm2, by_joints)


def replace_covariance(fitted: Observations, covariance_mm2: Array) -> Observations:
    """The same observations, whitened with other covariances."""
    return replace(fitted, residuals=fitted.points.with_covariance(covariance_mm2))


def _fit_distances(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions,
    at_nominal: KinematicSolution,
) -> Fit:
    """Distances weighed by what the coordinates of the same shots say of them."""
    points = plain_fit(nominal, shots, selection, options, at_nominal)
    if points is None:
        return _fit_distances_alone(nominal, shots, selection, options, at_nominal)
    sigma0 = points.found.noise.sigma0 or 1.0
    covariance = {
        number: sigma0**2 * each
        for number, each in zip(points.observations.numbers, points.covariance_mm2(), strict=True)
    }
    left_out = points if options.outliers is Outliers.EXCLUDE else None
    wrong = np.array(points.observations.numbers)[~points.found.kept].tolist() if left_out else ()
    fitted = distance_observations(
        nominal,
        shots,
        selection,
        options,
        at_nominal=at_nominal,
        covariance_mm2=covariance,
        left_out=frozenset(wrong),
    )
    policy, count = OutlierPolicy(options.robust_loss, exclude=False), len(selection.free)
    start = Start.of(points.found, count)  # the same robot within σ: a step or two are left
    found = estimate(fitted.problem, count, policy, known_variance=True, start=start)
    return Fit(fitted, found, points, left_out=left_out)


def _fit_distances_alone(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions,
    at_nominal: KinematicSolution,
) -> Fit:
    fitted = distance_observations(nominal, shots, selection, options, at_nominal=at_nominal)
    count = len(selection.free)
    found = estimate(fitted.problem, count, _policy(options), known_variance=False)
    return Fit(fitted, found, None)


def _is_plain(options: IdentificationOptions) -> bool:
    return options.loss is LossShape.LINEAR and options.outliers is Outliers.EXCLUDE


def _policy(options: IdentificationOptions) -> OutlierPolicy:
    return OutlierPolicy(options.robust_loss, exclude=options.outliers is Outliers.EXCLUDE)


def _settled(old: VarianceComponents, new: VarianceComponents) -> bool:
    pairs = ((old.point_mm, new.point_mm), (old.joint, new.joint))
    return all(abs(a - b) <= SCATTER_SETTLED * max(a, b) for a, b in pairs)
