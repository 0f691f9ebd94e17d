"""Next step: the one command that a campaign's evidence asks for, whatever it has reached.

Pure. A step changes the state that it follows from, so that no advice leads back.
"""

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import pairwise
from statistics import median
from typing import Literal

from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.export import FORMS, PLAIN, PLAIN_FILE, form_options, forms_taken
from campaigns.estimation.estimators import Estimator, Model
from campaigns.evaluation import diagnostics, identification
from campaigns.evaluation.decision import Decision
from campaigns.evaluation.summary import Spread
from campaigns.evidence import Evaluation, Evidence
from campaigns.identification.checking import StoredCalibration
from campaigns.identification.result import RecordedIdentification
from campaigns.journal.views import Series
from campaigns.mechanisms.parameters import Parameters
from campaigns.planning.plan_match import plan_difference
from campaigns.shots.shot_sets import ShotSet

ENOUGH_SHOTS = 240
"""Number of shots to identify from, beyond which more tell nothing new."""
FEWEST_SHOTS = 40
"""Number of shots from which a part can be identified alone, or some pairs be kept unseen."""
FEW = {
    identification.UNTOLD,
    identification.TOO_FEW,
    identification.NOTHING_UNSEEN,
    diagnostics.EXTRAPOLATION,
}
"""Names of doubts that more shots settle."""
AGAIN = {
    diagnostics.KNOWN_LENGTH,
    identification.MANY_LEFT_OUT,
    identification.LOST,
    identification.REPAIR,
}
"""Names of doubts that only another measurement settles."""
TAKEN = {
    diagnostics.LARGE_CHANGE: "look at units, joints and robot.yaml; if the robot is built so",
    diagnostics.COMMON_SCALE: "check the reflector's and the air's constants; if it is the robot",
}
"""What to do before a doubt is accepted."""
FREED = {"reflector": "reflector_constant_mm"}
"""Parameters that are in no model, by the cause of a lack of fit."""
SELECTION = {"--estimator", "--model", "--free", "--fix"}
"""Options that say what is to be found, which stay for further shots."""
MEND = "mend what the diagnostics name"
Held = Literal["", "identified", "form"]
Answer = Literal["", "repair", "firm", "again", "anew"]
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
        """What to do first and the command, in one line."""
        return f"{self.first}, then: {self.text}" if self.first else self.text


@dataclass(frozen=True, slots=True)
class WayOn:
    """Way on from an identification that is not decided, and what it costs."""

    by: Literal["model", "limits", "shots"]
    step: NextStep
    cost: str

    @property
    def document(self) -> dict[str, str]:
        """The way for programs."""
        return {"by": self.by, "next": self.step.text, "before": self.step.first, "cost": self.cost}

    @property
    def says(self) -> str:
        """The way and its cost in a line."""
        return f"by {self.by}: {self.step.says} ({self.cost})"


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignState:
    """State of a campaign, as far as the next step depends on it."""

    folder: str = "DIR"
    words: tuple[str, ...] = ()
    """Options for run and identify."""
    answered: bool = True
    """Whether the devices were asked who they are; a simulated cell need not be."""
    offline: bool = False
    """Whether nothing is connected: what a command would measure is imported."""
    program: str = ""
    """Language of the program of plan.csv; of an offline campaign."""
    program_after: bool = False
    """Whether there is one for what was exported last."""
    planned: bool = False
    before: bool = False
    """Whether the robot was validated before."""
    measured: Literal["", "run", "import"] = ""
    left: Literal["", "run", "anew"] = ""
    """Whether plan.csv has what is not measured yet, and takes a new series."""
    verdict: Decision | None = None
    """Of an identification from what was measured last."""
    way_on: NextStep | None = None
    """Next step after an identification that did not pass."""
    ways: tuple[WayOn, ...] = ()
    """All ways on from one that is not decided."""
    check: Answer = ""
    """What answers a check of it that is not good: its repair, a firm stand, a check of what was
    identified meanwhile, or a new campaign."""
    file: Literal["", "other", "identified"] = ""
    form: Literal["", "needed", "exported"] = ""
    """Plain parameters, of which a controller without plate tilt takes the file."""
    form_file: str = PLAIN_FILE
    """The form's, in the campaign's folder."""
    form_options: tuple[str, ...] = FORMS[PLAIN][1]
    """Options of `export` for the form that is needed."""
    holds: Held = ""
    """What the controller holds."""
    after: After = ""
    """Verdict on the robot with what was identified last."""
    reasons: str = ""
    """What stands against it."""
    weak: bool = False
    """Whether a form breaks limits that corrected targets may keep."""
    to_correct: bool = False
    """Whether targets are to be corrected, for a controller that keeps its parameters or was given
    them back, and nothing was validated with them."""
    reported: bool = False


