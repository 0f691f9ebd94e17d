"""Next step: the state of a campaign by its evidence, and the one command that follows from it."""

# `state_of` reduces the evidence to a flat state of some twenty words and truth values. `next_step`
# is a pure function of this state: it takes the first row of `ROWS` that applies. The order of the
# rows is the order of a campaign's work: look, plan, validate before, run, identify, check, export,
# load, validate after, report. A row may therefore rely on no earlier one applying.
#
# The command of each row changes what made the row apply, so that no advice leads in a circle. A
# test walks all outcomes of each command from an empty folder to the end. Where no command can
# change the state, as with limits that are not met, the row says first what to do by hand.
#
# A row names a command without options that overrule or that a file asks for: those are added by
# the command's own checks (`workflow/next_hint.py`), which know best what would be refused.
#
# Options that an operator typed earlier are not repeated: what was right for one identification may
# be wrong for the next. A plan that has to be made again is the exception, for without its options
# it would be another campaign.

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Literal

from campaigns.assessment import Evaluation
from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.delta_firmware import has_firmware
from campaigns.controllers.export import FILE_NAME
from campaigns.evaluation.decision import NO_LIMIT, Decision
from campaigns.evidence import REPORT_FILE, Evidence, joints_path
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.identification import findings
from campaigns.identification.determined import ON_PLANE
from campaigns.identification.result import WITHOUT_SHOTS, RecordedIdentification
from campaigns.journal.records import Event
from campaigns.journal.views import Series
from campaigns.kinematics.parameters import Parameters
from campaigns.measuring.monitors import WRONG_PLACE
from campaigns.planning.plan_file import PlannedShot, plan_difference
from campaigns.shots.import_export import ImportedFile, imported_files
from campaigns.shots.observations_csv import FILE_NAME as OBSERVATIONS
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import OF_SESSIONS
from drivers.bounded_files import is_file
from drivers.texts import as_word, quoted

LOOK = "look through campaign.yaml (tracker.place_mm!)"
LOOK_OFFLINE = f"{LOOK}, or state under objects what is measured without a tracker"
OBSERVE = (
    "measure what stands under objects in campaign.yaml, and save it as observations.csv, a row "
    "for each value"
)
MEASURE = (
    "run program-{0} on the controller, measure at each of its stops, save that as {0}.txt in mm"
)
COVER = (
    "poses are needed there; else leave that space out (`space` in campaign.yaml), and identify "
    "again"
)
CHANGED = "look for what changed since the shots, and measure again"
OTHER_LIMITS = "agree other limits with the customer ({reasons})"


@dataclass(frozen=True, slots=True)
class NextStep:
    """Next step of a campaign: a command, and what to do by hand before it."""

    words: tuple[str, ...]
    """Command and its words, the campaign's folder the second of them; no shell's quotes yet."""
    first: str = ""
    """What to do by hand before the command; may be empty."""
    why: str = ""
    """Reason why the command is next; empty where it is evident."""

    @property
    def text(self) -> str:
        """Command as it is typed."""
        words = (word if word.startswith("--") else quoted(word) for word in self.words)
        return " ".join(("pkmcal", *words))

    @property
    def before(self) -> str:
        """What to do first and the reason, as far as there are any."""
        return f"{self.first} ({self.why})" if self.first and self.why else self.first or self.why

    @property
    def says(self) -> str:
        """What to do first, the reason and the command, as one sentence."""
        return f"{self.before}, then: {self.text}" if self.before else self.text

    @property
    def lines(self) -> Iterator[str]:
        """Lines for a terminal; the command ends the last one, so that it can be copied."""
        if self.before:
            yield f"{'first' if self.first else 'because'}: {self.before}"
        yield f"next: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignState:
    """State of a campaign, as far as the next step depends on it."""

    folder: str = "DIR"
    worker: str = ""
    """Description of the process that works on the campaign now; empty: none does."""
    simulated: bool = False
    offline: bool = False
    """Whether no device is connected: shots are imported."""
    program: bool = False
    """Whether an offline campaign has a program of plan.csv."""
    program_after: bool = False
    """Whether there is a program with the parameters that were exported last."""
    answered: bool = False
    """Whether both devices answered just now."""
    planned: bool = False
    to_observe: bool = False
    """Whether observations are planned alone, without shots, and still have no values."""
    plan_options: tuple[str, ...] = ()
    """Options that plan.csv was made with, as words."""
    misplaced: str = ""
    """Place where the shots found the tracker, in words; empty if campaign.yaml agrees."""
    before: bool = False
    """Whether the robot was validated before calibration."""
    objects: bool = False
    """Whether campaign.yaml has objects that are measured without a tracker."""
    measured: Literal["", "run", "import", "observations"] = ""
    """Source of the latest shots to identify from; empty: there are none.

    `observations` are of other kinds than points, and no tracker has measured any point."""
    stations: bool = False
    """Whether the latest import was measured from several stations of the tracker."""
    imported: str = "FILE"
    """Name of the file that was imported last."""
    unmeasured: bool = False
    """Whether a run has still to measure shots of plan.csv."""
    verdict: Decision | None = None
    """Decision on an identification of the latest shots; None: they are not identified."""
    remedy: str = ""
    """Command that answers an identification that did not pass; empty: measure again."""
    remedy_first: str = ""
    """What to do by hand before that command."""
    check: Literal["", "again", "update", "anew"] = ""
    """Answer to a check that did not pass: another check, an update by its shots, new shots."""
    to_export: Literal["", "yaml", "plain", "klipper"] = ""
    """Missing file: with all parameters, with those that the controller has, or a firmware's."""
    file: str = FILE_NAME
    """Robot file to load, in the campaign's folder."""
    holds: bool = False
    """Whether the controller holds the identified set, or a form of it."""
    plain: bool = False
    """Whether the robot was validated with a form that has fewer parameters."""
    after: str = ""
    """Verdict on the robot with the latest identification, or "worse"; empty: not validated."""
    reasons: str = ""
    """Reasons against that verdict."""
    by_targets: bool = False
    """Whether corrected targets have to be validated: some were written, or a load rolled back."""
    reported: bool = False
    """Whether there is a report of this state."""


