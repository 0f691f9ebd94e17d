"""Next step: the one command that a campaign's evidence asks for, whatever it has reached.

Pure. A step changes the state that it follows from, so that no advice leads back.
"""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.arrays import Index
from campaigns.controllers.controller_state import ControllerState
from campaigns.estimation.estimators import Model
from campaigns.evaluation import diagnostics, identification
from campaigns.evaluation.decision import Decision
from campaigns.evidence import Evaluation, Evidence
from campaigns.identification.result import RecordedIdentification
from campaigns.journal.views import AcceptedShot, Series
from campaigns.mechanisms.parameters import Parameters
from campaigns.planning.plan_file import plan_digest
from campaigns.planning.plan_match import plan_difference
from campaigns.shots.shot_sets import ShotSet

ENOUGH_SHOTS = 240
"""To identify from: what so many cannot tell, more of them will not."""
FEWEST_PAIRS = 10
"""Of which some can be kept unseen."""
PLAIN_FILE = "robot-plain.yaml"
Way = Literal[
    "",
    "identify again",
    "own frames",
    "a part",
    "accept change",
    "accept scale",
    "more shots",
    "hold",
    "free",
    "leave out",
    "keep unseen",
    "no prior",
    "larger model",
    "set limits",
    "widen limits",
    "measure again",
]
"""Way on from an identification that did not pass."""
WAYS: Mapping[str, Way] = {
    diagnostics.LARGE_CHANGE: "accept change",
    diagnostics.COMMON_SCALE: "accept scale",
    identification.PRIOR: "no prior",
    identification.MANY_LEFT_OUT: "measure again",
    identification.LOST: "measure again",
    diagnostics.KNOWN_LENGTH: "measure again",
}
"""By the name of what stands against it, where that alone says it."""
FEW = {
    identification.UNTOLD,
    identification.TOO_FEW,
    identification.NOTHING_UNSEEN,
    diagnostics.EXTRAPOLATION,
}
"""What more shots tell."""
FREED = {"azimuths": "arm*.azimuth_deg", "reflector": "reflector_constant_mm"}
"""Parameters that have no place in any model, by the cause of a lack of fit."""
Held = Literal["", "identified", "form"]
After = Literal["", "worse", "fail", "not decided", "no limits", "pass"]


@dataclass(frozen=True, slots=True)
class NextStep:
    """Command to type next, and what has to be done by hand before it; empty: nothing."""

    command: tuple[str, ...]
    first: str = ""

    @property
    def text(self) -> str:
        """The command as it is typed."""
        return shlex.join(("pkmcal", *self.command))

    @property
    def says(self) -> str:
        """Both, on a line."""
        return f"{self.first}, then: {self.text}" if self.first else self.text


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignState:
    """State of a campaign, as far as the next step depends on it."""

    folder: str = "DIR"
    answered: bool = True
    """Whether the devices were asked who they are; a simulated cell need not be."""
    planned: bool = False
    before: bool = False
    """Whether the robot was validated before."""
    measured: Literal["", "run", "import"] = ""
    left: Literal["", "run", "anew"] = ""
    """Whether plan.csv has what is not measured yet, and takes a new series."""
    shots: int = 0
    """To identify from."""
    verdict: Decision | None = None
    """Of an identification from what was measured last."""
    way: Way = ""
    asked: tuple[str, ...] = ()
    """Options that the identification was asked for with."""
    detail: str = ""
    """Shots, parameter or figures of the way; reasons of the verdict after."""
    file: Literal["", "other", "identified"] = ""
    form: Literal["", "needed", "exported"] = ""
    """Plain parameters, of which a controller without plate tilt takes the file."""
    holds: Held = ""
    """What the controller holds by the latest load."""
    after: After = ""
    """Of what was identified last."""
    after_by: Literal["", "identified", "form", "targets"] = ""
    weak: bool = False
    """Whether a form breaks limits that corrected targets may keep."""
    by_targets: bool = False
    """Whether targets are corrected for a controller that keeps its parameters, or that was given
    them back."""
    reported: bool = False


def next_step(state: CampaignState) -> NextStep | None:
    """The next step; None where nothing is left to do."""
    here = state.folder
    if not state.measured:
        return _to_measure(state)
    if state.left:
        return NextStep(("run", here, *(["--anew"] if state.left == "anew" else [])))
    if state.verdict is None:
        return NextStep(("identify", here))
    if state.verdict != "pass":
        return _after_identification(state)
    return _to_calibrate(state) or _to_show(state)


