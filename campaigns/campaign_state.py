"""State of a campaign by its evidence, as far as the next step depends on it."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Literal

from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.export import FILE_NAME, PLAIN_FILE
from campaigns.controllers.programs import is_plan_program_there
from campaigns.errors import CampaignError
from campaigns.evidence import Evaluation, Evidence, evaluate
from campaigns.identification.result import RecordedIdentification
from campaigns.journal.views import Series
from campaigns.kinematics.parameters import Parameters
from campaigns.next_step import After, Answer, CampaignState, remedy_for
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plan_match import plan_difference


def present_state(
    campaign: Campaign,
    *,
    answered: bool = False,
    reported: bool = False,
    held: ControllerState | None = None,
) -> CampaignState:
    """State of a campaign by its files, else as `state_of`; raises as `gather` does."""
    if campaign.journal_path.exists():
        return state_of(evaluate(campaign), answered=answered, reported=reported, held=held)
    plan, program = None, False
    if campaign.plan_path.exists():
        with suppress(CampaignError):
            plan = campaign.read_plan()
    if campaign.is_offline:
        program = is_plan_program_there(campaign.folder, plan, campaign.robot.mechanism)
    return _unmeasured(campaign, plan, program=program, answered=answered, reported=reported)


def _unmeasured(
    campaign: Campaign,
    plan: Sequence[PlannedShot] | None,
    *,
    program: bool,
    answered: bool,
    reported: bool,
) -> CampaignState:
    """State of a campaign without a journal. `program`: whether there is one of plan.csv."""
    return CampaignState(
        folder=str(campaign.folder),
        answered=answered or campaign.is_simulated,
        offline=campaign.is_offline,
        program=program and campaign.is_offline,
        planned=plan is not None,
        reported=reported,
    )


def state_of(
    evaluation: Evaluation,
    *,
    answered: bool = False,
    reported: bool = False,
    held: ControllerState | None = None,
) -> CampaignState:
    """State of a campaign by its evidence; the rest is known to the command that ends.

    `held`: what it read from the controller; else what was loaded last counts.
    """
    evidence = evaluation.evidence
    campaign, found = evidence.campaign, evidence.identification
    every = evidence.journal.series if evidence.journal else ()
    bars = [shot for series in every if series.of_known_lengths for shot in series.shots]
    runs = [series for series in every if series.to_identify]
    program = campaign.is_offline and evidence.has_program
    plan = () if runs else evidence.plan
    state = replace(
        _unmeasured(campaign, plan, program=program, answered=answered, reported=reported),
        program_after=evidence.program_after,
        before=bool(evidence.before),
    )
    if not runs:
        return state
    latest, imported = runs[-1], campaign.is_offline or runs[-1].started.stage == "import"
    left = "" if imported else _left(evidence, latest)
    state = replace(state, measured="import" if imported else "run", left=left)
    last = max(shot.number for shot in (*latest.shots, *bars))
    is_of_latest = found is not None and (found.series, found.robot_digest) == (
        latest.number,
        campaign.robot.digest(),
    )
    if not is_of_latest or found is None or last > found.journal_records:
        return state
    if campaign.outdated(found):
        return state
    if found.verdict != "pass":
        return replace(state, verdict=found.verdict, remedy=remedy_for(found))
    passed = replace(state, verdict="pass", check=_answer_to_check(evidence, found))
    return _calibrated(evaluation, found, passed, held)


def _answer_to_check(evidence: Evidence, found: RecordedIdentification) -> Answer:
    """Return what answers a check that is not good; "" without such a check."""
    check = evidence.unanswered
    if check is None:
        return ""
    space = evidence.campaign.robot.mechanism.parameters
    is_of_latest = check.of == found.in_table(space).digest()
    if not is_of_latest or check.decision == "not decided":
        return "again"
    return "update" if check.parts else "anew"


def _left(evidence: Evidence, latest: Series) -> Literal["", "run", "anew"]:
    """Whether something of plan.csv is left to measure: of this series, or of a newer plan."""
    plan = evidence.plan
    if plan is None:
        return ""
    taken = [shot.intent for shot in latest.shots]
    other = plan_difference(taken, plan)
    if not latest.finished:
        return "anew" if other else "run"
    further = {row.shot for row in plan} - {intent.shot for intent in taken}
    is_same = not (other or further) or evidence.has_plan(latest.started.plan_digest)
    return "" if is_same else "run"


def _calibrated(
    evaluation: Evaluation,
    found: RecordedIdentification,
    state: CampaignState,
    held: ControllerState | None,
) -> CampaignState:
    """State after an identification that passed: file, controller, validation."""
    evidence = evaluation.evidence
    campaign = evidence.campaign
    identified = found.in_table(campaign.robot.mechanism.parameters)
    digest = identified.digest()
    held = held or evidence.controller
    holds = held is not None and held.origin == digest and not campaign.is_offline
    after = evidence.held("after")
    if after is not None and (after.origin != digest or _is_outlived(evidence, after, held)):
        after = None
    corrected = evidence.written is not None and evidence.written.by == "targets"
    taken_back = evidence.loaded is not None and evidence.loaded.rolls_back is not None
    verdict = evaluation.validated("after")
    decided: After = "worse" if verdict.worse else verdict.decision or "no limits"
    return replace(
        _with_file(evidence, identified, state),
        holds=holds,
        after=decided if after else "",
        reasons="; ".join(verdict.reasons),
        plain=after is not None and after.form is not None and not after.targets,
        by_targets=(corrected or taken_back) and not holds and not (after and after.targets),
    )


def _is_outlived(evidence: Evidence, after: ControllerState, held: ControllerState | None) -> bool:
    """Whether the controller holds something else since it was validated, and not by a rollback."""
    lost = held is not None and held.origin != after.origin
    if lost and evidence.loaded is not None and evidence.loaded.rolls_back is not None:
        return False
    is_read = not (after.targets or after.declared or evidence.campaign.is_offline)
    return evidence.loaded_since or (is_read and lost)


def _with_file(evidence: Evidence, identified: Parameters, state: CampaignState) -> CampaignState:
    """State with the robot file to export or to load: all parameters, or what the controller knows.

    What it lacks is known from the latest series that was measured with it.
    """
    digest, series = identified.digest(), evidence.journal.series if evidence.journal else ()
    stated = [each.started.lacks for each in series if each.started.lacks is not None]
    lacking = {*stated[-1]} & {*identified.extended_by} if stated else set[str]()
    plain = next(
        (
            form
            for form in evidence.forms
            if form.projection
            and form.projection.of == digest
            and not any(form.wanted.get(name) for name in lacking)
        ),
        None,
    )
    if lacking and plain is None:
        there = any(form.file == PLAIN_FILE for form in evidence.forms)
        return replace(state, to_export="plain", overwrite=there)
    if plain is not None and (lacking or not stated):
        return replace(state, file=plain.file)
    if evidence.file_origin != digest:
        there = evidence.file_origin is not None or evidence.spoilt_parameter_file
        return replace(state, to_export="yaml", overwrite=there)
    return replace(state, file=FILE_NAME)