@dataclass(frozen=True, slots=True)
class Row:
    """Row of the table of next steps; `next_step` fills in the words in braces."""

    applies: Callable[[CampaignState], bool]
    """Whether the row applies to a state, given that no earlier row does."""
    command: str
    first: str = ""
    """What to do by hand before the command; may be empty."""
    why: str = ""
    """Reason why the command is next; may be empty."""


ROWS = (
    # another process works on the campaign: every other command would be refused
    Row(
        lambda s: bool(s.worker),
        "status {folder}",
        "wait, or follow with `pkmcal watch {folder}`",
        "{worker} works on this campaign",
    ),
    Row(lambda s: s.to_observe and not (s.measured or s.offline), "run {folder}"),
    # set up and plan
    Row(
        lambda s: bool(s.misplaced) and (not s.measured or s.unmeasured),
        "plan {folder} {plan_options}",
        "set tracker.place_mm in campaign.yaml ({misplaced})",
    ),
    Row(
        lambda s: s.to_observe and not s.measured,
        "import {folder} {to_fill}",
        "measure what {to_fill} plans, and fill in its values",
    ),
    Row(
        lambda s: not (s.planned or s.measured) and s.offline and s.objects,
        "import {folder} observations.csv",
        OBSERVE,
    ),
    Row(lambda s: not (s.planned or s.measured) and s.offline, "plan {folder}", LOOK_OFFLINE),
    Row(lambda s: not (s.planned or s.measured or s.simulated), "plan {folder}", f"{LOOK}{{ask}}"),
    Row(lambda s: not (s.planned or s.measured), "plan {folder}"),
    # measure: an offline campaign by programs and imports, any other by validate and run
    Row(lambda s: not (s.measured or s.program) and s.offline, "plan {folder} --program csv"),
    Row(
        lambda s: not (s.measured or s.before) and s.offline,
        "import {folder} before.txt --stage before --unit mm",
        MEASURE.format("before"),
    ),
    Row(
        lambda s: not s.measured and s.offline,
        "import {folder} run.txt --unit mm",
        MEASURE.format("run"),
    ),
    Row(lambda s: not (s.measured or s.before), "validate {folder} --stage before"),
    Row(lambda s: not s.measured or s.unmeasured, "run {folder}"),
    # identify, until an identification of the latest shots passes and no check contradicts it
    Row(lambda s: s.verdict is None and s.stations, f"identify {{folder}} {OF_SESSIONS}"),
    Row(lambda s: s.verdict is None, "identify {folder}"),
    Row(lambda s: s.verdict != "pass", "{remedy}", "{remedy_first}"),
    Row(
        lambda s: s.check == "again" and s.offline,
        "import {folder} check.txt --stage check",
        "`pkmcal plan {folder} --program csv --stage check`, " + MEASURE.format("check"),
    ),
    Row(lambda s: s.check == "again", "check {folder}"),
    Row(lambda s: s.check == "update", "identify {folder} --update"),
    Row(lambda s: s.check == "anew", "{again}", CHANGED),
    # the robot became worse, or the plain form is not good enough: back to nominal parameters
    Row(
        lambda s: s.after == "worse" and s.holds,
        "load {folder} --rollback",
        why="the robot became worse by what it was loaded with",
    ),
    Row(lambda s: s.after == "worse", "{again}", CHANGED),
    Row(
        lambda s: s.after in {"fail", "not decided"} and s.holds and s.plain,
        "load {folder} --rollback",
        why="corrected targets may meet the limits that the plain form does not",
    ),
    # bring the identified set to the controller, and validate the robot with it
    Row(
        lambda s: s.by_targets and s.measured == "run",
        "validate {folder} --stage after --by targets",
    ),
    Row(
        lambda s: s.to_export == "plain" and not s.after,
        "export {folder} --format plain",
        why="the controller does not accept all parameters",
    ),
    Row(lambda s: s.to_export == "klipper", "export {folder} --format klipper"),
    Row(lambda s: s.to_export == "yaml", "export {folder}"),
    Row(
        lambda s: not s.after and s.program and not s.program_after,
        "plan {folder} --program csv --stage after",
    ),
    Row(
        lambda s: not s.after and s.measured == "import",
        "import {folder} after.txt --stage after --unit mm",
        "put the exported file into the controller, or correct the targets; measure pairs, and "
        "save them as after.txt in mm",
    ),
    # without a tracker nothing validates but new observations, which are identified by themselves
    Row(
        lambda s: s.measured == "observations" and not s.reported and s.offline,
        "report {folder}",
        "put {exported} into the controller",
    ),
    Row(
        lambda s: not (s.after or s.holds or (s.measured == "observations" and s.offline)),
        "load {folder} {robot}",
    ),
    Row(lambda s: not s.after and s.measured != "observations", "validate {folder} --stage after"),
    # report; what follows needs a decision of people, after which the report is made again
    Row(lambda s: not s.reported, "report {folder}"),
    Row(
        lambda s: s.after == NO_LIMIT,
        "report {folder}",
        "set the limits that must be met, under acceptance in campaign.yaml",
    ),
    Row(
        lambda s: s.after == "not decided",
        "report {folder}",
        f"Conformity not shown. Measure with a smaller U, or {OTHER_LIMITS}",
    ),
    Row(
        lambda s: s.after == "fail",
        "report {folder}",
        f"Limits not met. Mend the robot, or {OTHER_LIMITS}",
    ),
)


