"""Validation of a campaign: how good the robot is as its user commands it."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.arrays import AXES
from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.controllers.export import CalibrationRoute
from campaigns.controllers.load_journal import FOUND_AGAIN, Holding, load_history
from campaigns.errors import LoadNotVerified, OptionsInvalid
from campaigns.evaluation import validation
from campaigns.evaluation.decision import NO_LIMIT
from campaigns.evaluation.verdict import CampaignVerdict, ValidationVerdict
from campaigns.evidence import Evaluation, evaluate, gather
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Event, Finding, Stage
from campaigns.measuring.run_state import SILENT, RunObserver
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import Cell, Work
from campaigns.options import ValidationOptions, ValidationStage
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.validation_plan import Correct, Reachable, validation_steps
from campaigns.robots.robot import RobotFile, pose_row
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.workflow.correction import identified_set
from campaigns.workflow.identification import identification_options
from campaigns.workflow.running import known_shots
from campaigns.workflow.work import engine_work, known_sets

AGAIN = "--force measures it all the same"
VerificationStage = Literal["verify before", "verify after"]
TESTS = frozenset(validation.SET_OF.values())
"""Of a validation."""


@dataclass(frozen=True, slots=True, eq=False)
class Validated:
    """Result of a validation, and the campaign with it: earlier tests of the stage count too."""

    stage: ValidationStage
    result: validation.ValidationResult
    evaluation: Evaluation

    @property
    def whole(self) -> validation.ValidationResult:
        """Of each test of the stage the latest."""
        evaluation = self.evaluation
        return (evaluation.before if self.stage == "before" else evaluation.after) or self.result

    @property
    def verdict(self) -> ValidationVerdict:
        """Verdict on the stage."""
        return self.evaluation.validated(self.stage)

    @property
    def campaign_verdict(self) -> CampaignVerdict | None:
        """Verdict on the whole campaign, as its report has it; None before calibration."""
        return self.evaluation.verdict if self.stage == "after" else None

    @property
    def otherwise(self) -> CampaignVerdict | None:
        """Verdict on the campaign where it is another than the stage's; None: it is not."""
        whole = self.campaign_verdict
        alike = whole is None or whole.decision in {self.verdict.decision, NO_LIMIT}
        return None if alike else whole


def validation_work(
    campaign: Campaign, active: Mapping[str, float], options: ValidationOptions
) -> tuple[Work, tuple[str, ...]]:
    """Return tests as work for the engine, and what had to be shortened or left out.

    Planned with the parameters that are active in the controller, which takes the pose commands; by
    targets with the identified ones of the exported file, the active ones being the controller's.
    Raises `ConfigInvalid` for a file that is not for this campaign, and `OptionsInvalid` for a shot
    to skip that is unknown.
    """
    tests = options.tests
    unseen = _unseen_pairs(campaign) if ShotSet.VALIDATION in tests else ()
    held = _active_robot(campaign, active)
    if options.by == "parameters":
        correct = _to_controlled_point(held)
        work, notes = _work(campaign, options.stage, held, tests, unseen, correct)
    else:
        identified, nominal = identified_set(campaign), held.kinematics.controlled
        correct = TargetCorrection(identified.kinematics, nominal, held.limits).commanded
        work, notes = _work(campaign, "after by targets", identified, tests, unseen, correct)
    skip = known_shots((step.planned.shot for step in work.steps), options.skip, "this validation")
    return replace(work, skip=skip), notes


def seconds_of(campaign: Campaign, work: Work) -> float:
    """Return the time that work takes, by straight ways."""
    joints = np.array([step.planned.joints for step in work.steps])
    turns = np.abs(np.diff(work.robot.kinematics.comparable(joints), axis=0))
    return campaign.pace.seconds(len(joints), float(turns.max(axis=1, initial=0.0).sum()))


def verification_pairs(
    campaign: Campaign, sets: Sequence[Mapping[str, float]], count: int
) -> tuple[PlannedShot, ...]:
    """Return the first validation pairs that each of these parameter sets can be sent to.

    Raises `OptionsInvalid` when there are fewer than asked for.
    """
    reachable = [_reachable(campaign, _active_robot(campaign, active)) for active in sets]
    pairs: dict[int, list[PlannedShot]] = {}
    for shot in _unseen_pairs(campaign):
        if shot.pair is not None:
            pairs.setdefault(shot.pair, []).append(shot)
    able = [
        both
        for both in pairs.values()
        if not any(
            pair.first_reason(np.array([pose_row(shot.pose) for shot in both]))
            for pair in reachable
        )
    ]
    if len(able) < count:
        raise OptionsInvalid(
            f"--verify {count}: plan.csv has {len(pairs)} validation pairs, {len(able)} within "
            "reach of the old and the new parameters",
            remedy=f"give --verify {len(able)} or less" if able else "plan with validation pairs",
        )
    return tuple(shot for both in able[:count] for shot in both)