def _to_measure(state: CampaignState) -> NextStep:
    here = state.folder
    if not state.planned and not state.answered:
        return NextStep(("devices", here), "look through campaign.yaml (tracker.place_mm!)")
    if not state.planned:
        return NextStep(("plan", here))
    if not state.before:
        return NextStep(("validate", here, "--stage", "before"))
    return NextStep(("run", here))


def _after_identification(state: CampaignState) -> NextStep:
    """The way on from a fit that must not be used, or of which nothing is decided."""
    here, detail = state.folder, state.detail
    by_hand = {
        "accept change": "look at units, joints and robot.yaml; if the robot is built so",
        "accept scale": "check the reflector's and the air's constants; if it is the robot",
        "set limits": "write what the robot must keep into campaign.yaml, "
        f"acceptance.distance_mean_mm and distance_max_mm (unseen pairs: {detail})",
        "widen limits": "mend what the diagnostics name, or widen acceptance.distance_mean_mm and "
        f"distance_max_mm in campaign.yaml (unseen pairs: {detail})",
        "measure again": "mend what the diagnostics name",
        "leave out": "leave out what was not measured, under space in campaign.yaml",
    }
    first = by_hand.get(state.way, "")
    more_shots = state.way == "more shots"
    if state.measured == "import" and (more_shots or state.way == "measure again"):
        wanted = (
            f"measure {2 * state.shots} shots all over the workspace"
            if more_shots
            else f"{first}, measure again"
        )
        return NextStep(("import", here, "FILE"), wanted)
    if more_shots:
        return NextStep(("plan", here, "--shots", str(2 * state.shots)))
    if state.way == "measure again":
        return NextStep(("run", here, "--anew"), first)
    without = {"larger model": "--model", "a part": "--shots", "no prior": "--prior"}
    more: dict[str, tuple[str, ...]] = {
        "own frames": ("--sessions",),
        "a part": ("--shots", detail),
        "accept change": (diagnostics.ACCEPT[diagnostics.LARGE_CHANGE],),
        "accept scale": (diagnostics.ACCEPT[diagnostics.COMMON_SCALE],),
        "hold": ("--fix", detail),
        "free": ("--free", detail),
        "keep unseen": ("--hold-out", "20%"),
        "larger model": ("--model", Model.AUTO.value),
    }
    kept = _without(without.get(state.way, ""), state.asked)
    return NextStep(("identify", here, *kept, *more.get(state.way, ())), first)


def _to_calibrate(state: CampaignState) -> NextStep | None:
    """Steps until the robot was measured with what was identified; None: it was."""
    here, imported = state.folder, state.measured == "import"
    after = ("validate", here, "--stage", "after")
    if state.file != "identified":
        return NextStep(("export", here, *(["--overwrite"] if state.file else [])))
    by_targets = state.weak or (state.by_targets and state.after_by != "targets")
    if state.holds and (by_targets or state.after == "worse"):
        return NextStep(("load", here, "--rollback"))
    if state.after == "worse":
        anew = ("import", here, "FILE") if imported else ("run", here, "--anew")
        return NextStep(anew, "look for what changed since the shots, and measure again")
    if by_targets and not imported:
        return NextStep((*after, "--by", "targets"))
    if state.after or state.holds:
        return None if state.after else NextStep(after)
    if imported:
        put = "put what export wrote into the controller, or correct targets, and measure pairs"
        return NextStep(("import", here, "FILE", "--stage", "after"), put)
    if state.form == "needed":
        return NextStep(("export", here, "--format", "plain"))
    return NextStep(("load", here, *(["--file", f"{here}/{PLAIN_FILE}"] if state.form else [])))


def _to_show(state: CampaignState) -> NextStep | None:
    report = ("report", state.folder)
    if not state.reported:
        return NextStep(report)
    by_hand = {
        "no limits": "write what the robot must keep into campaign.yaml, under acceptance",
        "not decided": "widen or leave out what is not decided, under acceptance in campaign.yaml "
        f"({state.detail})",
        "fail": "mend what breaks the limits, or widen them, under acceptance in campaign.yaml "
        f"({state.detail})",
    }
    first = by_hand.get(state.after)
    return None if first is None else NextStep(report, first)