def next_step(state: CampaignState) -> NextStep | None:
    """Return the next step by the first row that applies; None if nothing remains to be done."""
    row = next((row for row in ROWS if row.applies(state)), None)
    if row is None:
        return None
    again = "run {folder} --anew"
    if state.measured != "run":
        again = "import {folder} {imported} --force"
    command = row.command.replace("{remedy}", state.remedy or again).replace("{again}", again)
    robot, to_fill = (as_word(f"{state.folder}/{name}") for name in (state.file, OBSERVATIONS))
    words = {
        "{folder}": (as_word(state.folder),),
        "{imported}": (as_word(state.imported),),
        "{plan_options}": state.plan_options,
        "{robot}": () if state.file == FILE_NAME else ("--robot", robot),
        "{to_fill}": (to_fill,),
    }
    folder = quoted(state.folder)
    said = {
        "folder": folder,
        "ask": "" if state.answered else f"; `pkmcal devices {folder}` asks both devices",
        "to_fill": quoted(to_fill),
        "exported": state.file,
        "remedy_first": state.remedy_first,
        "worker": state.worker,
        "misplaced": state.misplaced,
        "reasons": state.reasons,
    }
    first, why = (text.format_map(said) for text in (row.first, row.why))
    typed = chain.from_iterable(words.get(word, (word,)) for word in command.split())
    return NextStep(tuple(typed), first, why)


