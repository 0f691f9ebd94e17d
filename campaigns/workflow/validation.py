"""Validation of a campaign: how good the robot is as its user commands it."""

# Identification commands joints; a validation commands poses, which the controller turns into
# joints with the parameters that it holds. Only so do errors of these parameters show (ADR 11).
# The two stages differ in what the controller holds, and in nothing else: the nominal set before
# calibration, the identified one after it. So before anything is measured, the controller is read
# and its set is compared with the stage (`wrong_stage`).
#
# `--by targets` is for controllers that keep the nominal set: planned poses are corrected with the
# identified set (corrected_targets.py), and errors are judged against the wanted poses.
# A plate of two halves may carry the reflector on the half that the controller does not control.
# Planned poses are poses of the reflector then, and `_to_controlled_point` converts them.

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.controllers.export import CalibrationRoute
from campaigns.controllers.load_journal import FOUND_AGAIN, Holding, load_history
from campaigns.errors import LoadNotVerified, OptionsInvalid
from campaigns.evaluation import validation
from campaigns.evaluation.decision import NO_LIMIT
from campaigns.evaluation.robot_scatter import RobotScatter
from campaigns.evaluation.verdict import CampaignVerdict, ValidationVerdict
from campaigns.evidence import counted_series
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Event, Finding, Stage
from campaigns.measuring.run_state import SILENT, RunObserver, Wishes
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import Devices, Work
from campaigns.options import ValidationOptions, ValidationStage
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.validation_plan import Correct, Reachable, validation_steps
from campaigns.robots.robot import RobotFile, pose_row
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.shots.stops import by_stops
from campaigns.workflow.correction import identified_set
from campaigns.workflow.identification import identification_options
from campaigns.workflow.running import known_shots
from campaigns.workflow.work import all_series, engine_work, known_sets
from drivers.texts import quoted

FORCE_MEASURES = "--force measures it all the same"
VerificationStage = Literal["verify before", "verify after"]
TESTS = frozenset(validation.SET_OF.values())
"""Sets of shots of all tests."""


@dataclass(frozen=True, slots=True, eq=False)
class Validated:
    """Result of a validation, and the evaluation of the campaign with it.

    Attributes:
        stage: The stage, before or after calibration.
        result: Figures of the series that was just measured or imported.
        evaluation: Evaluation of the whole campaign, earlier tests of the stage included.
    """

    stage: ValidationStage
    result: validation.ValidationResult
    evaluation: Evaluation

    @property
    def stage_result(self) -> validation.ValidationResult:
        """Figures of the stage: of each test the latest."""
        evaluation = self.evaluation
        return (evaluation.before if self.stage == "before" else evaluation.after) or self.result

    @property
    def verdict(self) -> ValidationVerdict:
        """Verdict on the stage."""
        return self.evaluation.validated(self.stage)

    @property
    def campaign_verdict(self) -> CampaignVerdict | None:
        """Verdict on the whole campaign, as in its report; None before calibration."""
        return self.evaluation.verdict if self.stage == "after" else None

    @property
    def differing_verdict(self) -> CampaignVerdict | None:
        """Verdict on the campaign if it differs from the stage's verdict, else None."""
        of_campaign = self.campaign_verdict
        if of_campaign is None or of_campaign.decision in {self.verdict.decision, NO_LIMIT}:
            return None
        return of_campaign


def validation_work(
    campaign: Campaign, active: Mapping[str, float], options: ValidationOptions
) -> tuple[Work, tuple[str, ...]]:
    """Return the tests as work for the engine, and notes on those shortened or left out.

    `active` are the controller's parameters by name, mm and deg. Raise `ConfigInvalid` for an
    exported file that is not of this campaign, `PlanInvalid` if nothing can be tested, and
    `OptionsInvalid` for an unknown shot to skip.
    """
    # The tests are planned with the model that will set the joints: the controller's own set, or by
    # targets the identified one, by which the commanded poses are corrected.
    tests = options.tests
    unseen = _unseen_pairs(campaign) if ShotSet.VALIDATION in tests else ()
    held = _active_robot(campaign, active)
    if options.by == "parameters":
        correct = _to_controlled_point(held)
        work, notes = _work(campaign, options.stage, held, tests, unseen, correct)
    else:
        identified, nominal = identified_set(campaign), held.kinematics.controlled
        recorded = known_sets(campaign).identified.get(identified.digest())
        layers = () if recorded is None else recorded.value.layers
        correction = TargetCorrection(identified.kinematics, nominal, held.limits, layers=layers)
        correct = correction.commanded
        work, notes = _work(campaign, "after by targets", identified, tests, unseen, correct)
    skip = known_shots((step.planned.shot for step in work.steps), options.skip, "this validation")
    return replace(work, skip=skip), notes