def _without(option: str, words: Sequence[str]) -> tuple[str, ...]:
    """Words without an option and its value."""
    places = {place for place, word in enumerate(words) if word == option}
    gone = places | {place + 1 for place in places}
    return tuple(word for place, word in enumerate(words) if place not in gone)


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
    journal, campaign = evidence.journal, evidence.campaign
    every = journal.series if journal else ()
    runs = [
        each
        for each in every
        if each.shots
        and not each.of_known_lengths
        and (each.started.stage == "run" or (each.started.stage == "import" and each.finished))
    ]
    state = CampaignState(
        folder=str(campaign.folder),
        answered=answered or campaign.is_simulated,
        planned=evidence.plan is not None,
        before=bool(evidence.before),
        reported=reported,
    )
    if not runs:
        return state
    latest, found = runs[-1], evidence.identification
    purposes = [shot.intent.purpose for shot in latest.shots]
    measured = replace(
        state,
        measured="import" if latest.started.stage == "import" else "run",
        shots=purposes.count(ShotSet.IDENTIFICATION.value),
    )
    bars = [shot for each in every if each.of_known_lengths for shot in each.shots]
    if found is None or not _is_of(found, latest, bars, campaign.robot.digest()):
        return replace(measured, left=_left(evidence, latest))
    if _newly_planned(evidence, latest):
        return replace(measured, left="run")
    shots = evidence.run.shots if evidence.run else None
    numbers, sessions = (shots.numbers, shots.session.tolist()) if shots else ((), ())
    limits_mm = campaign.config.acceptance.distances_mm
    way, detail = way_on(found, measured.shots, limits_mm, numbers, sessions)
    judged = replace(measured, verdict=found.verdict, way=way, detail=detail, asked=found.asked)
    return judged if found.verdict != "pass" else _calibrated(evaluation, found, judged, held)


def _is_of(
    found: RecordedIdentification, latest: Series, bars: Sequence[AcceptedShot], nominal_digest: str
) -> bool:
    """Whether the identification is of all that counts of the latest series, and this robot.

    Known lengths that were measured beside it, `bars`, count too.
    """
    of_series = found.series == latest.number and found.robot_digest == nominal_digest
    counted = (*latest.shots, *bars)
    return of_series and all(shot.number <= found.journal_records for shot in counted)


def _left(evidence: Evidence, latest: Series) -> Literal["", "run", "anew"]:
    """Whether something of plan.csv is left to measure before anything is identified."""
    if latest.started.stage == "import" or evidence.plan is None:
        return ""
    if not latest.finished:
        other = plan_difference((shot.intent for shot in latest.shots), evidence.plan)
        return "anew" if other else "run"
    return "run" if _newly_planned(evidence, latest) else ""


def _newly_planned(evidence: Evidence, latest: Series) -> bool:
    """Whether plan.csv was made, or got further shots, since the latest series began."""
    plan, started = evidence.plan, latest.started
    digest = plan and plan_digest(plan, evidence.campaign.robot.mechanism)
    if plan is None or started.stage == "import" or started.plan_digest == digest:
        return False
    taken = [shot.intent for shot in latest.shots]
    further = {row.shot for row in plan} - {intent.shot for intent in taken}
    return bool(further or plan_difference(taken, plan))


def way_on(
    found: RecordedIdentification,
    shots: int,
    limits_mm: Mapping[str, float],
    numbers: Sequence[int],
    sessions: Sequence[int],
) -> tuple[Way, str]:
    """Way on by the first that stands against an identification, with its detail.

    `shots`: how many it was made from. Numbers and sessions, (N,) each, of all that were measured;
    limits are of distances, mean and max.
    """
    affecting = [each for each in found.doubts if each.affects_verdict]
    names = found.obstacles or tuple(each.name for each in affecting)
    if found.verdict == "pass" or not names:
        return ("" if found.verdict == "pass" else "identify again"), ""
    if names[0] == diagnostics.CHANGE:
        return _after_change(found, np.array(numbers), np.array(sessions))
    if names[0] in WAYS:
        return WAYS[names[0]], ""
    if names[0] in FEW:
        return _with_few_shots(found, names[0], shots)
    cause = next((each.numbers.get("cause") for each in affecting if each.name == names[0]), "")
    if (freed := FREED.get(str(cause), "")) and freed not in found.asked:
        return "free", freed
    return _past_a_lack(found, limits_mm)