def verification_work(
    campaign: Campaign,
    stage: VerificationStage,
    active: Mapping[str, float],
    shots: Sequence[PlannedShot],
) -> Work:
    """Return pairs as work for the engine, commanded by poses as in a validation.

    It ends at the centre, from where a safe way leads whichever parameters the controller holds.
    """
    robot = _active_robot(campaign, active)
    correct = _to_controlled_point(robot)
    work, _ = _work(campaign, stage, robot, frozenset({ShotSet.VALIDATION}), shots, correct)
    centre = np.zeros((1, len(robot.mechanism.task)))
    centre[0, : len(AXES)] = campaign.config.validation.centre_mm
    reachable = _reachable(campaign, robot, correct)
    if reachable.first_reason(centre):
        return work
    return replace(work, ends_at=tuple(reachable.joints(centre)[0].tolist()))


def mean_of_pairs_mm(campaign: Campaign, journal: JournalReader, series: int, count: int) -> float:
    """Return the mean error without signs of the distances of a series' pairs.

    Raises `LoadNotVerified` if fewer than `count` pairs were measured.
    """
    distances = _evaluated(campaign, journal, series).distances
    measured = len(distances.pairs) if distances else 0
    if distances is None or measured < count:
        events = (entry.record for entry in journal.records_of(Event, series))
        skipped = [event.text for event in events if event.kind == "shot skipped"]
        raise LoadNotVerified(
            "; ".join(
                [f"{measured} of {count} pairs measured: the load is not verified", *skipped[-1:]]
            ),
            remedy="clear what kept the robot or the beam from there, or give another --verify",
        )
    return distances.mean.value_mm


def wrong_stage(
    campaign: Campaign,
    held: Mapping[str, float],
    stage: ValidationStage,
    tell: Callable[[str], None] = lambda _: None,
    *,
    by: CalibrationRoute = "parameters",
) -> OptionsInvalid | None:
    """Return what forbids measuring a stage while the controller holds these parameters.

    `tell` hears of a load that was begun and not ended; its end is written into the journal.
    """
    mixture = _ended_load(campaign, held, tell)
    if mixture:
        return OptionsInvalid(f"--stage {stage}: {mixture}", remedy=AGAIN)
    return wrong_state(campaign, known_sets(campaign).state_of(held), stage, by)


def wrong_state(
    campaign: Campaign,
    held: ControllerState,
    stage: ValidationStage,
    by: CalibrationRoute = "parameters",
) -> OptionsInvalid | None:
    """Return the objection to a stage with a controller in this state; None without any."""
    nominal, rolled_back = held.kind == "nominal", f"`pkmcal load {campaign.folder} --rollback`"
    if nominal == (stage == "before" or by == "targets"):
        return None
    if stage == "before":
        nominal_file = campaign.path(campaign.config.robot)
        remedy = {"other": f"`pkmcal load {campaign.folder} --robot {nominal_file}`"}
        return OptionsInvalid(
            f"--stage before: the controller holds {held.says}",
            remedy=f"{remedy.get(held.kind, rolled_back)} first, or --stage after; {AGAIN}",
        )
    if by == "targets":
        return OptionsInvalid(
            "--by targets: the controller does not hold the nominal parameters, for which targets "
            f"are corrected, but {held.says}",
            remedy=f"{rolled_back} first, or leave --by targets out; {AGAIN}",
        )
    return OptionsInvalid(
        "--stage after: the controller still holds the nominal parameters",
        remedy=f"`pkmcal load {campaign.folder}` first, or --by targets, or --stage before; "
        f"{AGAIN}",
    )