def next_step(state: CampaignState) -> NextStep | None:
    """The next step; None where nothing is left to do."""
    here = state.folder
    if not state.measured:
        return _to_measure(state)
    if state.left:
        anew = ["--anew"] if state.left == "anew" else []
        return NextStep(("run", here, *anew, *state.words))
    if state.verdict is None:
        return NextStep(("identify", here, *state.words))
    return state.way_on or _to_answer_a_check(state) or _to_calibrate(state) or _to_show(state)


def _to_measure(state: CampaignState) -> NextStep:
    here, look = state.folder, "look through campaign.yaml (tracker.place_mm!)"
    if not state.planned and not state.answered and not state.offline:
        return NextStep(("devices", here), look)
    if not state.planned:
        return NextStep(("plan", here), look if state.offline else "")
    if state.offline and not state.program:
        return NextStep(("plan", here, "--program", "LANGUAGE"))
    if state.offline and not state.before:
        first = "run program-before on the controller, and measure at each of its stops"
        return NextStep(("import", here, "FILE", "--stage", "before"), first)
    if state.offline:
        first = "run program-run on the controller, and measure at each of its stops"
        return NextStep(("import", here, "FILE"), first)
    if not state.before:
        return NextStep(("validate", here, "--stage", "before"))
    return NextStep(("run", here, *state.words))


def _to_answer_a_check(state: CampaignState) -> NextStep | None:
    check = ("check", state.folder)
    steps = {
        "repair": NextStep((*check, "--repair")),
        "firm": NextStep(check, "make the tracker's stand firm"),
        "again": NextStep(check),
        "anew": _measured_anew(state),
    }
    return steps.get(state.check)


def _measured_anew(state: CampaignState) -> NextStep:
    here, imported = state.folder, state.measured == "import"
    anew = ("import", here, "FILE") if imported else ("run", here, "--anew")
    return NextStep(anew, "look for what changed since the shots, and measure again")


def _to_calibrate(state: CampaignState) -> NextStep | None:
    """Steps until the robot was measured with what was identified; None: it was."""
    here, imported = state.folder, state.measured == "import"
    after = ("validate", here, "--stage", "after")
    if state.file != "identified":
        return NextStep(("export", here, *(["--overwrite"] if state.file else [])))
    by_targets = state.weak or state.to_correct
    if state.holds and (by_targets or state.after == "worse"):
        return NextStep(("load", here, "--rollback"))
    if state.after == "worse":
        return _measured_anew(state)
    if by_targets and not imported:
        return NextStep((*after, "--by", "targets"))
    if state.after or state.holds:
        return None if state.after else NextStep(after)
    if state.program and not state.program_after:
        return NextStep(("plan", here, "--program", state.program, "--stage", "after"))
    if imported:
        put = "put the exported file into the controller, or correct the targets, and measure pairs"
        return NextStep(("import", here, "FILE", "--stage", "after"), put)
    if state.form == "needed":
        return NextStep(("export", here, *state.form_options))
    return NextStep(
        ("load", here, *(["--file", f"{here}/{state.form_file}"] if state.form else []))
    )