def state_of(
    evaluation: Evaluation, *, reported: bool | None = None, held: ControllerState | None = None
) -> CampaignState:
    """Return the state of a campaign by its evidence.

    `reported` says whether the command that ends has made a report; None: report.html decides.
    `held` is the state of a controller that was read just now; None: the latest load or validation
    decides.
    """
    # In the order of a campaign: each part returns the state so far as soon as something is missing
    # on which the later parts rest, so that these keep their defaults.
    evidence = evaluation.evidence
    campaign, identification = evidence.campaign, evidence.identification
    series = evidence.journal.series if evidence.journal else ()
    runs = [each for each in series if each.to_identify]
    state = CampaignState(
        folder=str(campaign.folder),
        simulated=campaign.is_simulated,
        offline=campaign.is_offline,
        program=campaign.is_offline and evidence.has_program,
        program_after=evidence.program_after,
        planned=bool(runs) or evidence.plan is not None,
        to_observe=evidence.plans_observations and not evidence.plan,
        plan_options=evidence.plan_options,
        misplaced=_misplaced(evidence),
        objects=bool(campaign.config.objects),
        before=any(measured.series.finished for measured in evidence.before),
        reported=_is_reported(evidence) if reported is None else reported,
    )
    observations = evidence.observations
    is_observed = bool(observations.files) and (campaign.is_offline or evidence.plan is None)
    if not (runs or is_observed):
        return state
    if runs:
        latest, number = runs[-1], runs[-1].number
        is_imported = campaign.is_offline or latest.started.stage == "import"
        state = replace(
            state,
            measured="import" if is_imported else "run",
            stations=is_imported and len({shot.session for shot in latest.shots}) > 1,
            imported=next((file.name for file in imported_files(latest.started)), "FILE"),
            unmeasured=not is_imported and _lacks_shots(evidence, latest),
        )
        shots = latest.shots
    else:
        number, shots = WITHOUT_SHOTS, ()
        state = replace(state, measured="observations", imported=observations.latest)
    known_lengths = (shot for each in series if each.of_known_lengths for shot in each.shots)
    last_record = max([observations.record, *(s.number for s in (*shots, *known_lengths))])
    # an identification counts only for these shots, this nominal robot and these settings
    if (
        identification is None
        or identification.provenance.series != number
        or identification.provenance.robot_digest != campaign.robot.digest()
        or identification.provenance.journal_records < last_record
        or campaign.outdated(identification)
    ):
        return state
    if (verdict := identification.judgement.verdict) != "pass":
        remedy, first = remedy_for(identification)
        state = replace(state, verdict=verdict, remedy=remedy, remedy_first=first)
        obstacle = next(iter(identification.judgement.obstacles), "")
        is_to_cover = bool(runs) and obstacle == findings.EXTRAPOLATION
        return _with_poses_to_cover(evidence, runs[-1], state) if is_to_cover else state
    identified = identification.value.parameter_set(campaign.robot.mechanism)
    state = replace(state, verdict="pass", check=_answer_to_check(evidence, identified))
    return _with_controller(
        evaluation, identified, _with_file_to_load(evidence, identified, state), held
    )


def _is_reported(evidence: Evidence) -> bool:
    """Return whether report.html is of the journal and campaign.yaml as they are now."""
    campaign, path = evidence.campaign, evidence.campaign.path(REPORT_FILE)
    settings = campaign.path("campaign.yaml")
    if evidence.journal is None or not path.is_file():
        return False
    with path.open("rb") as file:
        page_head = file.read(4000)  # which names the digest of the journal's last record
    is_of_journal = evidence.journal.digest.encode() in page_head
    return is_of_journal and path.stat().st_mtime >= settings.stat().st_mtime


def _misplaced(evidence: Evidence) -> str:
    """Return where the latest series found the tracker, in words; "" if campaign.yaml agrees.

    Also "" if tracker.place_mm was changed since that series: the operator has reacted.
    """
    journal = evidence.journal
    series = journal.series[-1] if journal and journal.series else None
    if journal is None or series is None:
        return ""
    tracker = series.started.configuration.get("tracker")
    then = tracker.get("place_mm") if isinstance(tracker, dict) else None
    if then != list(evidence.campaign.config.tracker.place_mm):
        return ""
    texts = (
        incident.record.text
        for incident in reversed(journal.incidents)
        if incident.series == series.number and isinstance(incident.record, Event)
    )
    return next((text.partition(";")[0] for text in texts if text.startswith(WRONG_PLACE)), "")


