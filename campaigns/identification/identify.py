"""Identification: a robot's kinematics from measured shots, with its uncertainty and a verdict."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsInvalid
from campaigns.estimation.estimate import Estimate
from campaigns.estimation.estimators import Outliers
from campaigns.estimation.information import Uncertainty, WorkspaceSample, coverage_factor
from campaigns.estimation.observability import unobservable_combinations
from campaigns.evaluation.doubts import (
    Doubt,
    change_doubt,
    hold_out_doubt,
    lack_doubt,
    limits_met,
    noise_doubts,
    parameter_doubts,
)
from campaigns.evaluation.identification import (
    Combination,
    IdentificationEvidence,
    identification_verdict,
    noise_in_words,
    scatter_in_words,
)
from campaigns.evaluation.plausibility import FoundChanges, check_shots
from campaigns.identification.change import change_of, lack_of_fit_of
from campaigns.identification.fit import Fit, PointFit, fit_shots, plain_fit
from campaigns.identification.hold_out import UnseenPairs, unseen_pairs
from campaigns.identification.observations import Observations
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.identification.result import (
    Excluded,
    Frame,
    IdentificationResult,
    IdentifiedParameter,
    LossUsed,
    NoiseTest,
    PositionStd,
    ResidualTable,
    RobotScatter,
    SessionFrame,
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
    _check(
        nominal, shots.of_set(ShotSet.IDENTIFICATION, ShotSet.VALIDATION), sessions=options.sessions
    )
    at_nominal = nominal.forward(shots.joints)
    try:
        fit = fit_shots(nominal, shots, selection, options, at_nominal)
    except NoSolution as error:
        raise ShotsInvalid(
            "the shots lead to no robot that could be assembled",
            remedy="look for gross errors: order and signs of the joints, units of points and of "
            "covariances",
        ) from error
    held_out = unseen_pairs(nominal, shots, selection.free, fit, options, at_nominal)
    return _Identified(nominal, shots, selection, options, fit, held_out).result()


def _check(nominal: Kinematics, shots: Shots, *, sessions: bool) -> None:
    """Refusal of shots that cannot be this robot's, those of each session for themselves."""
    own = shots.session if sessions else np.zeros(len(shots))
    for each in np.unique(own).tolist():
        check_shots(nominal, shots.rows(np.flatnonzero(own == each)), "the shots")


