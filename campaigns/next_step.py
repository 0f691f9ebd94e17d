"""Next step: the one command that follows from a campaign's state, by a table. Pure."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from campaigns.controllers.export import FILE_NAME
from campaigns.evaluation.decision import Decision
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.identification import findings
from campaigns.identification.result import RecordedIdentification

Answer = Literal["", "again", "update", "anew"]
After = Literal["", "worse", "fail", "not decided", "no limits", "pass"]


@dataclass(frozen=True, slots=True)
class NextStep:
    """Command to type next, what has to be done by hand before it, and why it is next."""

    command: tuple[str, ...]
    first: str = ""
    why: str = ""

    @property
    def text(self) -> str:
        """The command as it is typed."""
        return shlex.join(("pkmcal", *self.command))

    @property
    def says(self) -> str:
        """What to do first and why, then the command, which ends the line to be copied."""
        if not self.first:
            return f"{self.why}, so: {self.text}" if self.why else self.text
        why = f" ({self.why})" if self.why else ""
        return f"{self.first}{why}, then: {self.text}"


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignState:
    """State of a campaign, as far as the next step depends on it."""

    folder: str = "DIR"
    worker: str = ""
    """Process that works on the campaign now; empty: none."""
    answered: bool = True
    """Whether the devices were asked who they are; a simulated cell need not be."""
    offline: bool = False
    """Whether no device is connected: shots are imported."""
    program: bool = False
    """Whether an offline campaign has a program of plan.csv."""
    program_after: bool = False
    """Whether it has one for what was exported last."""
    planned: bool = False
    before: bool = False
    """Whether the robot was validated before calibration."""
    measured: Literal["", "run", "import"] = ""
    left: Literal["", "run", "anew"] = ""
    """Whether plan.csv has shots that are not measured yet, and takes a new series."""
    verdict: Decision | None = None
    """Of an identification of the latest shots."""
    remedy: NextStep | None = None
    """Of an identification that did not pass; its words may have `{folder}` and `{again}`."""
    check: Answer = ""
    """What answers a check that is not good: another check, an update by its shots, new shots."""
    to_export: Literal["", "yaml", "plain"] = ""
    """Robot file that is missing: all parameters, or those that the controller knows."""
    overwrite: bool = False
    """Whether an older file has the missing one's name."""
    file: str = FILE_NAME
    """Robot file to load, in the campaign's folder."""
    holds: bool = False
    """Whether the controller holds what was identified, or a form of it."""
    plain: bool = False
    """Whether it was validated with a form that has fewer parameters."""
    after: After = ""
    """Verdict on the robot with what was identified last."""
    reasons: str = ""
    """Reasons against that verdict."""
    by_targets: bool = False
    """Whether targets are corrected, or a form was taken back, and none were validated."""
    reported: bool = False


@dataclass(frozen=True, slots=True)
class Row:
    """Row of the table: when it applies, the command, what to do by hand first, and why."""

    applies: Callable[[CampaignState], bool]
    command: str
    """Words; `next_step` says what stands for those in braces."""
    first: str = ""
    why: str = ""


LOOK = "look through campaign.yaml (tracker.place_mm!)"
MEASURE = "run program-{} on the controller, and measure at each of its stops"
CHANGED = "look for what changed since the shots, and measure again"
LIMITS = "under acceptance in campaign.yaml"