def _lacks_shots(evidence: Evidence, latest: Series) -> bool:
    """Return whether the latest run has still to measure shots of plan.csv."""
    plan = evidence.plan
    if plan is None or not latest.finished:
        return plan is not None
    taken = [shot.intent for shot in latest.shots]
    further = {row.shot for row in plan} - {intent.shot for intent in taken}
    # A finished series lacks shots also where it ended early or skipped some: with the same plan
    # this was intended, with an edited plan the new rows are to be measured.
    differs = bool(further or plan_difference(taken, plan))
    return differs and evidence.plan_digest != latest.started.plan_digest


# A plan whose shots were measured is followed by one of twice as many: each time this is advised,
# the shots come closer to all of the workspace. A plan that nothing was measured by comes first.
def _with_poses_to_cover(evidence: Evidence, latest: Series, state: CampaignState) -> CampaignState:
    """Return the state with what leads to shots where the measured ones do not reach."""
    state, plan = replace(state, remedy_first=COVER), evidence.plan
    if plan is not None and latest.started.imported and not state.offline:
        return replace(state, remedy="run {folder}")
    if plan is not None and state.offline and not _is_imported(evidence, latest):
        if not evidence.has_program:
            return replace(state, remedy="plan {folder} --program csv")
        return replace(
            state,
            remedy="import {folder} run.txt --unit mm --force",
            remedy_first=MEASURE.format("run"),
        )
    options = evidence.plan_options if plan is None else _for_more(plan, evidence.plan_options)
    return replace(state, remedy="plan {folder} {plan_options}", plan_options=options)


def _is_imported(evidence: Evidence, latest: Series) -> bool:
    """Return whether an import is of the shots of plan.csv, by the joints file of its program."""
    joints = joints_path(evidence.campaign.folder, "run")
    digests = {file.sha256 for file in imported_files(latest.started)}
    return is_file(joints) and ImportedFile.of(joints).sha256 in digests


def _for_more(plan: Sequence[PlannedShot], options: tuple[str, ...]) -> tuple[str, ...]:
    """Return the options that a plan was made with, for twice as many identification shots."""
    shots = sum(row.purpose is ShotSet.IDENTIFICATION for row in plan)
    kept = [*options]
    for name in ("--until", "--shots"):  # a goal would end the plan where it ended before
        if name in kept:
            place = kept.index(name)
            del kept[place : place + 2]
    return *kept, "--shots", str(2 * shots)


def remedy_for(identification: RecordedIdentification) -> tuple[str, str]:
    """Return the command that answers an identification that did not pass, and what to do first.

    The first finding against it decides. An empty command means: measure again.
    """
    # An option is advised only if the identification had none. Advice replaces typed options, so
    # that a second option would silently drop the first.
    judgement, provenance = identification.judgement, identification.provenance
    name = next(iter(judgement.obstacles), "")
    of_name = [each.numbers for each in judgement.findings if each.name == name]
    numbers = next(iter(of_name), {})
    first = "mend what the findings name, and measure again"
    if provenance.series == WITHOUT_SHOTS and "--for" not in provenance.asked:
        command = _remedy_without_shots(identification)
        return command, "" if command else first
    if provenance.asked or provenance.pedigree is not None:
        return "", first
    match name:
        case findings.BEYOND_TOLERANCE if numbers.get("parameter") not in TRACKER_SOURCES:
            first = "correct units, joints or robot.yaml; if the robot is built so"
            return "identify {folder} --force", first
        case findings.CHANGE if not any("last_shot" in change for change in of_name):
            first = "mend what changed; the shots after it may be enough"
            last = max(float(change["before_shot"]) for change in of_name)
            return f"identify {{folder}} --only-shots {last:.0f}-", first
        case findings.NOTHING_UNSEEN:
            return "identify {folder} --hold-out 20%", ""
    return "", first


# Without a tracker nothing shows where the robot is in space: what was touched or drawn can be
# judged, as far as the observations determine it.
def _remedy_without_shots(identification: RecordedIdentification) -> str:
    """Return the identification that judges what the observations determine; "" if they do not."""
    quantities = identification.uncertainty.determined
    judged = [q for q in quantities if q.name in ON_PLANE and q.is_determined]
    if not judged:
        return ""
    # what an option held out is held out again
    by_file = (
        all(q.is_tested for q in judged) and "--hold-out" not in identification.provenance.asked
    )
    hold_out = "" if by_file else " --hold-out 20%"
    return f"identify {{folder}}{hold_out} --for {','.join(q.name for q in judged)}"


