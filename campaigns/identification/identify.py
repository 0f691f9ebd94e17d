"""Identify a robot: fit all sources of error, test what was not fitted, and decide.

1. Check that the shots can be this robot's (`evaluation/plausibility.py`).
2. Fit the identification shots, changes in time and wrong shots included (`campaigns/fit`).
3. Predict the hold-out pairs, and compare (`hold_out.py`).
4. State the uncertainty of parameters and positions, and its budget (`positions.py`).
5. Collect the findings (`findings.py`), and decide: pass, fail or not decided.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Index
from campaigns.errors import ShotsInvalid
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.plausibility import check_shots
from campaigns.evaluation.region import Region
from campaigns.evaluation.summary import limits_met
from campaigns.fit.changes import SHOT, Change, fit_with_changes
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.posterior import Posterior, Prior
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.fit.uncertainty import NullDirections, null_directions
from campaigns.identification import findings
from campaigns.identification.checking import MISFIT_LEVEL, fit_with_former, former_datum, goodness
from campaigns.identification.findings import NOTHING_UNSEEN, Finding
from campaigns.identification.hold_out import UnseenPairs, unseen_pairs
from campaigns.identification.known_lengths import KnownLengths, known_lengths
from campaigns.identification.observations import error_model, observations_of, rows_to_fit
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.paper import identify_as_paper
from campaigns.identification.positions import uncertainty_of_positions
from campaigns.identification.result import (
    Excluded,
    Frame,
    IdentificationResult,
    IdentifiedParameter,
    ModelledTable,
    ParameterCovariance,
    ResidualTable,
    Scatter,
    SessionFrame,
    StoredPosterior,
    identified_parameters,
)
from campaigns.kinematics.mechanism import Kinematics, KinematicSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots


def identify(
    nominal: Kinematics, shots: Shots, options: IdentificationOptions | None = None
) -> IdentificationResult:
    """Identify a robot from its identification shots, judged by the validation pairs.

    Raise `ShotsMissing` for too few shots, `ShotsInvalid` for shots that cannot be this robot's.
    """
    options = options or IdentificationOptions()
    lengths = known_lengths(shots, options.known_lengths, options.instrument)
    shots = shots.on_robot()
    at_nominal = nominal.forward(shots.joints, approach=shots.approach)
    _check(nominal, shots, sessions=options.sessions)
    if options.model == "paper":
        return identify_as_paper(nominal, shots, at_nominal, options)
    model = error_model(nominal, shots, options)
    rows, excluded = rows_to_fit(shots, at_nominal, options)
    fitted = shots.rows(rows)
    observations = observations_of(fitted, at_nominal.values[rows], options)
    prior = Prior()
    if lengths is not None and "scale" in model.names:  # --fix scale holds it at nominal
        prior = Prior(lengths={"scale": lengths.scale})
    try:
        posterior, changes = fit_with_changes(model, observations, prior)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ShotsInvalid(
            f"the shots lead to no robot ({error})",
            remedy="look for gross errors: order and signs of the joints, units of points and of "
            "covariances; measure all over the workspace",
        ) from error
    case = _Case(nominal, shots, at_nominal, fitted, options, posterior, changes)
    return case.result(excluded, lengths)


def _check(nominal: Kinematics, shots: Shots, *, sessions: bool) -> None:
    """Refuse shots that cannot be this robot's, each session by itself where each has a frame."""
    session = shots.session if sessions else np.zeros(len(shots))
    for number in np.unique(session).tolist():
        check_shots(nominal, shots.rows(np.flatnonzero(session == number)), "the shots")


