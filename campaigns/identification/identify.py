"""Identification: a robot's kinematics from measured shots, with its uncertainty and a verdict."""

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
from campaigns.evaluation.identification import (
    Combination,
    IdentificationEvidence,
    identification_verdict,
    noise_in_words,
)
from campaigns.identification.observations import (
    Observations,
    observations,
    position_model,
    usable_pairs,
    without_assembly,
)
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import (
    Covariance,
    Excluded,
    Frame,
    IdentificationResult,
    IdentifiedParameter,
    LossUsed,
    NoiseTest,
    PositionStd,
    ResidualTable,
    finite,
)
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

NO_EFFECT = 1e-6
"""What a lost combination may leave of its parameters' single effects to be a change of frame."""


def identify(
    nominal: Kinematics,
    shots: Shots,
    selection: ParameterSelection,
    options: IdentificationOptions | None = None,
) -> IdentificationResult:
    """Parameters from the identification shots, judged by the validation pairs.

    Raises `ShotsMissing` for too few shots, and `ShotsInvalid` for a covariance that is none and
    for shots that no robot explains.
    """
    options = options or IdentificationOptions()
    fitted = observations(nominal, shots, selection, options)
    policy = OutlierPolicy(options.loss, exclude=options.outliers is Outliers.EXCLUDE)
    known_variance = options.estimator is Estimator.POINTS
    count = len(selection.free)
    try:
        found = estimate(fitted.problem, count, policy, known_variance=known_variance)
    except NoSolution as error:
        raise ShotsInvalid(
            "the shots lead to no robot that could be assembled",
            remedy="look for gross errors: order and signs of the joints, units of points and of "
            "covariances",
        ) from error
    held_out = _holdout(nominal, shots, selection.free, found.x[:count])
    told = _Identified(nominal, selection, options, fitted, found, held_out)
    return told.result()


@dataclass(frozen=True, slots=True)
class _Holdout:
    """Pairs that were never fitted: their errors, and what of them could not be used."""

    errors: ResidualTable | None
    unusable: tuple[Excluded, ...]
    lost: tuple[Excluded, ...]
    """By the identified robot."""


@dataclass(frozen=True, eq=False)
class _Identified:
    """What the fitted and the unseen shots tell together."""

    nominal: Kinematics
    selection: ParameterSelection
    options: IdentificationOptions
    fitted: Observations
    found: Estimate
    held_out: _Holdout

    def result(self) -> IdentificationResult:
        found, options, fit = self.found, self.options, self.found.fit
        frame = self.fitted.tracker_from_base(found.x)
        unseen = self.held_out.errors
        verdict, reasons = identification_verdict(self._evidence())
        says = noise_in_words(found.noise, options.estimator, options.loss.shape)
        return IdentificationResult(
            estimator=options.estimator,
            loss=LossUsed(options.loss.shape, options.loss.threshold),
            outliers=options.outliers,
            priors={prior.name: prior.std for prior in self.selection.priors},
            converged=fit.converged,
            message=fit.message,
            iterations=fit.evaluations,
            rank=found.seen.rank,
            condition=finite(found.seen.condition),
            dof=found.noise.dof,
            parameters=self._parameters(),
            residuals_mm=self.errors.summary(),
            unseen_mm=None if unseen is None else unseen.summary(),
            fitted=self.errors,
            unseen=unseen,
            excluded=self._excluded(),
            unobservable=self.unobservable,
            known_by_priors_alone=self._by_priors_alone(),
            chi2=NoiseTest.of(found.noise, says),
            covariance=self.covariance,
            position_std_mm=self._position_std(),
            frame=None if frame is None else Frame.of(frame),
            verdict=verdict,
            reasons=reasons,
        )

    @property
    def free(self) -> tuple[str, ...]:
        return self.selection.free

    @cached_property
    def errors(self) -> ResidualTable:
        fitted, kept = self.fitted, self.found.kept
        numbers = tuple(np.array(fitted.numbers)[kept].tolist())
        before, after = fitted.nominal_misfits_mm(kept), fitted.misfits_mm(self.found.x)[kept]
        return ResidualTable.from_arrays(fitted.kind, numbers, before, after)

    @cached_property
    def unobservable(self) -> tuple[Combination, ...]:
        return tuple(unobservable_combinations(self.found.seen, self.free))

    @cached_property
    def covariance(self) -> Covariance:
        """Of the parameters that take part in nothing held, in file units."""
        found = self.found
        if found.covariance is None:
            return Covariance((), ())
        known = np.flatnonzero(found.identifiable)
        names = tuple(self.free[place] for place in known.tolist())
        unit = self.nominal.mechanism.parameters.units(names)
        matrix = found.covariance[np.ix_(known, known)] / np.outer(unit, unit)
        return Covariance(names, tuple(map(tuple, matrix.tolist())))

    def _evidence(self) -> IdentificationEvidence:
        unseen = self.held_out.errors
        return IdentificationEvidence(
            kind=self.fitted.kind,
            fit=self.found.fit,
            unobservable=self.unobservable,
            outliers=len(self.found.outliers) / len(self.found.kept),
            residuals=self.errors.summary(),
            std=self.covariance.std(),
            contradicted=tuple(self._contradicted()),
            unseen=None if unseen is None else unseen.summary(),
            lost=tuple(f"unseen {each.what}: {each.reason}" for each in self.held_out.lost),
        )

    def _contradicted(self) -> Iterator[str]:
        """Priors that the shots alone speak against."""
        units = self.nominal.mechanism.parameters.units(self.free)
        for each in self.found.conflicts:
            name, unit = self.free[each.place], units[each.place]
            yield (
                f"the shots contradict the prior of {name}: they alone give "
                f"{each.value / unit:.4f} ± {each.std / unit:.4f}, "
                f"{each.sigmas:.1f} σ off: leave it out or widen it"
            )

    def _excluded(self) -> tuple[Excluded, ...]:
        held_out = self.held_out
        outliers = tuple(_named_outliers(self.fitted, self.found))
        return self.fitted.excluded + outliers + held_out.unusable + held_out.lost

    def _parameters(self) -> dict[str, IdentifiedParameter]:
        """All of files, extensions that are not 0, and whatever else was free."""
        std, free = self.covariance.std(), self.free
        old = self.nominal.flat()
        old |= dict.fromkeys((name for name in free if name not in old), 0.0)
        values = self.found.x[: len(free)] / self.nominal.mechanism.parameters.units(free)
        new = old | dict(zip(free, values.tolist(), strict=True))
        return {
            name: IdentifiedParameter(
                nominal=old[name], value=new[name], std=std.get(name), free=name in free
            )
            for name in old
        }

    def _position_std(self) -> PositionStd | None:
        identified = self.fitted.model.kinematics(self.found.x[: len(self.free)])
        return _position_std(identified, self.free, self.found, self.options.workspace)

    def _by_priors_alone(self) -> tuple[Combination, ...]:
        """What the shots cannot tell and the priors do."""
        by_data = unobservable_combinations(self.found.data_seen, self.free)
        return tuple(names for names in by_data if names not in self.unobservable)