def _answer_to_check(
    evidence: Evidence, identified: Parameters
) -> Literal["", "again", "update", "anew"]:
    """Return what answers a check that did not pass; "" without such a check."""
    check = evidence.unanswered
    if check is None:
        return ""
    # A failed check that names the changed parts can be answered by an update, which frees these
    # parts. Without named parts nothing says what to free: new shots have to determine everything.
    is_undecided = check.decision == "not decided" or check.is_of_shots_alone
    if check.of != identified.digest() or is_undecided:
        return "again"
    return "update" if check.parts else "anew"


def _with_file_to_load(
    evidence: Evidence, identified: Parameters, state: CampaignState
) -> CampaignState:
    """Return the state with the robot file to load, or how to export it first."""
    # The latest series that records which parameters the controller lacks counts; older journals
    # record none. If it lacks any of the identified ones, a plain form is needed; a form in the
    # folder in which they are all 0 will do.
    digest, series = identified.digest(), evidence.journal.series if evidence.journal else ()
    stated = [each.started.lacks for each in series if each.started.lacks is not None]
    lacking = {*stated[-1]} & {*identified.extended_by} if stated else set[str]()
    plain = next(
        (
            form.file
            for form in evidence.forms
            if form.projection
            and form.projection.of == digest
            and not any(form.wanted.get(name) for name in lacking)
        ),
        None,
    )
    if lacking and plain is None:
        return replace(state, to_export="plain")
    if plain is not None and (lacking or not stated):
        return replace(state, file=plain)
    if evidence.file_origin != digest:
        # a printer has no tracker and no controller that takes a robot file: its firmware has keys
        is_printer = has_firmware(evidence.campaign.robot.mechanism)
        if state.offline and state.measured == "observations" and is_printer:
            written = evidence.written
            form = written.projection if written else None
            if written and form and form.of == digest:  # also of another firmware
                return replace(state, file=written.file)
            return replace(state, to_export="klipper")
        return replace(state, to_export="yaml")
    return state


def _with_controller(
    evaluation: Evaluation,
    identified: Parameters,
    state: CampaignState,
    held: ControllerState | None,
) -> CampaignState:
    """Return the state completed by what the controller holds, and by the validation of that set.

    `held` is the state of a controller that was read just now, else None.
    """
    evidence, digest = evaluation.evidence, identified.digest()
    held = held or evidence.controller
    holds = held is not None and held.origin == digest and not state.offline
    validated = _validated_set(evidence, digest, held)
    # a validation that is under way, or was broken off, shows nothing yet
    is_whole = any(measured.series.finished for measured in evidence.after)
    verdict = evaluation.validated("after")
    decision = "worse" if verdict.worse else verdict.decision
    # targets are corrected for a controller that keeps, or was given back, the nominal set
    is_corrected = evidence.written is not None and evidence.written.by == "targets"
    is_for_targets = (is_corrected or _is_rolled_back(evidence)) and not holds
    return replace(
        state,
        holds=holds,
        after=decision if validated and is_whole else "",
        reasons="; ".join(verdict.reasons),
        plain=validated is not None and validated.form is not None and not validated.targets,
        by_targets=is_for_targets and not (validated and validated.targets),
    )


def _validated_set(
    evidence: Evidence, identified_digest: str, held: ControllerState | None
) -> ControllerState | None:
    """Return the set of the validation after calibration; None if that validation counts no more.

    `held` is what the controller holds now; None: unknown.
    """
    validated = evidence.held("after")
    # a validation of an earlier identification says nothing about this one
    if validated is None or validated.origin != identified_digest:
        return None
    # With corrected targets, with a declared set and offline the validation did not read the
    # identified set from the controller, so that the set that is held now cannot contradict it.
    was_read = not (validated.targets or validated.declared or evidence.campaign.is_offline)
    holds_another = held is not None and held.origin != validated.origin
    is_out_of_date = evidence.loaded_since or (was_read and holds_another)
    # a rollback followed from its validation, which stays the reason for it
    if is_out_of_date and not (holds_another and _is_rolled_back(evidence)):
        return None
    return validated


def _is_rolled_back(evidence: Evidence) -> bool:
    """Return whether the latest load took an earlier one back."""
    return evidence.loaded is not None and evidence.loaded.rolls_back is not None
