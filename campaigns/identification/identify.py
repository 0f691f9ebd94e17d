"""Identify a robot: fit all sources of error, test the result on unseen pairs, and decide.

1. Check that the shots can be this robot's (`evaluation/plausibility.py`): a least-squares fit
   would follow points in the wrong unit or swapped joints without complaint.
2. Fit the identification shots (`campaigns/fit`), and search for changes in time and wrong shots.
   Every source of error is an unknown whose prior is its tolerance: there is no model to select.
3. Predict the distances of the hold-out pairs, which were never fitted, and compare
   (`hold_out.py`): they also show errors for which the model has no column.
4. State the uncertainty of parameters and of positions, with its budget (`positions.py`).
5. Collect the findings (`findings.py`), and decide: pass, fail or not decided.

`update` fits the shots of a check to the former posterior instead of steps 1 and 2. The paper's
method, `--model paper`, branches off after step 1 (`paper.py`).
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
from campaigns.identification.checking import fit_with_former, former_datum, misfit_of
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
    """Identify a robot from its identification shots, and judge it by the validation pairs.

    Raise `ShotsMissing` for too few shots, `ShotsInvalid` for shots that cannot be this robot's.
    """
    options = options or IdentificationOptions()
    # Calibrated bars are measured by the tracker alone: their shots have no joints that could be
    # fitted, so they are evaluated first and then taken out.
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
    campaign = _FittedCampaign(nominal, shots, at_nominal, fitted, options, posterior, changes)
    return campaign.make_result(excluded, lengths)


def _check(nominal: Kinematics, shots: Shots, *, sessions: bool) -> None:
    """Refuse shots that cannot be this robot's, each session by itself where each has a frame."""
    # Points of two sessions do not lie in one frame, so together they would fit no robot.
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
    """Update a former result by the shots of a check that found some parts `changed`.

    The update passes if the shots agree with the former result and nothing else is against it.
    """
    # 1. Fit the new shots with the former posterior as prior; changed parts may move freely.
    # 2. Keep the former datum: a few shots determine less than a campaign, and directions that
    #    they alone leave open were determined before.
    # 3. Make a result as `identify` does. A check has no hold-out pairs by its nature, so their
    #    absence is no obstacle here; χ² of the new shots takes their place.
    at_nominal = nominal.forward(shots.joints, approach=shots.approach)
    posterior = fit_with_former(nominal, shots, former, options, changed)
    datum = former_datum(former, posterior.model)
    campaign = _FittedCampaign(nominal, shots, at_nominal, shots, options, posterior, (), datum)
    result = campaign.make_result((), None)
    misfit = misfit_of(posterior, former)
    says = f"updated by {len(shots)} shots of a check {misfit.in_words()}"
    if misfit.is_significant:
        says = f"{says}: the shots contradict it, measure a campaign again"
    against = [
        finding
        for finding in result.findings
        if finding.affects_verdict and finding.name != NOTHING_UNSEEN
    ]
    return replace(
        result,
        verdict="fail" if misfit.is_significant or against else "pass",
        reasons=(says, *(finding.says for finding in against)),
        obstacles=tuple(finding.name for finding in against),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _FittedCampaign:
    """Shots of a robot with the posterior of their fit, from which the result is made."""

    nominal: Kinematics
    shots: Shots
    at_nominal: KinematicSolution
    fitted: Shots
    options: IdentificationOptions
    posterior: Posterior
    changes: tuple[Change, ...]
    datum: NullDirections | None = None
    """Directions that stay at nominal; None: those that these shots do not determine."""

    def make_result(
        self, excluded: tuple[Excluded, ...], lengths: KnownLengths | None
    ) -> IdentificationResult:
        """Return the result with its findings and verdict."""
        posterior, options = self.posterior, self.options
        identified = posterior.model.kinematics(posterior.x)
        # The datum: no parameter is held to fix the base frame. Instead what no shot determines is
        # put back to nominal, and left out of σ, in all parameters below.
        null = self.datum or null_directions(posterior)
        # The identified robot is solved from the nominal poses. Where the nominal robot had none,
        # any real pose does as a start: NaN would not come back to a solution.
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
            *self._collect_findings(null, unseen, region),
            *([] if lengths is None else lengths.findings),
        )
        obstacles = _obstacles(findings)
        reasons = tuple(finding.says for finding in obstacles)
        if not obstacles:
            reasons = tuple(_gains(residuals, unseen.errors, region))
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
            posterior=self._posterior_to_store(null),
            verdict=_decide(obstacles),
            reasons=reasons,
            obstacles=tuple(finding.name for finding in obstacles),
        )

    def _parameters(self, null: NullDirections) -> dict[str, IdentifiedParameter]:
        # Unknowns are deviations from nominal in tolerances; file_tolerance makes them mm, deg or
        # ppm. A variance of nothing but rounding is a parameter that is undetermined by itself.
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
        values = (model.file_tolerance * posterior.x).tolist()
        std = (model.file_tolerance * posterior.std).tolist()
        rows = zip(model.names, values, std, strict=True)
        return {name: (value, sigma) for name, value, sigma in rows if name in TRACKER_SOURCES}

    def _posterior_to_store(self, null: NullDirections) -> StoredPosterior:
        # Not put into the datum: as a prior of new shots the whole posterior counts, and the
        # directions are stored beside it so that an update can apply the same datum.
        posterior = self.posterior
        return StoredPosterior(
            posterior.model.names,
            tuple(posterior.model.tolerance.tolist()),
            tuple(posterior.x.tolist()),
            tuple(map(tuple, posterior.model_covariance.tolist())),
            {group: float(size) for group, size in posterior.components.sizes.items()},
            {part: float(factor) for part, factor in posterior.components.factors.items()},
            tuple(map(tuple, null.vectors.T.tolist())),
        )

    def _scatter(self) -> Scatter:
        # Factors multiply variances: their roots multiply σ of the data sheet.
        factors, axis = self.posterior.components.factors, self.nominal.mechanism.joints[0]
        point, joint = self.posterior.scatter
        joint = axis.to_file(joint)
        of_instrument: dict[str, float] = {
            part: factors[part] ** 0.5 for part in ("along", "across") if part in factors
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
        # The frames were fitted with the identified robot. To be judged fairly the nominal robot
        # gets its own best rigid fit, one for each frame.
        kept, posterior = self.posterior.kept, self.posterior
        positions = posterior.observations.near[kept, :3]
        points, frame = self.fitted.points_in_tracker_mm[kept], posterior.observations.frame[kept]
        before = np.empty_like(points)
        for number in np.unique(frame).tolist():
            rows = frame == number
            tracker_from_base = fit_transform(positions[rows], points[rows])
            before[rows] = tracker_from_base.apply(positions[rows]) - points[rows]
        numbers = np.array(self.fitted.numbers)[kept].tolist()
        after = posterior.at.residual[kept]
        return ResidualTable.from_arrays("shots", numbers, before, after)

    def _modelled(self, solution: KinematicSolution, pairs: Index) -> ModelledTable:
        # Rows of all shots are wanted, but `kept` counts rows of the fitted ones, which stand in
        # the order of time: match the two by the shots' numbers.
        counted = np.array(self.fitted.numbers)[self.posterior.kept]
        fitted = self.shots.rows_of(ShotSet.IDENTIFICATION)
        is_counted = np.isin(np.array(self.shots.numbers)[fitted], counted)
        fitted = fitted[is_counted & solution.is_solved[fitted]]
        rows = np.union1d(fitted, pairs.ravel())
        before, after = self.at_nominal.values[rows], solution.values[rows]
        return ModelledTable.of(self.shots.rows(rows), before, after)

    def _wrong_shots(self) -> Iterator[Excluded]:
        """Yield the shots without weight: far off nominal, or contradicting all others."""
        # Shots that were left out at the start, by the nominal robot, are no changes: their size
        # is the residual by the final fit.
        sizes = {change.since: change.size for change in self.changes if change.part == SHOT}
        for row in np.flatnonzero(~self.posterior.kept).tolist():
            size = sizes.get(row, float(np.linalg.norm(self.posterior.at.residual[row])))
            number, pair = self.fitted.numbers[row], self.fitted.pairs[row]
            reason = f"{size:.3f} mm off where all others put it"
            yield Excluded(reason, shot=number, pair=pair, size_mm=size)

    def _sessions(self, frames: tuple[Frame, ...]) -> tuple[SessionFrame, ...]:
        # Frames come in the order of the fitted sessions; a session of validation pairs alone has
        # no frame.
        session_of, numbers = self.shots.session, np.array(self.shots.numbers)
        fitted = dict(zip(np.unique(self.fitted.session).tolist(), frames, strict=True))
        return tuple(
            SessionFrame(tuple(numbers[session_of == session].tolist()), fitted.get(session))
            for session in np.unique(session_of).tolist()
        )

    def _collect_findings(
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


def _obstacles(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Return the findings against a pass: the failures alone where there are any."""
    against = tuple(finding for finding in findings if finding.affects_verdict)
    failures = tuple(finding for finding in against if finding.decision == "fail")
    return failures or against


def _decide(obstacles: Sequence[Finding]) -> Decision:
    """Decide whether a result may be used: it passes if nothing is against it."""
    if any(finding.decision == "fail" for finding in obstacles):
        return "fail"
    return "not decided" if obstacles else "pass"


def _gains(
    residuals: ResidualTable, unseen: ResidualTable | None, region: Region | None
) -> Iterator[str]:
    """Yield what a passed result gained, and where it is valid; without unseen pairs nothing."""
    if unseen is None:
        return
    errors, fitted = unseen.summary(), residuals.summary()
    gain = f"hold-out pairs: {errors.says}"
    if errors.after.rms > errors.before.rms:
        gain += " (no change shown)"
    yield gain
    yield f"fitted shots: rms {fitted.before.rms:.3f} → {fitted.after.rms:.4f} mm"
    if region is not None:
        yield region.says