def _named_outliers(fitted: Observations, found: Estimate) -> Iterator[Excluded]:
    """With the size of their misfits to what the others say."""
    misfits = np.linalg.norm(fitted.misfits_mm(found.x), axis=1)
    for outlier in found.outliers:
        size_mm = float(misfits[outlier.block])
        reason = (
            f"{size_mm:.3f} mm off what the others say: {outlier.size:.1f} σ, "
            f"limit {outlier.limit:.1f} σ"
        )
        yield replace(
            fitted.excluded_for(outlier.block, reason),
            size_mm=size_mm,
            size_sigma=outlier.size,
            limit_sigma=outlier.limit,
        )


def _position_std(
    identified: Kinematics, free: tuple[str, ...], found: Estimate, poses: Array | None
) -> PositionStd | None:
    """Over poses (N, t), after a best fit of the frame to all of them; None when not known.

    A combination that is held at nominal must change the frame and nothing else. Nor is it known of
    a robot that can take none of the poses.
    """
    if poses is None or found.covariance is None:
        return None
    joints = identified.inverse(poses)
    if not joints.found.any():
        return None
    try:
        jacobian = point_jacobian(
            identified, free, joints.values[joints.found], poses[joints.found]
        )
    except NoSolution:
        return None
    jacobian = marginalise_frame(jacobian)
    for lost in found.seen.null_directions / found.seen.scale:
        if np.abs(jacobian @ lost).max() > NO_EFFECT * (np.abs(jacobian) @ np.abs(lost)).max():
            return None
    std = position_std_mm(jacobian, found.covariance[: len(free), : len(free)])
    return PositionStd(float(std.mean()), float(std.max()))


def _holdout(nominal: Kinematics, shots: Shots, free: tuple[str, ...], x: Array) -> _Holdout:
    """Errors of the pairs that were not fitted, with the nominal and the found parameters (F,)."""
    at_nominal = nominal.forward(shots.joints)
    usable = usable_pairs(at_nominal, shots, ShotSet.VALIDATION)
    model = position_model(nominal, shots, np.arange(len(shots)), free)
    solution = model.kinematics(x).forward(model.arm_joints(x))
    whole = solution.found[usable.rows].all(axis=1)
    lost = without_assembly(shots, usable.rows[~whole], solution.found, "identified")
    kept = usable.rows[whole]
    if len(kept) == 0:
        return _Holdout(None, usable.excluded, lost)
    measured_mm = shots.measured_distances_mm(kept)
    before, after = (
        (distances_mm(values[:, :3], kept[:, 0], kept[:, 1]) - measured_mm)[:, None]
        for values in (at_nominal.values, solution.values)
    )
    pairs = tuple(shots.pairs[row] or 0 for row in kept[:, 0].tolist())
    errors = ResidualTable.from_arrays("pairs", pairs, before, after)
    return _Holdout(errors, usable.excluded, lost)