ROWS = (
    Row(
        lambda s: bool(s.worker),
        "status {folder}",
        "wait, or look on by `pkmcal watch`",
        "{worker} works on this campaign",
    ),
    Row(
        lambda s: not (s.planned or s.measured or s.answered or s.offline), "devices {folder}", LOOK
    ),
    Row(lambda s: not (s.planned or s.measured) and s.offline, "plan {folder}", LOOK),
    Row(lambda s: not (s.planned or s.measured), "plan {folder}"),
    Row(lambda s: not (s.measured or s.program) and s.offline, "plan {folder} --program csv"),
    Row(
        lambda s: not (s.measured or s.before) and s.offline,
        "import {folder} FILE --stage before",
        MEASURE.format("before"),
    ),
    Row(lambda s: not s.measured and s.offline, "import {folder} FILE", MEASURE.format("run")),
    Row(lambda s: not (s.measured or s.before), "validate {folder} --stage before"),
    Row(lambda s: not s.measured or s.left == "run", "run {folder}"),
    Row(lambda s: s.left == "anew", "run {folder} --anew"),
    Row(lambda s: s.verdict is None, "identify {folder}"),
    Row(lambda s: s.verdict != "pass", "{remedy}", "{remedy}"),
    Row(lambda s: s.check == "again", "check {folder}"),
    Row(lambda s: s.check == "update", "identify {folder} --update"),
    Row(lambda s: s.check == "anew", "{again}", CHANGED),
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
    Row(
        lambda s: s.by_targets and s.measured == "run",
        "validate {folder} --stage after --by targets",
    ),
    Row(
        lambda s: s.to_export == "plain" and not s.after,
        "export {folder} --format plain {overwrite}",
        why="the controller does not know all parameters",
    ),
    Row(lambda s: s.to_export == "yaml", "export {folder} {overwrite}"),
    Row(
        lambda s: not s.after and s.program and not s.program_after,
        "plan {folder} --program csv --stage after",
    ),
    Row(
        lambda s: not s.after and s.measured == "import",
        "import {folder} FILE --stage after",
        "put the exported file into the controller, or correct the targets, and measure pairs",
    ),
    Row(lambda s: not (s.after or s.holds), "load {folder} {file}"),
    Row(lambda s: not s.after, "validate {folder} --stage after"),
    Row(lambda s: not s.reported, "report {folder}"),
    Row(
        lambda s: s.after == "no limits",
        "report {folder}",
        f"set the limits that must be met, {LIMITS}",
    ),
    Row(
        lambda s: s.after == "not decided",
        "report {folder}",
        "measure with a smaller uncertainty, or agree other limits with whoever asks for them, "
        f"{LIMITS} ({{reasons}})",
    ),
    Row(
        lambda s: s.after == "fail",
        "report {folder}",
        "mend what breaks the limits, or agree other ones with whoever asks for them, "
        f"{LIMITS} ({{reasons}})",
    ),
)
"""The first row that applies says what is next. Its command changes what made it apply."""


def next_step(state: CampaignState) -> NextStep | None:
    """Return the next step; None where nothing is left to do."""
    row = next((row for row in ROWS if row.applies(state)), None)
    if row is None:
        return None
    remedy = state.remedy or NextStep(("{again}",))
    again = "import {folder} FILE" if state.measured == "import" else "run {folder} --anew"
    words = {
        "folder": "{folder}",
        "again": again,
        "remedy": " ".join(remedy.command).replace("{again}", again),
        "overwrite": "--overwrite" if state.overwrite else "",
        "file": "" if state.file == FILE_NAME else "--file {file}",
    }
    paths = {"{folder}": state.folder, "{file}": f"{state.folder}/{state.file}"}
    command = row.command.format_map(words).split()
    reasons = {"worker": state.worker, "remedy": remedy.first, "reasons": state.reasons}
    return NextStep(
        tuple(paths.get(word, word) for word in command),
        row.first.format_map(reasons),
        row.why.format_map(reasons),
    )


def remedy_for(found: RecordedIdentification) -> NextStep:
    """Return the remedy for an identification that did not pass, by the first finding against it.

    An option is named only where the identification had none: two would have to be typed together.
    """
    name = next(iter(found.obstacles), "")
    numbers = next((finding.numbers for finding in found.findings if finding.name == name), {})
    options, first = "", "mend what the findings name, and measure again"
    if found.asked or found.pedigree is not None:
        return NextStep(("{again}",), first)
    match name:
        case findings.BEYOND_TOLERANCE if numbers.get("parameter") not in TRACKER_SOURCES:
            first = "correct units, joints or robot.yaml; if the robot is built so"
            options = "--accept-large-change"
        case findings.CHANGE if "last_shot" not in numbers:
            first = "mend what changed; the shots after it may be enough"
            options = f"--shots {float(numbers['before_shot']):.0f}-"
        case findings.NOTHING_UNSEEN:
            options, first = "--hold-out 20%", ""
        case findings.EXTRAPOLATION:
            first = (
                "plan poses there, or leave that space out (`space` in campaign.yaml), and "
                "measure again"
            )
    command = ("identify", "{folder}", *options.split()) if options else ("{again}",)
    return NextStep(command, first)