def replaced(
    campaign: Campaign, stage: ValidationStage, tests: frozenset[ShotSet] = TESTS
) -> OptionsInvalid | None:
    """Return the objection to tests before calibration that were measured already."""
    if stage == "after":
        return None
    done = [each for each in gather(campaign).before if each.series.finished]
    measured = {
        name: each.series.number
        for name, test in validation.SET_OF.items()
        for each in done
        if test in tests and test in each.shots.purposes
    }
    if not measured:
        return None
    series = ", ".join(map(str, sorted(set(measured.values()))))
    return OptionsInvalid(
        f"--stage before: measured already (series {series}): {', '.join(measured)}; a later one "
        "would count in its place",
        remedy=f"keep them and go on; {AGAIN}",
    )


def require_or_record(
    campaign: Campaign, objections: Iterable[OptionsInvalid | None], *, anyway: bool
) -> None:
    """Raise the first objection to a stage, or write into the journal what is done `anyway`."""
    errors = [each for each in objections if each is not None]
    if errors and not anyway:
        raise errors[0]
    for wrong in errors:
        with campaign.journal() as journal:
            record_objection(journal, wrong)


def record_objection(journal: Journal, wrong: OptionsInvalid) -> None:
    """Write into the journal in spite of what is measured."""
    journal.append(Event("wrong stage", f"measured all the same: {wrong.problem}"))


def validate(
    campaign: Campaign,
    cell: Cell,
    options: ValidationOptions,
    *,
    observer: RunObserver = SILENT,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Validated:
    """Measure on a connected cell how good the robot is as its user commands it, and judge it.

    By targets, the controller keeps its nominal parameters and is commanded corrected poses; errors
    are judged against the wanted ones. Raises `OptionsInvalid` for the wrong stage, and for what
    was measured before already, unless it is measured `anyway`.
    """
    active, stage = cell.robot.read_geometry(), options.stage
    again = replaced(campaign, stage, options.tests)
    wrong = wrong_stage(campaign, active, stage, observer.event, by=options.by)
    require_or_record(campaign, (again, wrong), anyway=options.force)
    work, notes = validation_work(campaign, active, options)
    for note in notes:
        observer.event(note)
    with campaign.journal() as journal:
        series = measure_series(cell, journal, work, observer, stop_requested)
        return record_validation(campaign, journal, series, stage, options.by)


def record_validation(
    campaign: Campaign,
    journal: Journal,
    series: int,
    stage: ValidationStage,
    by: CalibrationRoute = "parameters",
) -> Validated:
    """Evaluate a series that was measured, and write the finding into the journal."""
    result = _evaluated(campaign, journal, series)
    body = {"stage": stage, "by": by, "series": series, **result.document()}
    journal.append(Finding("validation", body), series=series)
    return Validated(stage, result, evaluate(campaign))


def _ended_load(campaign: Campaign, held: Mapping[str, float], tell: Callable[[str], None]) -> str:
    """End a load that has none, by what the controller holds; gives what still cannot be ended."""
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
    campaign: Campaign, journal: JournalReader, series: int
) -> validation.ValidationResult:
    shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    return validation.evaluate_validation(shots, campaign.instrument, series)


def _unseen_pairs(campaign: Campaign) -> tuple[PlannedShot, ...]:
    return tuple(s for s in campaign.read_plan() if s.purpose is ShotSet.VALIDATION)


def _active_robot(campaign: Campaign, active: Mapping[str, float]) -> RobotFile:
    nominal, held = campaign.robot, known_sets(campaign).match(active)
    return RobotFile.of(nominal.mechanism, held, name="active", limits=nominal.limits)


def _to_controlled_point(held: RobotFile) -> Correct | None:
    """Return the poses to command where the reflector is on another part of the plate."""
    model, controlled = held.kinematics, held.kinematics.controlled
    same = controlled.mechanism == model.mechanism
    return None if same else TargetCorrection(model, controlled, held.limits).commanded


def _reachable(campaign: Campaign, robot: RobotFile, correct: Correct | None = None) -> Reachable:
    return Reachable(robot.kinematics, robot.limits, space=campaign.space, correct=correct)


def _work(
    campaign: Campaign,
    stage: Stage,
    robot: RobotFile,
    tests: frozenset[ShotSet],
    unseen: Sequence[PlannedShot],
    correct: Correct | None = None,
) -> tuple[Work, tuple[str, ...]]:
    reachable = _reachable(campaign, robot, correct)
    steps, notes = validation_steps(
        campaign.config.validation,
        unseen,
        reachable,
        tests,
        np.random.default_rng(campaign.config.plan.seed),
        campaign.region,
    )
    how = identification_options(campaign)
    work = engine_work(campaign, stage, steps, reachable.kinematics, robot.digest(), how)
    return work, notes
