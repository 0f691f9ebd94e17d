"""Identifies a robot's geometry from measured shots, and says honestly what came of it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsInvalid
from campaigns.estimation.estimate import Estimate, OutlierPolicy, estimate
from campaigns.estimation.estimators import Estimator, Outliers
from campaigns.estimation.information import marginalise_frame, point_jacobian, position_std_mm
from campaigns.estimation.observability import unobservable_combinations
from campaigns.estimation.point_sets import distances_mm
from campaigns.evaluation.identification_verdict import (
    VerdictEvidence,
    identification_verdict,
    noise_in_words,
    outlier_reason,
)
from campaigns.identification.observations import (
    Observations,
    observations,
    position_model,
    usable_pairs,
    without_assembly,
)
from campaigns.identification.result import (
    Combination,
    Covariance,
    Errors,
    Excluded,
    IdentificationRequest,
    IdentificationResult,
    OutlierResidual,
    Parameter,
    PositionStd,
)
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import FILE_UNIT, Geometry, indices
from campaigns.mechanisms.par4 import NoSolution, inverse
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

WORTHLESS_MM, WORTHLESS_DEG = 5.0, 3.0
"""A σ of which the nominal value is a better guess than the identified one."""
NO_EFFECT = 1e-6
"""What a lost combination may leave of its parameters' single effects to be a change of frame."""


@dataclass(frozen=True, slots=True)
class _Holdout:
    """The pairs that were never fitted: their errors, and what of them could not be used."""

    errors: Errors | None
    unusable: tuple[Excluded, ...]
    lost: tuple[Excluded, ...]
    """By the identified robot."""


def identify(
    nominal: Geometry, data: Shots, request: IdentificationRequest
) -> IdentificationResult:
    """Parameters from the identification shots, judged by the validation pairs.

    Raises `ShotsMissing` for too few shots, and `ShotsInvalid` for a covariance that is none and
    for shots that no robot explains.
    """
    fitted, free = observations(nominal, data, request), request.knowledge.free
    treatment = OutlierPolicy(request.loss, exclude=request.outliers is Outliers.EXCLUDE)
    trusted = request.estimator is Estimator.POINTS
    try:
        found = estimate(fitted.problem, len(free), treatment, trusted=trusted)
    except NoSolution as error:
        raise ShotsInvalid(
            "the shots lead to no robot that could be assembled",
            remedy="look for gross errors: order and signs of the joints, units of points and of "
            "covariances",
        ) from error
    told = _Evidence(request, fitted, found, _holdout(nominal, data, free, found.x[: len(free)]))
    verdict, reasons = identification_verdict(told.judged())
    covariance = _covariance(found, free)
    return IdentificationResult(
        request,
        found.fit.converged,
        found.fit.message,
        found.fit.evaluations,
        found.seen.rank,
        found.seen.condition,
        found.noise,
        noise_in_words(found.noise, request),
        _parameters(nominal, free, found.x, covariance),
        covariance,
        told.position_std(),
        fitted.tracker_from_base(found.x),
        told.errors,
        told.unseen.errors,
        told.excluded(),
        told.unobservable,
        _by_priors_alone(found, free, told.unobservable),
        verdict,
        reasons,
    )


@dataclass(frozen=True, eq=False)
class _Evidence:
    """What the fitted and the unseen shots tell together."""

    request: IdentificationRequest
    fitted: Observations
    found: Estimate
    unseen: _Holdout

    def judged(self) -> VerdictEvidence:
        unseen = self.unseen.errors
        return VerdictEvidence(
            self.fitted.kind,
            self.found.fit,
            self.unobservable,
            len(self.found.outliers) / len(self.found.kept),
            self.errors.summary(),
            self._barely_known(),
            tuple(self._contradicted()),
            None if unseen is None else unseen.summary(),
            self.unseen.lost,
        )

    @cached_property
    def errors(self) -> Errors:
        fitted, kept = self.fitted, self.found.kept
        return Errors(fitted.nominal_misfits_mm(kept), fitted.misfits_mm(self.found.x)[kept])

    @cached_property
    def unobservable(self) -> tuple[Combination, ...]:
        return tuple(unobservable_combinations(self.found.seen, self.request.knowledge.free))

    def _contradicted(self) -> Iterator[str]:
        """Priors that the shots alone speak against."""
        free = self.request.knowledge.free
        for each in self.found.contradictions:
            name, unit = free[each.place], FILE_UNIT[indices((free[each.place],))][0]
            yield (
                f"the shots contradict the prior of {name}: they alone give "
                f"{each.value / unit:.4f} ± {each.std / unit:.4f}, "
                f"{each.sigmas:.1f} σ off: leave it out or widen it"
            )

    def _barely_known(self) -> tuple[tuple[str, float], ...]:
        """Parameters with a larger σ than robots are ever off, in file units."""
        std = _covariance(self.found, self.request.knowledge.free).std()
        return tuple((name, each) for name, each in std.items() if each > _worthless(name))

    def excluded(self) -> tuple[Excluded, ...]:
        outliers = tuple(_named_outliers(self.fitted, self.found))
        return self.fitted.excluded + outliers + self.unseen.unusable + self.unseen.lost

    def position_std(self) -> PositionStd | None:
        free = self.request.knowledge.free
        identified = self.fitted.model.geometry(self.found.x[: len(free)])
        return _position_std(identified, free, self.found, self.request.workspace)