def _to_show(state: CampaignState) -> NextStep | None:
    report = ("report", state.folder)
    if not state.reported:
        return NextStep(report)
    there = "under acceptance in campaign.yaml"
    by_hand = {
        "no limits": f"set the limits that must be met, {there}",
        "not decided": f"widen or remove the limits that are not decided, {there} "
        f"({state.reasons})",
        "fail": f"mend what breaks the limits, or widen them, {there} ({state.reasons})",
    }
    first = by_hand.get(state.after)
    return None if first is None else NextStep(report, first)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Unusable:
    """Identification that did not pass, with what the way on from it depends on.

    `shots`: how many it was made from. Sessions, by number, of all shots that were measured; limits
    are of distances, mean and max.
    """

    found: RecordedIdentification
    shots: int
    limits_mm: Mapping[str, float] = field(default_factory=dict)
    sessions: Mapping[int, int] = field(default_factory=dict)
    folder: str = "DIR"
    imported: bool = False
    """Whether further shots are imported too."""
    shot_s: float | None = None
    """Time that a shot took; None where nobody knows."""

    def ways_on(self) -> Iterator[WayOn]:
        """Ways on with what each would cost: a larger model, limits, more shots."""
        found, unseen = self.found, self.found.unseen_mm
        if found.model not in {Model.AUTO, Model.EXTENDED}:
            larger = self._identify("--model", Model.AUTO.value, without="--model")
            yield WayOn("model", larger, "no new shot, some seconds")
        if unseen is not None and found.verdict == "not decided":
            yield WayOn("limits", self._by_limits(unseen.after), "no new shot, if these will do")
        if self.shots < ENOUGH_SHOTS and not self.imported:
            more = NextStep(("plan", self.folder, "--shots", str(2 * self.shots)))
            took = "" if self.shot_s is None else f", about {self.shot_s * self.shots / 60:.0f} min"
            halved = "σ falls to about 0.7 of what it is"
            yield WayOn("shots", more, f"{self.shots} more shots{took}; {halved}")

    def way_on(self) -> NextStep:
        """Next step by the first that stands against it."""
        found = self.found
        affecting = [each for each in found.doubts if each.affects_verdict]
        name = next(iter(found.obstacles or [each.name for each in affecting]), "")
        numbers = next((each.numbers for each in affecting if each.name == name), {})
        freed = FREED.get(str(numbers.get("cause")), "")
        if name == identification.PRIOR or not name:
            return self._identify(without="--prior" if name else "")
        if name in TAKEN:
            return self._identify(diagnostics.ACCEPT[name], first=TAKEN[name])
        if name in AGAIN:
            return self._measure(MEND)
        if name in FEW or (name == diagnostics.CHANGE and found.verdict == "not decided"):
            return self._with_few_shots(name)
        if name == diagnostics.CHANGE:
            at = float(numbers.get("before_shot", 0.0))
            return self._after_change(str(numbers.get("kind")), at)
        if numbers.get("cause") == "backlash" and Estimator.DISTANCES.value in found.asked:
            return self._identify(without="--estimator")  # all coordinates tell what gears lose
        if freed and freed not in found.asked:
            return self._identify("--free", freed)
        return self._past_a_lack()

    def _identify(self, *more: str, without: str = "", first: str = "") -> NextStep:
        """Identification with the options of this one, but one, and more."""
        words = self.found.asked
        gone = {place for place, word in enumerate(words) if word == without}
        kept = [word for place, word in enumerate(words) if not {place, place - 1} & gone]
        return NextStep(("identify", self.folder, *kept, *more), first)

    def _measure(self, first: str) -> NextStep:
        if self.imported:
            return NextStep(("import", self.folder, "FILE"), f"{first}, measure again")
        return NextStep(("run", self.folder, "--anew"), first)

    def _with_few_shots(self, name: str) -> NextStep:
        """Way on where the shots do not tell enough."""
        if "--weights" in self.found.asked:  # equal ones tell no σ of few
            return self._identify(without="--weights")
        unseen = name == identification.NOTHING_UNSEEN and "--hold-out" not in self.found.asked
        if unseen and self.shots >= FEWEST_SHOTS:
            return self._identify("--hold-out", "20%")
        if self.shots < ENOUGH_SHOTS and self.imported:
            pairs = ", with pairs of the set validation" if unseen else ""
            many = f"measure {2 * self.shots} shots all over the workspace{pairs}"
            return NextStep(("import", self.folder, "FILE"), many)
        if self.shots < ENOUGH_SHOTS:
            return NextStep(("plan", self.folder, "--shots", str(2 * self.shots)))
        if name == diagnostics.EXTRAPOLATION:
            space = "leave out what was not measured, under space in campaign.yaml"
            return self._identify(first=space)
        lost = self.found.unobservable
        return self._identify("--fix", lost[0][0]) if lost else self._measure(MEND)

    def _after_change(self, kind: str, at: float) -> NextStep:
        """Way on after a change: frames of their own, or the larger part of the shots alone."""
        asked, sessions = self.found.asked, self.sessions
        early = [number for number in sessions if number < at]
        late = [number for number in sessions if number >= at]
        apart = not {sessions[number] for number in early} & {sessions[number] for number in late}
        if kind == "frame" and "--sessions" not in asked and early and late and apart:
            return self._identify("--sessions")
        if kind == "drift" or "--shots" in asked or max(len(early), len(late)) < FEWEST_SHOTS:
            return self._measure(MEND)
        part = f"-{max(early)}" if len(early) >= len(late) else f"{min(late)}-"
        return self._identify("--shots", part)

    def _past_a_lack(self) -> NextStep:
        """Way on where the model lacks something: a larger one, or limits kept without it."""
        found, unseen = self.found, self.found.unseen_mm
        if found.model not in {Model.AUTO, Model.EXTENDED}:
            return self._identify("--model", Model.AUTO.value, without="--model")
        if found.verdict == "fail" or unseen is None:
            return self._measure(MEND)
        return self._by_limits(unseen.after)

    def _by_limits(self, reached: Spread) -> NextStep:
        """Identification again once the limits are such as hold-out pairs keep."""
        if diagnostics.limits_met(reached, self.limits_mm):
            return self._identify()
        figures = f"mean {reached.mean_abs:.3f}, largest {reached.max_abs:.3f} mm"
        limits = f"acceptance.distance_mean_mm and distance_max_mm (hold-out pairs: {figures})"
        if self.limits_mm:
            return self._identify(first=f"{MEND}, or widen {limits} in campaign.yaml")
        return self._identify(first=f"set the limits that must be met in campaign.yaml: {limits}")


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
    bars = [shot for each in every if each.of_known_lengths for shot in each.shots]
    runs = [each for each in every if each.to_identify]
    state = CampaignState(
        folder=str(campaign.folder),
        words=_words(evidence),
        answered=answered or campaign.is_simulated,
        offline=campaign.is_offline,
        program=evidence.programs.get("run", "") if campaign.is_offline else "",
        program_after=bool(evidence.programs.get("after")),
        planned=evidence.plan is not None,
        before=bool(evidence.before),
        reported=reported,
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
    shots = evidence.run.shots if evidence.run else None
    purposes = [shot.intent.purpose for shot in latest.shots]
    unusable = Unusable(
        found=found,
        shots=purposes.count(ShotSet.IDENTIFICATION.value),
        limits_mm=campaign.config.acceptance.distances_mm,
        sessions=dict(zip(shots.numbers, shots.session.tolist(), strict=True)) if shots else {},
        folder=state.folder,
        imported=imported,
        shot_s=_shot_seconds(latest),
    )
    ways = tuple(unusable.ways_on())
    return replace(state, verdict=found.verdict, way_on=unusable.way_on(), ways=ways)


def _to_answer(evidence: Evidence, found: RecordedIdentification) -> Answer:
    """What answers a check that is not good."""
    check = evidence.unanswered
    if check is None:
        return ""
    stored = StoredCalibration(evidence.campaign.robot.kinematics, found)
    if check.of != stored.kinematics.parameters.digest():
        return "again"
    if check.decision == "not decided":
        return "firm"
    return "repair" if stored.can_repair(check) else "anew"


def _words(evidence: Evidence) -> tuple[str, ...]:
    """Options, as typed, that say what is to be found: of the last identification or a new plan."""
    found, plan, run = evidence.identification, evidence.plan, evidence.run
    is_import = run is not None and run.series.started.imported  # by no plan
    if plan and (found is None or is_import or not evidence.has_plan(found.plan_digest)):
        return plan[0].asked
    asked = found.asked if found else ()
    pairs = zip(asked, ("", *asked), strict=False)
    return tuple(word for word, before in pairs if {word, before} & SELECTION)


def _shot_seconds(series: Series) -> float | None:
    """Median time from a shot to the next; None for too few."""
    at = sorted(
        datetime.fromisoformat(shot.measured_utc) for shot in series.shots if shot.measured_utc
    )
    gaps = [(after - before).total_seconds() for before, after in pairwise(at)]
    return median(gaps) if gaps else None


def _left(evidence: Evidence, latest: Series) -> Literal["", "run", "anew"]:
    """Whether something of plan.csv is left to measure: of this series, or of a newer plan."""
    plan, started = evidence.plan, latest.started
    if plan is None:
        return ""
    taken = [shot.intent for shot in latest.shots]
    other = plan_difference(taken, plan)
    if not latest.finished:
        return "anew" if other else "run"
    further = {row.shot for row in plan} - {intent.shot for intent in taken}
    is_same = not (other or further) or evidence.has_plan(started.plan_digest)
    return "" if is_same else "run"


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
    digest, loaded = identified.digest(), evidence.loaded
    every = [each.started.lacks for each in (journal.series if journal else ())]
    lacks = next((each for each in reversed(every) if each is not None), None)
    lacking = {*(lacks or ())} & {*identified.extended_by}
    own = [each for each in evidence.forms if each.projection and each.projection.of == digest]
    taken = next((each for each in own if not any(each.wanted.get(n) for n in lacking)), None)
    # axes took tables where somebody wrote any: else the form that every controller takes
    fullest = any(each.projection and each.projection.name != PLAIN for each in own)
    form = [*forms_taken(space, lacking)][0 if fullest else -1]
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
        form_options=form_options(form, {each.file: each.tables for each in evidence.forms}),
        holds=holds,
        after=decided if after else "",
        reasons="; ".join(verdict.reasons),
        weak=weak and after is not None and after.kind == "form" and not by_targets,
        to_correct=not holds and not by_targets and (taken_back or corrected),
    )