@dataclass(frozen=True, eq=False)
class _Identified:
    """Findings of the fitted and the unseen shots together."""

    nominal: Kinematics
    shots: Shots
    selection: ParameterSelection
    options: IdentificationOptions
    fit: Fit
    held_out: UnseenPairs

    @property
    def fitted(self) -> Observations:
        return self.fit.observations

    @property
    def found(self) -> Estimate:
        return self.fit.found

    def result(self) -> IdentificationResult:
        found, options, fit = self.found, self.options, self.found.fit
        frames = tuple(map(Frame.of, self.fitted.tracker_from_base(found.x)))
        unseen = self.held_out.errors
        verdict, reasons = identification_verdict(self._evidence())
        scatter, noise = self._robot_scatter(), self.fit.stated_noise
        says = noise_in_words(
            noise,
            options.estimator,
            options.loss,
            by_scatter=self.fit.points is None,
            robot="" if scatter is None else scatter.says,
        )
        return IdentificationResult(
            estimator=options.estimator,
            loss=LossUsed(options.loss, options.loss_scale),
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
            chi2=NoiseTest.of(noise, says),
            covariance=self.covariance,
            coverage_factor_95=self._coverage_factor(),
            position_std_mm=self._position_std(),
            robot_scatter=scatter,
            hold_out=self.held_out.tested,
            doubts=self.doubts,
            frame=frames[0] if frames else None,
            sessions=self._sessions(frames),
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
    def uncertainty(self) -> Uncertainty | None:
        """Of all that was looked for; None where nothing tells it."""
        return self.fit.uncertainty(self.free, self.held_out.tested)

    @cached_property
    def covariance(self) -> Uncertainty:
        """Of the parameters that take part in nothing held."""
        known = np.flatnonzero(self.found.identifiable).tolist()
        names = tuple(self.free[place] for place in known)
        return Uncertainty() if self.uncertainty is None else self.uncertainty.only(names)

    def _evidence(self) -> IdentificationEvidence:
        unseen = self.held_out.errors
        return IdentificationEvidence(
            space=self.nominal.mechanism.parameters,
            kind=self.fitted.kind,
            fit=self.found.fit,
            unobservable=self.unobservable,
            outliers=self._outliers_share(),
            residuals=self.errors.summary(),
            std=self.covariance.std(),
            contradicted=tuple(self._contradicted()),
            doubts=self.doubts,
            unseen=None if unseen is None else unseen.summary(),
            lost=tuple(f"unseen {each.what}: {each.reason}" for each in self.held_out.lost),
        )

    def _outliers_share(self) -> float:
        """Share in what was to be fitted: of pairs that of their shots."""
        found = self.fit.left_out.found if self.fit.left_out else self.found
        return len(found.outliers) / len(found.kept)

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

    def _sessions(self, frames: tuple[Frame, ...]) -> tuple[SessionFrame, ...]:
        """Shots of each session by its own frame; empty where all are of one."""
        if not self.options.sessions:
            return ()
        own, numbers = self.shots.session, np.array(self.shots.numbers)
        fitted = np.unique(own[np.isin(numbers, self.fitted.numbers)]).tolist()
        known = dict(zip(fitted, frames, strict=True)) if frames else {}
        return tuple(
            SessionFrame(tuple(numbers[own == each].tolist()), known.get(each))
            for each in np.unique(own).tolist()
        )

    def _excluded(self) -> tuple[Excluded, ...]:
        held_out = self.held_out
        outliers = tuple(_named_outliers(self.fitted, self.found))
        if self.fit.left_out is not None:
            pairs = dict(zip(self.shots.numbers, self.shots.pairs, strict=True))
            named = _named_outliers(self.fit.left_out.observations, self.fit.left_out.found)
            outliers += tuple(
                replace(each, pair=pairs[each.shot]) for each in named if each.shot is not None
            )
        return self.fitted.excluded + outliers + held_out.unusable + held_out.lost

    @cached_property
    def doubts(self) -> tuple[Doubt, ...]:
        """All that speak against the result, by name."""
        return tuple(self._doubts())

    def _doubts(self) -> Iterator[Doubt]:
        options, space = self.options, self.nominal.mechanism.parameters
        parameters = self._parameters()
        changes = FoundChanges(
            {name: parameters[name].delta for name in self.free},
            self.covariance.names,
            self.covariance.array,
        )
        yield from parameter_doubts(
            self.nominal.parameters, changes, options.tolerance, options.accepted
        )
        yield from noise_doubts(self.fit.stated_noise)
        tested, unseen = self.held_out.tested, self.held_out.errors
        met = unseen is not None and limits_met(unseen.summary().after, options.limits_mm)
        judged = self._judged()
        if judged is not None:
            beside = {*space.free_by_default, *self.selection.free}
            parts = tuple(name for name in space.free_in_full if name not in beside)
            lack = lack_of_fit_of(judged, parts)
            change = change_of(judged, space, lack, parts)
            if change is not None:
                yield change_doubt(*change, space)
            if lack is not None:
                yield lack_doubt(lack, limits_met=met)
        if tested is not None and not tested.believable:
            yield hold_out_doubt(tested.ratio, tested.p, tested.pairs, limits_met=met)

    def _judged(self) -> PointFit | None:
        """Coordinates that the shots are judged by, also where they take no part in the fit."""
        if self.fit.points is not None or self.options.outliers is Outliers.KEEP:
            return self.fit.points
        return plain_fit(self.nominal, self.shots, self.selection, self.options)

    def _robot_scatter(self) -> RobotScatter | None:
        found, axis = self.fit.scatter, self.nominal.mechanism.joints[0]
        if not found.any:
            return None
        says = scatter_in_words(found, axis.unit, axis.from_file(1.0))
        return RobotScatter(
            found.point_mm,
            found.point_mm_std,
            axis.to_file(found.joint),
            axis.to_file(found.joint_std),
            says,
        )

    def _parameters(self) -> dict[str, IdentifiedParameter]:
        """All of files, extensions that are not 0, and whatever else was free."""
        std, free = self.covariance.std(), self.free
        known = self.nominal.parameters
        old = known | dict.fromkeys((name for name in free if name not in known), 0.0)
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
        return _position_std(self.uncertainty, identified, self.found, self.options.workspace)

    def _coverage_factor(self) -> float | None:
        """Student's where the residuals tell their own variance, else normal."""
        return None if self.found.covariance is None else coverage_factor(self.fit.variance_dof)

    def _by_priors_alone(self) -> tuple[Combination, ...]:
        """Combinations that the shots cannot tell and the priors do."""
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
    known: Uncertainty | None, identified: Kinematics, found: Estimate, poses: Array | None
) -> PositionStd | None:
    """Over poses (N, t), after a best fit of the frame to all of them; None when not known.

    A combination that is held at nominal must change the frame and nothing else. Nor is it known of
    a robot that can take none of the poses.
    """
    if known is None or poses is None:
        return None
    taken = poses[identified.inverse(poses).found]
    if not len(taken):
        return None
    try:
        sample = WorkspaceSample.of(identified, known.names, taken)
    except NoSolution:
        return None
    jacobian = sample.jacobian / identified.mechanism.parameters.units(known.names)
    for lost in found.seen.null_directions / found.seen.scale:
        if np.abs(jacobian @ lost).max() > NO_EFFECT * (np.abs(jacobian) @ np.abs(lost)).max():
            return None
    std = known.of_positions(sample)
    return PositionStd(float(std.mean()), float(std.max()))