def seconds_of(campaign: Campaign, work: Work) -> float:
    """Return the time that work takes if all ways are straight, s."""
    joints = np.array([step.planned.joints for step in work.steps])
    turns = np.abs(np.diff(work.robot.kinematics.comparable(joints), axis=0))
    return campaign.pace.seconds(len(joints), float(turns.max(axis=1, initial=0.0).sum()))


def verification_pairs(
    campaign: Campaign, sets: Sequence[Mapping[str, float]], count: int
) -> tuple[PlannedShot, ...]:
    """Return the shots of the first `count` validation pairs that a robot reaches by all sets.

    `sets` are parameters by name, mm and deg. Raise `OptionsInvalid` if there are fewer pairs.
    """
    robots = [_reachable(campaign, _active_robot(campaign, active)) for active in sets]
    pairs: dict[int, list[PlannedShot]] = {}
    for shot in _unseen_pairs(campaign):
        if shot.pair is not None:
            pairs.setdefault(shot.pair, []).append(shot)
    # the same pairs are measured before and after: each must be possible with both sets
    within_reach = []
    for shots in pairs.values():
        poses = np.array([pose_row(shot.pose) for shot in shots])
        if not any(robot.first_reason(poses) for robot in robots):
            within_reach.append(shots)
    able = len(within_reach)
    if able < count:
        raise OptionsInvalid(
            f"--verify {count}: plan.csv has {len(pairs)} validation pairs, {able} within "
            "reach of the old and the new parameters",
            remedy=f"give --verify {able} or less" if able else "plan with validation pairs",
        )
    return tuple(shot for shots in within_reach[:count] for shot in shots)


def verification_work(
    campaign: Campaign,
    stage: VerificationStage,
    active: Mapping[str, float],
    shots: Sequence[PlannedShot],
) -> Work:
    """Return pairs as work for the engine, commanded by poses as in a validation.

    `active` are the controller's parameters by name, mm and deg.
    """
    robot = _active_robot(campaign, active)
    correct = _to_controlled_point(robot)
    work, _ = _work(campaign, stage, robot, frozenset({ShotSet.VALIDATION}), shots, correct)
    # The robot is left at the centre of the workspace: the parameters change next, and from the
    # centre a safe way leads to the first pair by either set.
    centre = campaign.centre[None]
    reachable = _reachable(campaign, robot, correct)
    if reachable.first_reason(centre):
        return work
    return replace(work, ends_at=tuple(reachable.joints(centre)[0].tolist()))


def evaluated_pairs(
    campaign: Campaign, journal: JournalReader, series: int, count: int
) -> validation.ValidationResult:
    """Return the figures of a series of pairs, with the robot's scatter in their uncertainty.

    Raise `LoadNotVerified` if fewer than `count` pairs were measured: the figures before and after
    would be of different pairs.
    """
    result = _evaluated(campaign, journal, series, evaluate(campaign).scatter)
    distances = result.distances
    measured = len(distances.pairs) if distances else 0
    if measured < count:
        events = (entry.record for entry in journal.records_of(Event, series))
        skipped = [event.text for event in events if event.kind == "shot skipped"]
        raise LoadNotVerified(
            "; ".join(
                [f"{measured} of {count} pairs measured: the load is not verified", *skipped[-1:]]
            ),
            remedy="clear what kept the robot or the beam from there, or give another --verify",
        )
    return result


def wrong_stage(
    campaign: Campaign,
    held: Mapping[str, float],
    stage: ValidationStage,
    tell: Callable[[str], None] = lambda _: None,
    *,
    by: CalibrationRoute = "parameters",
) -> OptionsInvalid | None:
    """Return the objection to measuring a stage with the controller's parameters; None if right.

    `held` are the parameters by name, mm and deg. A load without an end is given its end in the
    journal, and `tell` receives a sentence about it.
    """
    mixture = _end_load(campaign, held, tell)
    if mixture:
        return OptionsInvalid(f"--stage {stage}: {mixture}", remedy=FORCE_MEASURES)
    return wrong_state(campaign, known_sets(campaign).state_of(held), stage, by)