def _with_few_shots(found: RecordedIdentification, name: str, shots: int) -> tuple[Way, str]:
    """Way on where the shots do not tell enough."""
    unseen = name == identification.NOTHING_UNSEEN and "--hold-out" not in found.asked
    if unseen and shots >= 2 * FEWEST_PAIRS:
        return "keep unseen", ""
    if shots < ENOUGH_SHOTS:
        return "more shots", ""
    if name == diagnostics.EXTRAPOLATION:
        return "leave out", ""
    if found.unobservable:
        return "hold", found.unobservable[0][0]
    return "measure again", ""


def _past_a_lack(found: RecordedIdentification, limits_mm: Mapping[str, float]) -> tuple[Way, str]:
    """Way on where the model lacks something: a larger one, or limits that are kept without it."""
    if found.model not in {Model.AUTO, Model.EXTENDED}:
        return "larger model", ""
    if found.verdict == "fail" or found.unseen_mm is None:
        return "measure again", ""
    reached = found.unseen_mm.after
    if diagnostics.limits_met(reached, limits_mm):
        return "identify again", ""
    detail = f"mean {reached.mean_abs:.3f}, largest {reached.max_abs:.3f} mm"
    return ("widen limits" if limits_mm else "set limits"), detail


def _after_change(
    found: RecordedIdentification, numbers: Index, sessions: Index
) -> tuple[Way, str]:
    """Way on after a change between two shots: frames of their own, or the larger part alone."""
    changes = (each for each in found.doubts if each.name == diagnostics.CHANGE)
    told = next((each for each in changes if each.affects_verdict), None)
    if told is None or not len(numbers) or "--shots" in found.asked:
        return "measure again", ""
    early = numbers < float(told.numbers["before_shot"])
    apart = {*sessions[early].tolist()}.isdisjoint(sessions[~early].tolist())
    if told.numbers["kind"] == "frame" and "--sessions" not in found.asked and apart:
        return "own frames", ""
    if told.numbers["kind"] == "drift" or max(early.sum(), (~early).sum()) < 4 * FEWEST_PAIRS:
        return "measure again", ""
    if early.sum() >= (~early).sum():
        return "a part", f"-{numbers[early].max()}"
    return "a part", f"{numbers[~early].min()}-"


def _calibrated(
    evaluation: Evaluation,
    found: RecordedIdentification,
    state: CampaignState,
    held: ControllerState | None,
) -> CampaignState:
    """State after an identification that passed: file, controller, validation."""
    evidence = evaluation.evidence
    space, journal = evidence.campaign.robot.mechanism.parameters, evidence.journal
    identified = Parameters.of(space, found.flat())
    digest, file, loaded = identified.digest(), evidence.parameter_file, evidence.loaded
    every = [each.started.lacks for each in (journal.series if journal else ())]
    lacks = next((each for each in reversed(every) if each is not None), None)
    too_few = bool({*(lacks or ())} & {*identified.extended_by})
    forms = evidence.sets.forms.values() if evidence.sets else ()
    has_form = any(each.of == digest for each in forms) and (too_few or lacks is None)
    held = held or evidence.state(loaded.digest if loaded else None)
    after = evidence.held("after")
    kinds: dict[str, Held] = {"identified": "identified", "form": "form"}
    judged = after is not None and after.origin == digest
    verdict = evaluation.validated("after")
    decided: After = "worse" if verdict.worse else verdict.decision or "no limits"
    by_form = judged and after is not None and after.kind == "form" and not after.targets
    missed = [
        each.error for each in verdict.requirements if each.decision in {"fail", "not decided"}
    ]
    weak = bool(verdict.beyond) or any(error is not None for error in missed)
    holds = kinds.get(held.kind, "") if held and held.origin == digest else ""
    taken_back = loaded is not None and loaded.rolls_back is not None
    targets = evidence.written is not None and evidence.written.by == "targets"
    return replace(
        state,
        file="" if file is None else "identified" if file.digest() == digest else "other",
        form="exported" if has_form else "needed" if too_few else "",
        holds=holds,
        detail="; ".join(verdict.reasons),
        after=decided if judged else "",
        weak=by_form and weak,
        by_targets=not holds and (taken_back or targets),
        after_by=""
        if not after or not judged
        else "targets"
        if after.targets
        else kinds[after.kind],
    )
