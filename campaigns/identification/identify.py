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

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.evaluation.decision import allows_decision
from campaigns.evaluation.plausibility import check_shots
from campaigns.evaluation.region import Region
from campaigns.fit.effects import Layer, RateError, Ripple, Walk
from campaigns.fit.error_model import Observations
from campaigns.fit.events import (
    Event,
    Tell,
    add_steps,
    events_of,
    explain,
    spread_over_parts,
    steps_of,
    with_steps_of,
)
from campaigns.fit.fit import Fit, Prior, integrate_sizes, refit, settle, with_spread
from campaigns.fit.left_out import pattern_of
from campaigns.fit.periods import scan_periods, with_periods_of_robot
from campaigns.fit.rigid_transforms import SHOTS_FOR_A_FRAME, fit_transform
from campaigns.fit.uncertainty import NullDirections, frame_of_today, null_directions
from campaigns.identification import findings
from campaigns.identification.checking import fit_with_former, former_datum, misfit_of
from campaigns.identification.determined import (
    Determined,
    quantity_findings,
    require_turns,
    widened,
)
from campaigns.identification.findings import NOTHING_UNSEEN, Finding
from campaigns.identification.hold_out import UnseenPairs, unseen_pairs
from campaigns.identification.known_lengths import KnownLengths, known_lengths
from campaigns.identification.moments import in_order_of_time, stations_of
from campaigns.identification.observations import error_model, fitted_sessions, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.other_kinds import (
    NO_KINDS,
    KindTest,
    Measured,
    OtherKinds,
    change_findings_of_others,
    kind_findings,
    other_kinds,
    ratio_of,
    tested_by,
    tests_of,
)
from campaigns.identification.paper import identify_as_paper
from campaigns.identification.positions import uncertainty_of_positions
from campaigns.identification.repeats import repeating_share
from campaigns.identification.result import (
    Diagnosis,
    Excluded,
    Frame,
    IdentificationResult,
    Judgement,
    ModelledTable,
    Provenance,
    Residuals,
    ResidualTable,
    SessionFrame,
    StoredLayer,
    StoredPosterior,
    Uncertainty,
    Value,
)
from campaigns.identification.stated_values import StatedValues
from campaigns.kinematics.model import Kinematics, KinematicSolution
from campaigns.robots.schema import Tolerance
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import OF_SESSIONS, Shots

SETTLED_TOLERANCES = 0.1
"""Distance of a settled fit from where the priors alone would put it along undetermined directions,
in tolerances: σ there is a tolerance, and a fit ends within 0.1 σ of its minimum."""
PATTERN_SEED = 1
"""Seed of the permutations with which shots left out are compared: the same data, the same verdict.
"""


def identify(
    nominal: Kinematics,
    shots: Shots,
    options: IdentificationOptions | None = None,
    tell: Tell = lambda _: None,
    measured: Sequence[Measured] = (),
) -> IdentificationResult:
    """Identify a robot from its identification shots, and judge it by the validation pairs.

    `tell` receives words on the progress. `measured` are observations of other kinds beside shots.

    Raise `ShotsMissing` for too few shots, `ShotsInvalid` for shots that cannot be this robot's.
    """
    options = options or IdentificationOptions()
    require_answerable(nominal, shots, options, measured)
    # Calibrated bars are measured by the tracker alone: their shots have no joints that could be
    # fitted, so they are evaluated first and then taken out.
    lengths = known_lengths(shots, options.known_lengths, options.instrument)
    shots = shots.on_robot()
    if options.model == "paper":
        at_nominal = nominal.forward(shots.joints, approach=shots.approach)
        return identify_as_paper(nominal, shots, at_nominal, options)
    campaign = fit_campaign(nominal, shots, options, lengths, measured, tell)
    tell("stating the uncertainty")
    return campaign.make_result(lengths)


def require_answerable(
    nominal: Kinematics,
    shots: Shots,
    options: IdentificationOptions,
    measured: Sequence[Measured] = (),
) -> None:
    """Raise, before anything is fitted, what `identify` raises for these shots and options."""
    require_turns(options.quantities, nominal)
    if measured and options.model == "paper":
        raise OptionsInvalid(
            "observations of other kinds are not fitted by the paper's method",
            remedy="leave out --model paper, or the observations",
        )
    on_robot = shots.on_robot()
    _check(nominal, on_robot, options.tolerance, sessions=options.sessions)
    if options.model == "paper":
        return
    at_nominal = nominal.forward(on_robot.joints, approach=on_robot.approach)
    fitted_sessions(on_robot, at_nominal.is_solved, options)