def wrong_state(
    campaign: Campaign,
    held: ControllerState,
    stage: ValidationStage,
    by: CalibrationRoute = "parameters",
) -> OptionsInvalid | None:
    """Return the objection to a stage with a controller in this state; None if it is right."""
    roll_back = "`pkmcal load DIR --rollback`"
    # nominal parameters are right before calibration, and after it only by corrected targets
    if (held.kind == "nominal") == (stage == "before" or by == "targets"):
        return None
    if stage == "before":
        nominal_file = campaign.path(campaign.config.robot)
        remedy = {"other": f"`pkmcal load DIR --robot {quoted(str(nominal_file))}`"}
        return OptionsInvalid(
            f"--stage before: the controller holds {held.says}",
            remedy=f"{remedy.get(held.kind, roll_back)} first, or --stage after; {FORCE_MEASURES}",
        )
    if by == "targets":
        return OptionsInvalid(
            "--by targets: the controller does not hold the nominal parameters, for which targets "
            f"are corrected, but {held.says}",
            remedy=f"{roll_back} first, or leave --by targets out; {FORCE_MEASURES}",
        )
    return OptionsInvalid(
        "--stage after: the controller still holds the nominal parameters",
        remedy=f"`pkmcal load DIR` first, or --by targets, or --stage before; {FORCE_MEASURES}",
    )


def replaced(
    campaign: Campaign, stage: ValidationStage, tests: frozenset[ShotSet] = TESTS
) -> OptionsInvalid | None:
    """Return the objection to tests before calibration that were measured already; None if not."""
    # After calibration a repeated test is welcome. Before it, the result is the proof of what
    # calibration gained, and after a rollback the robot may no longer be in that state.
    if stage == "after":
        return None
    finished = [series for series in counted_series(all_series(campaign), stage) if series.finished]
    measured = {
        name: series.number
        for name, test in validation.SET_OF.items()
        for series in finished
        if test in tests and any(shot.intent.purpose == test.value for shot in series.shots)
    }
    if not measured:
        return None
    series = ", ".join(map(str, sorted(set(measured.values()))))
    return OptionsInvalid(
        f"--stage before: measured already (series {series}): {', '.join(measured)}; a later one "
        "would count in its place",
        remedy=f"keep them and go on; {FORCE_MEASURES}",
    )


def record_objections(journal: Journal, objections: Iterable[OptionsInvalid]) -> None:
    """Write objections that were overruled into the journal."""
    for objection in objections:
        journal.append(Event("wrong stage", f"measured all the same: {objection.problem}"))