def update(
    nominal: Kinematics,
    shots: Shots,
    former: StoredPosterior,
    options: IdentificationOptions,
    changed: Sequence[str] = (),
) -> IdentificationResult:
    """Update a former result by the shots of a check, after parts that it found `changed`.

    It passes where the shots agree with it and the workspace is known.
    """
    at_nominal = nominal.forward(shots.joints, approach=shots.approach)
    posterior = fit_with_former(nominal, shots, former, options, changed)
    datum = former_datum(former, posterior.model)
    case = _Case(nominal, shots, at_nominal, shots, options, posterior, (), datum)
    result = case.result((), None)
    chi2, dof, p = goodness(posterior, former)
    says = f"updated by {len(shots)} shots of a check (χ² {chi2:.1f} of {dof}, p = {p:.2g})"
    against = [own for own in result.findings if own.affects_verdict and own.name != NOTHING_UNSEEN]
    if p < MISFIT_LEVEL:
        says = f"{says}: the shots contradict it, measure a campaign again"
    decision: Decision = "pass" if p >= MISFIT_LEVEL and not against else "fail"
    reasons = (says, *(own.says for own in against))
    obstacles = tuple(own.name for own in against)
    return replace(result, verdict=decision, reasons=reasons, obstacles=obstacles)


@dataclass(frozen=True, slots=True, eq=False)
class _Case:
    """Fit of a robot's shots, from which its result follows."""

    nominal: Kinematics
    shots: Shots
    at_nominal: KinematicSolution
    fitted: Shots
    options: IdentificationOptions
    posterior: Posterior
    changes: tuple[Change, ...]
    datum: NullDirections | None = None
    """Directions that stay at nominal; None: those that these shots do not determine."""

    def result(
        self, excluded: tuple[Excluded, ...], lengths: KnownLengths | None
    ) -> IdentificationResult:
        """Return the result with its findings and verdict."""
        posterior, options = self.posterior, self.options
        identified = posterior.model.kinematics(posterior.x)
        null = self.datum or null_directions(posterior)
        near = self.at_nominal.values.copy()
        near[~self.at_nominal.is_solved] = near[self.at_nominal.is_solved][0]
        solution = identified.forward(self.shots.joints, near, approach=self.shots.approach)
        unseen = unseen_pairs(posterior, self.shots, self.at_nominal, solution, options)
        ratio = 1.0 if unseen.test is None else unseen.test.applied_ratio
        positions = None
        if options.workspace is not None:
            positions = uncertainty_of_positions(posterior, identified, options.workspace, ratio)
        region = None if positions is None else positions.region
        residuals = self._residuals()
        findings = (
            *self._findings(null, unseen, region),
            *([] if lengths is None else lengths.findings),
        )
        decision, reasons, obstacles = _verdict(findings, residuals, unseen.errors, region)
        frames = tuple(map(Frame.of, posterior.at.frames))
        return IdentificationResult(
            model="full",
            converged=posterior.has_converged,
            iterations=posterior.rounds,
            parameters=self._parameters(null),
            undetermined=null.names,
            scatter=self._scatter(),
            sizes={group: float(size) for group, size in posterior.components.sizes.items()},
            tracker=self._tracker(),
            residuals_mm=residuals.summary(),
            unseen_mm=None if unseen.errors is None else unseen.errors.summary(),
            fitted=residuals,
            unseen=unseen.errors,
            modelled=self._modelled(solution, unseen.rows),
            excluded=(*excluded, *self._wrong_shots(), *unseen.lost),
            covariance=self._covariance(null, ratio),
            position_std_mm=None if positions is None else positions.std,
            budget=positions.shares if positions else (),
            region=region,
            hold_out=unseen.test,
            findings=findings,
            frame=frames[0],
            sessions=self._sessions(frames) if options.sessions else (),
            reference_degC=options.reference_degC if posterior.model.with_growth else None,
            posterior=self._stored(null),
            verdict=decision,
            reasons=reasons,
            obstacles=obstacles,
        )

    def _parameters(self, null: NullDirections) -> dict[str, IdentifiedParameter]:
        model, old = self.posterior.model, self.nominal.parameters
        variances = np.diag(null.transform_covariance(self.posterior.model_covariance)).tolist()
        deviations = (null.transform(self.posterior.x) * model.file_tolerance).tolist()
        fitted = {}
        for place, name in enumerate(model.parameters):
            std = max(variances[place], 0.0) ** 0.5 * float(model.file_tolerance[place])
            value = old.get(name, 0.0) + deviations[place]
            fitted[name] = (value, std if variances[place] > 1e-12 else None)
        return identified_parameters(self.nominal, fitted)

    def _covariance(self, null: NullDirections, ratio: float) -> ParameterCovariance:
        model, table = self.posterior.model, self.nominal.mechanism.parameters
        places = [n for n, name in enumerate(model.names) if name in table.of_robot]
        names = tuple(model.names[place] for place in places)
        tolerance = model.file_tolerance[places]
        matrix = null.transform_covariance(self.posterior.model_covariance)[np.ix_(places, places)]
        matrix = matrix * np.outer(tolerance, tolerance)
        return ParameterCovariance(names, tuple(map(tuple, matrix.tolist())), ratio)

    def _tracker(self) -> dict[str, tuple[float, float]]:
        """Return value and 1 σ of each of the tracker's errors, in the unit it is shown in."""
        model, posterior = self.posterior.model, self.posterior
        values, std = (model.file_tolerance * own for own in (posterior.x, posterior.std))
        rows = zip(model.names, values.tolist(), std.tolist(), strict=True)
        return {name: (value, s) for name, value, s in rows if name in TRACKER_SOURCES}

    def _stored(self, null: NullDirections) -> StoredPosterior:
        posterior = self.posterior
        return StoredPosterior(
            posterior.model.names,
            tuple(posterior.model.tolerance.tolist()),
            tuple(posterior.x.tolist()),
            tuple(map(tuple, posterior.model_covariance.tolist())),
            {group: float(own) for group, own in posterior.components.sizes.items()},
            {part: float(own) for part, own in posterior.components.factors.items()},
            tuple(map(tuple, null.vectors.T.tolist())),
        )

    def _scatter(self) -> Scatter:
        factors, axis = self.posterior.components.factors, self.nominal.mechanism.joints[0]
        point, joint = self.posterior.scatter
        joint = axis.to_file(joint)
        of_instrument: dict[str, float] = {
            p: factors[p] ** 0.5 for p in ("along", "across") if p in factors
        }
        shown = f"{60.0 * joint:.2g}′" if axis.is_revolute else f"{joint:.2g} mm"
        says = (
            f"robot repeatability: {point:.3g} mm per axis, {shown} per joint (1 σ), included in σ"
        )
        if of_instrument:
            values = ", ".join(f"{value:.2g} × {part}" for part, value in of_instrument.items())
            says = (
                f"the file states no σ of points: noise estimated, {values} the beam of the data "
                f"sheet's; robot repeatability {point:.3g} mm per axis, {shown} per joint (1 σ)"
            )
        return Scatter(point, joint, of_instrument, says)

    def _residuals(self) -> ResidualTable:
        """Return the errors of the fitted shots: nominal in its own best frames, and identified."""
        kept, posterior = self.posterior.kept, self.posterior
        positions = posterior.observations.near[kept, :3]
        points, frame = self.fitted.points_in_tracker_mm[kept], posterior.observations.frame[kept]
        before = np.empty_like(points)
        for number in np.unique(frame).tolist():
            rows = frame == number
            fitted = fit_transform(positions[rows], points[rows])
            before[rows] = fitted.apply(positions[rows]) - points[rows]
        numbers = np.array(self.fitted.numbers)[kept].tolist()
        after = posterior.at.residual[kept]
        return ResidualTable.from_arrays("shots", numbers, before, after)

    def _modelled(self, solution: KinematicSolution, pairs: Index) -> ModelledTable:
        counted = np.array(self.fitted.numbers)[self.posterior.kept]
        fitted = self.shots.rows_of(ShotSet.IDENTIFICATION)
        fitted = fitted[
            np.isin(np.array(self.shots.numbers)[fitted], counted) & solution.is_solved[fitted]
        ]
        rows = np.union1d(fitted, pairs.ravel())
        before, after = self.at_nominal.values[rows], solution.values[rows]
        return ModelledTable.of(self.shots.rows(rows), before, after)

    def _wrong_shots(self) -> Iterator[Excluded]:
        """Yield the shots without weight: far off nominal, or contradicting all others."""
        named = {change.since: change.size for change in self.changes if change.part == SHOT}
        for row in np.flatnonzero(~self.posterior.kept).tolist():
            size = named.get(row, float(np.linalg.norm(self.posterior.at.residual[row])))
            number, pair = self.fitted.numbers[row], self.fitted.pairs[row]
            reason = f"{size:.3f} mm off where all others put it"
            yield Excluded(reason, shot=number, pair=pair, size_mm=size)

    def _sessions(self, frames: tuple[Frame, ...]) -> tuple[SessionFrame, ...]:
        session_of, numbers = self.shots.session, np.array(self.shots.numbers)
        fitted = dict(zip(np.unique(self.fitted.session).tolist(), frames, strict=True))
        return tuple(
            SessionFrame(tuple(numbers[session_of == session].tolist()), fitted.get(session))
            for session in np.unique(session_of).tolist()
        )

    def _findings(
        self, null: NullDirections, unseen: UnseenPairs, region: Region | None
    ) -> Iterator[Finding]:
        posterior, options = self.posterior, self.options
        revolute = self.nominal.mechanism.joints[0].is_revolute
        if not posterior.has_converged:
            says = "the fit did not settle: look for gross errors, or measure at more poses"
            yield Finding(findings.NOT_ARRIVED, says, "fail")
        accepted = findings.ACCEPTABLE if options.accept_large_change else ()
        for finding in findings.tolerance_findings(posterior, null):
            yield finding.accept(accepted)
        yield from findings.scatter_findings(posterior)
        yield from findings.change_findings(self.changes, self.fitted.numbers, revolute=revolute)
        if unseen.test is not None and unseen.errors is not None:
            met = limits_met(unseen.errors.summary().after, options.limits_mm)
            yield from findings.hold_out_findings(unseen.test, limits_met=met)
        if unseen.lost:
            says = f"hold-out {unseen.lost[0].what}: {unseen.lost[0].reason}"
            yield Finding(findings.NOT_TAKEN, says, "fail")
        if unseen.got_worse and unseen.errors is not None:
            errors = unseen.errors.summary()
            worse = f"rms {errors.before.rms:.4f} → {errors.after.rms:.4f} mm"
            yield Finding(findings.WORSE, f"hold-out pairs got worse: {worse}", "fail")
        if unseen.errors is None:
            says = (
                "no validation pairs: nothing shows that the result holds elsewhere; `identify "
                "--hold-out 20%` keeps some of the shots for it"
            )
            yield Finding(findings.NOTHING_UNSEEN, says, "not decided")
        if options.workspace is not None:
            yield from findings.region_findings(region)


def _verdict(
    findings: tuple[Finding, ...],
    residuals: ResidualTable,
    unseen: ResidualTable | None,
    region: Region | None,
) -> tuple[Decision, tuple[str, ...], tuple[str, ...]]:
    """Decide whether the result may be used; return reasons, and the findings against a pass."""
    against = [own for own in findings if own.affects_verdict]
    failed = [own for own in against if own.decision == "fail"]
    if against or unseen is None:
        shown = failed or against
        decision: Decision = "fail" if failed else "not decided"
        return decision, tuple(own.says for own in shown), tuple(own.name for own in shown)
    errors, left = unseen.summary(), residuals.summary()
    gain = f"hold-out pairs: {errors.says}"
    if errors.after.rms > errors.before.rms:
        gain += " (no change shown)"
    fitted = f"fitted shots: rms {left.before.rms:.3f} → {left.after.rms:.4f} mm"
    return "pass", (gain, fitted, *((region.says,) if region else ())), ()