def fit_campaign(
    nominal: Kinematics,
    shots: Shots,
    options: IdentificationOptions,
    lengths: KnownLengths | None = None,
    measured: Sequence[Measured] = (),
    tell: Tell = lambda _: None,
) -> "FittedCampaign":
    """Fit the identification shots of the robot by the model of all sources of error.

    `lengths` measured the tracker's scale, `measured` are observations of other kinds.

    Raise `ShotsMissing` for too few shots, `ShotsInvalid` for shots that lead to no robot.
    """
    at_nominal = nominal.forward(shots.joints, approach=shots.approach)
    sessions = fitted_sessions(shots, at_nominal.is_solved, options)
    if options.sessions:
        sessions = np.union1d(sessions, stations_of(measured))
    model = error_model(nominal, shots, options, len(sessions))
    observations = observations_of(
        shots, at_nominal.values, options, sessions if options.sessions else None
    )
    rows = _rows_in_time(shots, observations, ShotSet.IDENTIFICATION)
    prior = Prior()
    if lengths is not None and "scale" in model.names:  # --fix scale holds it at nominal
        prior = Prior(lengths={"scale": lengths.scale})
    # 1. Explain the identification shots: effects of all kinds, wrong shots.
    # 2. Search for changes over all shots, and fit the identification shots with them.
    kinds = NO_KINDS
    try:
        if measured:
            of_frames = sessions if options.sessions else None
            kinds = other_kinds(measured, nominal, observations.rows(rows), of_frames)
            kinds, observations = in_order_of_time(kinds, observations, shots)
            model = model.with_effects((*model.effects, *kinds.slots))
            observations = replace(observations, blocks=kinds.fitted)
        fit = with_periods_of_robot(explain(model, observations.rows(rows), prior, tell))
        fit, events = _with_changes_of_all_shots(fit, rows, shots, observations, tell)
    except (ValueError, np.linalg.LinAlgError) as error:
        raise ShotsInvalid(
            f"the shots lead to no robot ({error})",
            remedy="look for gross errors: order and signs of the joints, units of points and of "
            "covariances; measure all over the workspace",
        ) from error
    return FittedCampaign(
        nominal, shots, at_nominal, options, observations, fit, events, None, kinds, sessions
    )