def validate(
    campaign: Campaign,
    cell: Devices,
    options: ValidationOptions,
    *,
    observer: RunObserver = SILENT,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Validated:
    """Measure on a connected cell how good the robot is as its user commands it, and judge it.

    Args:
        campaign: The campaign, with a plan.
        cell: Controller, tracker and time, from `connected_cell`, prepared by `prepare`.
        options: Options of `pkmcal validate`; the stage at least.
        observer: Receives progress; by default nothing is reported.
        stop_requested: Returns True when the validation shall end; the robot is then stopped.

    Returns:
        The figures of the tests, and the verdicts on the stage and on the campaign.

    Raises:
        OptionsInvalid: The controller does not hold the parameters of the stage, or the tests
            before calibration were measured already; `force` in the options overrules both.
        PlanInvalid: Nothing can be tested.
        Interrupted, GateRefused, DriverError: What ended it; the measured shots are kept.

    Example:
        >>> workflow.validate(campaign, cell, ValidationOptions(stage="before")).verdict.decision
    """
    active, stage = cell.robot.read_geometry(), options.stage
    again = replaced(campaign, stage, options.tests)
    wrong = wrong_stage(campaign, active, stage, observer.event, by=options.by)
    objections = [objection for objection in (again, wrong) if objection is not None]
    if objections and not options.force:
        raise objections[0]
    if objections:
        with campaign.journal() as journal:
            record_objections(journal, objections)
    work, notes = validation_work(campaign, active, options)
    for note in notes:
        observer.event(note)
    with campaign.journal() as journal:
        series = measure_series(cell, journal, work, observer, Wishes(stop_requested))
        return record_validation(campaign, journal, series, stage, options.by)


def record_validation(
    campaign: Campaign,
    journal: Journal,
    series: int,
    stage: ValidationStage,
    by: CalibrationRoute = "parameters",
) -> Validated:
    """Evaluate a validation's series, write the finding into the journal, and return the result."""
    # The evaluation precedes the finding, which adds nothing to it but a record.
    evaluation = evaluate(campaign)
    result = _evaluated(campaign, journal, series, evaluation.scatter)
    body = {"stage": stage, "by": by, "series": series, **result.document()}
    journal.append(Finding("validation", body), series=series)
    return Validated(stage, result, evaluation)


def _end_load(campaign: Campaign, held: Mapping[str, float], tell: Callable[[str], None]) -> str:
    """Write the end of a load that has none, by what the controller holds.

    Return "", or for a mixture of old and new parameters, which ends nothing, its description.
    """
    if not campaign.journal_path.exists():
        return ""
    with campaign.journal_reader() as journal:
        _, unended = load_history(journal)
    if unended is None:
        return ""
    if unended.holding(held) is Holding.OTHER:
        return unended.describe(held)
    tell(unended.describe(held))
    with campaign.journal() as journal:
        unended.settle(journal, held, FOUND_AGAIN)
    return ""


def _evaluated(
    campaign: Campaign, journal: JournalReader, series: int, scatter: RobotScatter
) -> validation.ValidationResult:
    """Return the figures of a series' accepted shots, with the robot's scatter in their U."""
    mechanism = campaign.robot.mechanism
    shots = by_stops(shots_of_journal(journal.shots(series), mechanism), mechanism.joints)
    started = next(each.started for each in journal.series() if each.number == series)
    instrument = campaign.instrument_of(started).uncertainty
    return validation.evaluate_validation(shots, instrument, series, scatter)


def _unseen_pairs(campaign: Campaign) -> tuple[PlannedShot, ...]:
    """Return the plan's validation shots, which no fit uses."""
    return tuple(s for s in campaign.read_plan() if s.purpose is ShotSet.VALIDATION)


def _active_robot(campaign: Campaign, active: Mapping[str, float]) -> RobotFile:
    """Return the robot that the controller computes with, by its parameters."""
    # the matching known set, not the values as read: a resumed series compares digests
    nominal, held = campaign.robot, known_sets(campaign).match(active)
    return RobotFile.of(nominal.mechanism, held, name="active", limits=nominal.limits)


def _to_controlled_point(held: RobotFile) -> Correct | None:
    """Return the correction from poses of the reflector to poses of the controlled point.

    None if the reflector moves with the controlled point.
    """
    model, controlled = held.kinematics, held.kinematics.controlled
    is_alike = controlled.mechanism == model.mechanism
    return None if is_alike else TargetCorrection(model, controlled, held.limits).commanded


def _reachable(campaign: Campaign, robot: RobotFile, correct: Correct | None = None) -> Reachable:
    """Return the robot by which tests are planned: its model, limits, space and correction."""
    return Reachable(robot.kinematics, robot.limits, space=campaign.space, correct=correct)


def _work(
    campaign: Campaign,
    stage: Stage,
    robot: RobotFile,
    tests: frozenset[ShotSet],
    unseen: Sequence[PlannedShot],
    correct: Correct | None = None,
) -> tuple[Work, tuple[str, ...]]:
    """Return tests as work for the engine, and notes on those shortened or left out.

    `robot` is the model that sets the joints; `correct` turns wanted into commanded poses.
    """
    # Both stages must test alike. So the random turn of the approaches of repeatability comes from
    # the plan's seed, and the cube is sought in the nominal robot's region.
    reachable = _reachable(campaign, robot, correct)
    steps, notes = validation_steps(
        campaign.config.validation,
        unseen,
        reachable,
        tests,
        np.random.default_rng(campaign.config.plan.seed),
        campaign.region,
    )
    fit_options = identification_options(campaign)
    work = engine_work(campaign, stage, steps, reachable.kinematics, robot.digest(), fit_options)
    return work, notes