def _named_outliers(fitted: Observations, found: Estimate) -> Iterator[Excluded]:
    """With the size of their misfits to what the others say."""
    misfits = np.linalg.norm(fitted.misfits_mm(found.x), axis=1)
    for outlier in found.outliers:
        misfit = OutlierResidual(float(misfits[outlier.block]), outlier.size, outlier.limit)
        left_out = fitted.excluded_for(outlier.block, outlier_reason(misfit))
        yield replace(left_out, misfit=misfit)


def _parameters(
    nominal: Geometry, free: tuple[str, ...], x: Array, covariance: Covariance
) -> tuple[Parameter, ...]:
    """The 29 of files, axis tilts that are not 0, and whatever else was free."""
    std = covariance.std()
    old = nominal.flat()
    old |= dict.fromkeys((name for name in free if name not in old), 0.0)
    new = old | dict(zip(free, (x[: len(free)] / FILE_UNIT[indices(free)]).tolist(), strict=True))
    return tuple(Parameter(name, old[name], new[name], std.get(name), name in free) for name in old)


def _worthless(name: str) -> float:
    return WORTHLESS_DEG if name.endswith("_deg") else WORTHLESS_MM


def _covariance(found: Estimate, free: tuple[str, ...]) -> Covariance:
    """Of the parameters that take part in nothing held, in file units."""
    if found.covariance is None:
        return Covariance((), np.empty((0, 0)))
    known = np.flatnonzero(found.fixed_by_data)
    names = tuple(free[place] for place in known.tolist())
    unit = FILE_UNIT[indices(names)]
    matrix = found.covariance[np.ix_(known, known)] / np.outer(unit, unit)
    return Covariance(names, matrix)


def _position_std(
    identified: Geometry, free: tuple[str, ...], found: Estimate, poses: Array | None
) -> PositionStd | None:
    """Over poses (N, 4), after a best fit of the frame to all of them; None when not known.

    A combination that is held at nominal must change the frame and nothing else. Nor is it known of
    a robot that can take none of the poses.
    """
    if poses is None or found.covariance is None:
        return None
    joints = inverse(identified, poses)
    if not joints.found.any():
        return None
    try:
        rows = point_jacobian(identified, free, joints.values[joints.found], poses[joints.found])
    except NoSolution:
        return None
    rows = marginalise_frame(rows)
    for lost in found.seen.null_directions / found.seen.scale:
        if np.abs(rows @ lost).max() > NO_EFFECT * (np.abs(rows) @ np.abs(lost)).max():
            return None
    std = position_std_mm(rows, found.covariance[: len(free), : len(free)])
    return PositionStd(float(std.mean()), float(std.max()))


def _by_priors_alone(
    found: Estimate, free: tuple[str, ...], unobservable: tuple[Combination, ...]
) -> tuple[Combination, ...]:
    """What the shots cannot tell and the priors do."""
    by_data = unobservable_combinations(found.data_seen, free)
    return tuple(names for names in by_data if names not in unobservable)


def _holdout(nominal: Geometry, data: Shots, free: tuple[str, ...], x: Array) -> _Holdout:
    """Errors of the pairs that were not fitted, with the nominal and the found parameters (F,)."""
    at_nominal = forward(nominal, data.joints_rad)
    usable = usable_pairs(at_nominal, data, ShotSet.VALIDATION)
    model = position_model(nominal, data, np.arange(len(data.numbers)), free)
    solution = forward(model.geometry(x), model.arm_joints_rad(x))
    whole = solution.found[usable.rows].all(axis=1)
    lost = without_assembly(data, usable.rows[~whole], solution.found, "identified")
    kept = usable.rows[whole]
    if len(kept) == 0:
        return _Holdout(None, usable.excluded, lost)
    measured_mm = data.measured_distances_mm(kept)
    poses = at_nominal.values, solution.values
    before, after = (
        (distances_mm(values[:, :3], kept[:, 0], kept[:, 1]) - measured_mm)[:, None]
        for values in poses
    )
    return _Holdout(Errors(before, after), usable.excluded, lost)