# Changes are searched for over all shots in the order of time, hold-out shots too, as a diagnosis:
# a step shortly before the end has few shots of either set. Numbers are not taken from there: the
# identification shots are fitted with the changes found, so that hold-out pairs stay unseen.
def _with_changes_of_all_shots(
    fit: Fit, rows: Index, shots: Shots, observations: Observations, tell: Tell
) -> tuple[Fit, tuple[Event, ...]]:
    """Return the fit of the identification shots, and the events of all shots by their numbers.

    `rows` are those of the fit, `observations` are of all shots.
    """
    every = _rows_in_time(shots, observations, ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
    whole = fit
    if len(every) > len(rows):
        tell("fitting the hold-out shots too")
        whole = add_steps(refit(fit, observations=observations.rows(every)), tell)
        fit = with_steps_of(whole, fit)
    numbers = np.array(shots.numbers)
    of_fitted = [event.of_shots(numbers[rows].tolist()) for event in events_of(fit)]
    of_whole = [event.of_shots(numbers[every].tolist()) for event in events_of(whole)]
    fitted = {*numbers[rows].tolist()}
    events = [event for event in of_fitted if event.leaves_out]
    events += [e for e in of_whole if not (e.leaves_out and e.first in fitted)]
    moment = dict(zip(shots.numbers, observations.moment.tolist(), strict=True))
    return fit, tuple(sorted(events, key=lambda event: moment[event.first]))


def _rows_in_time(shots: Shots, observations: Observations, *sets: ShotSet) -> Index:
    """Return the rows of these sets in the order of time, of sessions that have a frame."""
    rows = shots.rows_of(*sets)
    rows = rows[observations.frame[rows] >= 0]
    return rows[np.argsort(observations.moment[rows], kind="stable")]


def _check(nominal: Kinematics, shots: Shots, tolerance: Tolerance, *, sessions: bool) -> None:
    """Refuse shots that cannot be this robot's, each session by itself where each has a frame."""
    # Points of two stations of the tracker do not lie in one frame, so together they would fit no
    # robot. If each session alone fits one, that is the cause, and no order or sign of joints.
    numbers = np.unique(shots.session).tolist()
    by_session = [shots.rows(np.flatnonzero(shots.session == number)) for number in numbers]
    if sessions:
        for rows in by_session:
            check_shots(nominal, rows, "the shots", tolerance=tolerance)
        return
    try:
        check_shots(nominal, shots, "the shots", tolerance=tolerance)
    except ShotsInvalid:
        if len(numbers) < 2:
            raise
        _check(nominal, shots, tolerance, sessions=True)
        raise ShotsInvalid(
            f"the shots of {len(numbers)} sessions follow the joints one by one, and not together: "
            "the tracker stood elsewhere",
            remedy=f"`pkmcal identify DIR {OF_SESSIONS}` gives each session a frame of its own",
            options=OF_SESSIONS,
        ) from None


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
    fit = fit_with_former(nominal, shots, former, options, changed)
    events = tuple(event.of_shots(shots.numbers) for event in events_of(fit))
    datum = former_datum(former, fit)
    campaign = FittedCampaign(
        nominal, shots, at_nominal, options, fit.observations, fit, events, datum
    )
    result = campaign.make_result(None)
    misfit = misfit_of(fit)
    says = f"updated by {len(shots)} shots of a check {misfit.in_words()}"
    findings_left = [f for f in result.judgement.findings if f.name != NOTHING_UNSEEN]
    if misfit.is_significant:
        words = f"{says}: the shots contradict it, measure a campaign again"
        findings_left.append(Finding(findings.CONTRADICTS, words, "fail"))
    judged = Judgement.of(findings_left)
    judgement = replace(
        result.judgement,
        findings=judged.findings,
        verdict=judged.verdict,
        reasons=(says, *judged.reasons),
        obstacles=judged.obstacles,
    )
    return replace(result, judgement=judgement)


@dataclass(frozen=True, eq=False)
class FittedCampaign(StatedValues):
    """Shots of a robot with their fit and events, from which the result is made."""

    shots: Shots
    at_nominal: KinematicSolution
    options: IdentificationOptions
    observations: Observations
    """Of all shots."""
    likeliest: Fit
    """Fit at the likeliest sizes of groups."""
    events: tuple[Event, ...]
    datum: NullDirections | None = None
    """Directions that priors alone determine; None: those that these shots do not determine."""
    kinds: OtherKinds = NO_KINDS
    """Observations of other kinds."""
    stations: Index | None = None
    """Number of each frame's session; None: of those of the fitted shots."""

    @cached_property
    def fit(self) -> Fit:
        """Fit averaged over the sizes of groups, with what σ has of parts that may have changed."""
        fit = integrate_sizes(self.likeliest)
        return with_spread(fit, spread_over_parts(self.likeliest)) if steps_of(fit) else fit

    def make_result(self, lengths: KnownLengths | None = None) -> IdentificationResult:
        """Return the result with its findings and verdict."""
        options, shots = self.options, self.shots
        # The datum: no parameter is held to fix the base frame. Instead what no shot determines is
        # where the priors like it best, and left out of σ, in all parameters below.
        null = self.datum or null_directions(self.likeliest)
        fit = self.fit
        today = fit.model.of_today @ fit.at.x
        stated = null.transform(today)
        identified = fit.model.kinematics(stated)
        # The identified robot is solved from the nominal poses. Where the nominal robot had none,
        # any real pose does as a start: NaN would not come back to a solution.
        near = self.at_nominal.values.copy()
        near[~self.at_nominal.is_solved] = near[self.at_nominal.is_solved][0]
        solution = identified.forward(shots.joints, near, approach=shots.approach)
        left_out = [event.first for event in self.events if event.leaves_out]
        unseen = unseen_pairs(fit, shots, self.at_nominal, solution, self.observations, left_out)
        ratio = 1.0 if unseen.test is None else unseen.test.applied_ratio
        ratio = max(ratio, ratio_of("position", self._tests))
        positions = Uncertainty()
        if options.workspace is not None:
            repeating = repeating_share(fit, shots, self.observations)
            positions = uncertainty_of_positions(
                fit, identified, options.workspace, ratio, repeating, tested=self._tested(unseen)
            )
            positions = replace(positions, determined=tuple(self._widened(positions)))
        residuals = self._residuals(fit)
        all_findings = (
            *self._collect_findings(fit, null, unseen, positions, residuals),
            *([] if lengths is None else lengths.findings),
        )
        frames = tuple(map(Frame.of, fit.at.frames))
        modelled = self._modelled(fit, solution, unseen.rows)
        effects = zip(fit.model.effects, fit.model.effect_places, strict=True)
        return IdentificationResult(
            value=Value(
                parameters=self.parameters(fit, null, stated) | self.rates(fit),
                undetermined=null.names,
                motions=null.motions,
                sizes={group: float(size) for group, size in fit.sizes.items()},
                tracker=self.tracker(fit),
                layers=tuple(
                    StoredLayer.of(effect, fit.at.x[where])
                    for effect, where in effects
                    if isinstance(effect, Layer)
                ),
                frame=frames[0],
                sessions=self._sessions(frames) if options.sessions else (),
                reference_degC=options.reference_degC if fit.model.with_growth else None,
            ),
            uncertainty=replace(
                positions,
                scatter=self.scatter(fit),
                covariance=self.covariance(fit, null, ratio),
                posterior=self._posterior_to_store(fit, null),
            ),
            judgement=Judgement.of(
                all_findings,
                _gains(residuals, unseen.errors, positions.region),
                hold_out=unseen.test,
                events=self.events,
                diagnosis=self._diagnosis(fit),
                excluded=(*_left_out(self.events, shots), *unseen.lost),
            ),
            residuals=Residuals.of(residuals, unseen.errors, modelled),
            provenance=Provenance("full", fit.has_converged, fit.rounds),
        )

    @property
    def _fitted_rows(self) -> Index:
        """Rows of the shots that were fitted, in the order of the fit."""
        row_at = {moment: row for row, moment in enumerate(self.observations.moment.tolist())}
        return np.array([row_at[m] for m in self.likeliest.observations.moment.tolist()])

    def _posterior_to_store(self, fit: Fit, null: NullDirections) -> StoredPosterior:
        # Not put into the datum: as a prior of new shots the whole posterior counts, and the
        # directions are stored beside it so that an update can apply the same datum.
        matrix, size = fit.model.of_today, fit.model.size
        covariance = matrix @ fit.covariance[:size, :size] @ matrix.T
        frame, of_frame = frame_of_today(fit)
        return StoredPosterior(
            fit.model.names,
            tuple(fit.model.tolerance.tolist()),
            tuple((matrix @ fit.at.x).tolist()),
            tuple(map(tuple, covariance.tolist())),
            {group: float(fit.sizes[group]) for group in fit.model.learned},
            {part: float(factor) for part, factor in fit.factors.items()},
            fit.model.nominal.mechanism.rates,
            tuple(map(tuple, null.vectors.T.tolist())),
            Frame.of(frame),
            tuple(map(tuple, of_frame.tolist())),
        )

    def _residuals(self, fit: Fit) -> ResidualTable:
        """Return the errors of the fitted shots: nominal in its own best frames, and identified."""
        # The frames were fitted with the identified robot. To be judged fairly the nominal robot
        # gets its own best rigid fit, one for each frame.
        kept, rows = fit.kept, self._fitted_rows
        positions = self.nominal.points(self.at_nominal.values[rows][kept])
        points, frame = fit.observations.points[kept], fit.observations.frame[kept]
        before = np.empty_like(points)
        for number in np.unique(frame).tolist():
            of_frame = frame == number
            tracker_from_base = fit_transform(positions[of_frame], points[of_frame])
            before[of_frame] = tracker_from_base.apply(positions[of_frame]) - points[of_frame]
        numbers = np.array(self.shots.numbers)[rows][kept].tolist()
        return ResidualTable.from_arrays("shots", numbers, before, fit.at.residual[kept])

    def _diagnosis(self, fit: Fit) -> Diagnosis:
        rows = self._fitted_rows
        moved = {Walk: np.zeros((len(rows), 3)), Layer: np.zeros((len(rows), 3))}
        for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
            if type(effect) in moved:
                moved[type(effect)] += fit.at.jacobian[..., where] @ fit.at.x[where]
        # without the ripples that were found: the picture shows why they were added
        others = tuple(e for e in fit.model.effects if not isinstance(e, (Ripple, RateError)))
        without = self.likeliest
        if others != fit.model.effects:
            without = settle(without, fit.model.with_robot(self.nominal, others))
        periods = scan_periods(without)
        places = np.nan_to_num(self.at_nominal.values[rows, :3])
        return Diagnosis(
            numbers=tuple(np.array(self.shots.numbers)[rows].tolist()),
            places_mm=_rounded(places, 1),
            good=tuple(np.round(fit.good, 3).tolist()),
            stand_mm=_rounded(moved[Walk], 5),
            unexplained_mm=_rounded(moved[Layer], 5),
            rates=tuple(np.round(periods.rates, 4).tolist()),
            rate_log_factors=tuple(np.round(periods.log_factors.max(axis=1), 2).tolist()),
        )

    def _modelled(self, fit: Fit, solution: KinematicSolution, pairs: Index) -> ModelledTable:
        fitted = self._fitted_rows[fit.kept]
        rows = np.union1d(fitted[solution.is_solved[fitted]], pairs.ravel())
        before, after = self.at_nominal.values[rows], solution.values[rows]
        return ModelledTable.of(self.shots.rows(rows), before, after)

    def _sessions(self, frames: tuple[Frame, ...]) -> tuple[SessionFrame, ...]:
        # Frames come in the order of the fitted sessions; a session of validation pairs alone has
        # no frame, one of observations of other kinds alone no shots.
        session_of, numbers = self.shots.session, np.array(self.shots.numbers)
        stations = self.stations
        if stations is None:
            stations = np.unique(session_of[self._fitted_rows])
        fitted = dict(zip(stations.tolist(), frames, strict=True))
        return tuple(
            SessionFrame(tuple(numbers[session_of == session].tolist()), fitted.get(session))
            for session in np.unique(session_of).tolist()
        )

    def _collect_findings(
        self,
        fit: Fit,
        null: NullDirections,
        unseen: UnseenPairs,
        positions: Uncertainty,
        residuals: ResidualTable,
    ) -> Iterator[Finding]:
        options = self.options
        off_mode = np.abs(null.transform(self.likeliest.x) - self.likeliest.x).max(initial=0.0)
        # at the minimum the gradient along undetermined directions is the prior's alone
        if not fit.has_converged or (self.datum is None and off_mode > SETTLED_TOLERANCES):
            says = "the fit did not converge: look for gross errors, or measure at more poses"
            yield Finding(findings.NOT_ARRIVED, says, "fail")
        yield from self._reproduction(fit, null)
        accepted = findings.ACCEPTABLE if options.accept_large_change else ()
        for finding in findings.tolerance_findings(fit, null):
            yield finding.accept(accepted)
        yield from findings.scatter_findings(fit)
        yield from findings.effect_findings(fit)
        numbers = np.array(self.shots.numbers)[self._judged_rows].tolist()
        joints = self.nominal.mechanism.joints
        yield from findings.change_findings(self.events, numbers, joints)
        sets = [
            np.array(self.shots.numbers)[self.shots.rows_of(purpose)].tolist()
            for purpose in (ShotSet.IDENTIFICATION, ShotSet.VALIDATION, ShotSet.CHECK)
        ]
        yield from findings.left_out_findings(self.events, sets, self._pattern())
        if unseen.test is not None and unseen.errors is not None:
            met = unseen.test.meets(options.limits_mm)
            yield from findings.hold_out_findings(unseen.test, limits_met=met)
        if unseen.lost:
            says = f"hold-out {unseen.lost[0].what}: {unseen.lost[0].reason}"
            yield Finding(findings.NOT_TAKEN, says, "fail")
        if unseen.got_worse and unseen.errors is not None:
            errors = unseen.errors.summary()
            worse = f"rms {errors.before.rms:.4f} → {errors.after.rms:.4f} mm"
            yield Finding(findings.WORSE, f"hold-out pairs got worse: {worse}", "fail")
        yield from kind_findings(fit, self._tests, self.kinds.untested)
        yield from change_findings_of_others(fit)
        if unseen.errors is None and "position" not in self._tested(unseen):
            says = (
                "no validation pairs: nothing shows that the result holds elsewhere; `identify "
                "--hold-out 20%` keeps some of the shots for it"
            )
            yield Finding(findings.NOTHING_UNSEEN, says, "not decided")
        yield from findings.position_findings(
            positions.region,
            self._obstacle_of_positions(positions, unseen, residuals),
            was_asked=options.workspace is not None,
        )
        yield from quantity_findings(
            positions.determined, options.judged_quantities, options.rotation_deg
        )

    @cached_property
    def _tests(self) -> tuple[KindTest, ...]:
        """Tests of the held-out observations of other kinds."""
        return tuple(tests_of(self.fit, self.likeliest, self.kinds.held_out))

    # Positions have the factor already.
    def _widened(self, positions: Uncertainty) -> Iterator[Determined]:
        """Yield the quantities, wider where held-out observations of other kinds contradict one."""
        for quantity in positions.determined:
            of_others = ratio_of(quantity.name, self._tests)
            yield quantity if quantity.name == "position" else widened(quantity, of_others)

    def _tested(self, unseen: UnseenPairs) -> frozenset[str]:
        """Return the quantities that hold-out pairs and held-out observations check."""
        if unseen.test is None:
            return tested_by(self.kinds.held_out, ())
        elsewhere = self.nominal.mechanism.halves
        return tested_by(self.kinds.held_out, elsewhere) | {"position", "flat", "xy"}

    # What is reported goes through the forward model once more: along directions that no shot
    # determines positions must not move, however far the datum is from the estimate.
    def _reproduction(self, fit: Fit, null: NullDirections) -> Iterator[Finding]:
        """Yield a finding if the reported parameters do not place the shots as the fit does."""
        today = fit.model.of_today @ fit.at.x
        rows = np.flatnonzero(fit.kept)
        joints, near = fit.observations.joints[rows], fit.observations.near[rows]
        reported, fitted = (
            fit.model.kinematics(x).forward(joints, near) for x in (null.transform(today), today)
        )
        both = reported.is_solved & fitted.is_solved
        if int(both.sum()) < SHOTS_FOR_A_FRAME:
            return
        placed = fit_transform(reported.values[both, :3], fitted.values[both, :3])
        apart = placed.apply(reported.values[both, :3]) - fitted.values[both, :3]
        size = float(np.sqrt((apart**2).sum(axis=1).mean()))
        limit = float(np.sqrt((fit.at.residual[fit.kept] ** 2).sum(axis=1).mean()))
        if size > 0.5 * limit:
            says = (
                f"the reported parameters place the shots {size:.2g} mm from where the fit does: "
                "look for a direction that the shots hardly determine, and measure more poses"
            )
            yield Finding(findings.NOT_REPRODUCED, says, "fail", {"mm": size})

    def _obstacle_of_positions(
        self, positions: Uncertainty, unseen: UnseenPairs, residuals: ResidualTable
    ) -> str | None:
        """Return why σ of positions allows no decision; None if it does, or is unknown."""
        if (std := positions.position_std_mm) is None:
            return None
        before = (residuals if unseen.errors is None else unseen.errors).summary().before
        # limits are of distances, along which each end has a third of its variance in space
        std_of_distance = std.rms * (2.0 / 3.0) ** 0.5
        return allows_decision(std_of_distance, self.options.limits_mm, before.rms)

    @property
    def _judged_rows(self) -> Index:
        """Rows of the shots for identification and hold-out, in the order of time."""
        sets = (ShotSet.IDENTIFICATION, ShotSet.VALIDATION, ShotSet.CHECK)
        return _rows_in_time(self.shots, self.observations, *sets)

    def _pattern(self) -> Literal["series", "region"] | None:
        """Return the pattern of the shots left out, hold-out shots too."""
        rows = self._judged_rows
        rows = rows[self.at_nominal.is_solved[rows]]
        left_out = [event.first for event in self.events if event.leaves_out]
        kept = ~np.isin(np.array(self.shots.numbers)[rows], left_out)
        positions = self.at_nominal.values[rows, :3]
        return pattern_of(kept, positions, np.random.default_rng(PATTERN_SEED))


def _rounded(rows: Array, digits: int) -> tuple[tuple[float, ...], ...]:
    """Return rows (N, 3) for a document, rounded to so many decimals."""
    return tuple(map(tuple, np.round(rows, digits).tolist()))


def _left_out(events: Iterable[Event], shots: Shots) -> Iterator[Excluded]:
    """Yield the shots that events leave out, each with its reason."""
    pairs = dict(zip(shots.numbers, shots.pairs, strict=True))
    for event in events:
        if event.kind == "no assembly":
            reason = "the robot cannot be assembled at its joints"
            yield Excluded(reason, shot=event.first, pair=pairs[event.first])
        elif event.kind == "wrong shot":
            reason = f"{event.size:.3f} mm off where all others put it"
            yield Excluded(reason, event.first, pairs[event.first], event.size)


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
