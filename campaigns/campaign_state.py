"""State of a campaign by its evidence, as far as the next step depends on it.

What judges is imported where there is something to judge: a new campaign's first hints need none.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

from campaigns.campaign import Campaign
from campaigns.controllers.export import PLAIN_FILE
from campaigns.errors import CampaignError
from campaigns.kinematics.parameters import Parameters
from campaigns.next_step import After, Answer, CampaignState, Held
from campaigns.shots.shot_sets import ShotSet

if TYPE_CHECKING:
    from campaigns.controllers.controller_state import ControllerState
    from campaigns.evidence import Evaluation, Evidence
    from campaigns.identification.result import RecordedIdentification
    from campaigns.journal.views import Series
    from campaigns.planning.plan_file import PlannedShot


def present_state(
    campaign: Campaign,
    *,
    answered: bool = False,
    reported: bool = False,
    held: "ControllerState | None" = None,
) -> CampaignState:
    """State of a campaign by its files, else as `state_of`; raises as `gather` does."""
    if campaign.journal_path.exists():
        from campaigns.evidence import evaluate

        return state_of(evaluate(campaign), answered=answered, reported=reported, held=held)
    plan, program = None, False
    if campaign.plan_path.exists():
        with suppress(CampaignError):
            plan = campaign.read_plan()
    if campaign.is_offline:
        from campaigns.controllers.programs import is_plan_program_there

        program = is_plan_program_there(campaign.folder, plan, campaign.robot.mechanism)
    return _unmeasured(campaign, plan, program=program, answered=answered, reported=reported)


def _unmeasured(
    campaign: Campaign,
    plan: "Sequence[PlannedShot] | None",
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
    evaluation: "Evaluation",
    *,
    answered: bool = False,
    reported: bool = False,
    held: "ControllerState | None" = None,
) -> CampaignState:
    """State of a campaign by its evidence; the rest is known to the command that ends.

    `held`: what it read from the controller; else what was loaded last counts.
    """
    evidence = evaluation.evidence
    campaign, found = evidence.campaign, evidence.identification
    every = evidence.journal.series if evidence.journal else ()
    bars = [shot for each in every if each.of_known_lengths for shot in each.shots]
    runs = [each for each in every if each.to_identify]
    # where a run or import leads on nothing asks for the plan, which takes long to read
    plan = () if runs else evidence.plan
    program = campaign.is_offline and evidence.has_program
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
    if found is None or (found.series, found.robot_digest) != (
        latest.number,
        campaign.robot.digest(),
    ):
        return state
    if last > found.journal_records or campaign.outdated(found):
        return state
    if found.verdict == "pass":
        passed = replace(state, verdict="pass", check=_to_answer(evidence, found))
        return _calibrated(evaluation, found, passed, held)
    from campaigns.way_on import way_on

    shots = [
        shot.number for shot in latest.shots if shot.intent.purpose == ShotSet.IDENTIFICATION.value
    ]
    step = way_on(found, shots, state.folder, imported=imported)
    return replace(state, verdict=found.verdict, way_on=step)


def _to_answer(evidence: "Evidence", found: "RecordedIdentification") -> Answer:
    """What answers a check that is not good."""
    check = evidence.unanswered
    if check is None:
        return ""
    space = evidence.campaign.robot.mechanism.parameters
    if check.of != Parameters.of(space, found.flat()).digest():
        return "again"
    if check.decision == "not decided":
        return "again"
    return "update" if check.parts else "anew"


def _left(evidence: "Evidence", latest: "Series") -> Literal["", "run", "anew"]:
    """Whether something of plan.csv is left to measure: of this series, or of a newer plan."""
    plan, started = evidence.plan, latest.started
    if plan is None:
        return ""
    from campaigns.planning.plan_match import plan_difference

    taken = [shot.intent for shot in latest.shots]
    other = plan_difference(taken, plan)
    if not latest.finished:
        return "anew" if other else "run"
    further = {row.shot for row in plan} - {intent.shot for intent in taken}
    is_same = not (other or further) or evidence.has_plan(started.plan_digest)
    return "" if is_same else "run"


def _calibrated(
    evaluation: "Evaluation",
    found: "RecordedIdentification",
    state: CampaignState,
    held: "ControllerState | None",
) -> CampaignState:
    """State after an identification that passed: file, controller, validation."""
    evidence = evaluation.evidence
    space, journal = evidence.campaign.robot.mechanism.parameters, evidence.journal
    identified = Parameters.of(space, found.flat())
    digest, loaded = identified.digest(), evidence.loaded
    every = [each.started.lacks for each in (journal.series if journal else ())]
    lacks = next((each for each in reversed(every) if each is not None), None)
    lacking = {*(lacks or ())} & {*identified.extended_by}
    own = [each for each in evidence.forms if each.projection and each.projection.of == digest]
    taken = next((each for each in own if not any(each.wanted.get(n) for n in lacking)), None)
    has_form = taken is not None and (bool(lacking) or lacks is None)
    held = held or evidence.controller
    kinds: dict[str, Held] = {"identified": "identified", "form": "form"}
    known_other = held is not None and held.origin != digest and not evidence.campaign.is_offline
    known = held is not None and held.origin == digest and not evidence.campaign.is_offline
    holds = kinds.get(held.kind, "") if held and known else ""
    after = evidence.held("after")
    after = after if after and after.origin == digest else None
    verdict = evaluation.validated("after")
    decided: After = "worse" if verdict.worse else verdict.decision or "no limits"
    missed = [
        each.error for each in verdict.requirements if each.decision in {"fail", "not decided"}
    ]
    weak = bool(verdict.beyond) or any(error is not None for error in missed)
    taken_back = loaded is not None and loaded.rolls_back is not None
    corrected = evidence.written is not None and evidence.written.by == "targets"
    by_targets = after is not None and after.targets
    given_back = taken_back and not holds and state.measured != "import"
    known_other &= after is not None and not (by_targets or after.declared)
    if not given_back and (evidence.loaded_since or known_other):
        after = None
    is_there = evidence.file_origin is not None or evidence.spoilt_parameter_file
    return replace(
        state,
        file="identified" if evidence.file_origin == digest else "other" if is_there else "",
        form="exported" if has_form else "needed" if lacking else "",
        form_file=taken.file if taken else PLAIN_FILE,
        form_there=any(each.file == PLAIN_FILE for each in evidence.forms),
        holds=holds,
        after=decided if after else "",
        reasons="; ".join(verdict.reasons),
        weak=weak and after is not None and after.kind == "form" and not by_targets,
        to_correct=not holds and not by_targets and (taken_back or corrected),
    )
