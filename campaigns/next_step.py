"""Next step: the one command that follows from a campaign's state, whatever it has reached.

Pure. A step changes the state that it follows from, so that no advice leads back.
"""

import shlex
from dataclasses import dataclass
from typing import Literal

from campaigns.controllers.export import PLAIN, PLAIN_FILE
from campaigns.evaluation.decision import Decision

Held = Literal["", "identified", "form"]
Answer = Literal["", "again", "update", "anew"]
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


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignState:
    """State of a campaign, as far as the next step depends on it."""

    folder: str = "DIR"
    answered: bool = True
    """Whether the devices were asked who they are; a simulated cell need not be."""
    offline: bool = False
    """Whether nothing is connected: what a command would measure is imported."""
    program: bool = False
    """Whether there is a program of plan.csv; of an offline campaign."""
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
    check: Answer = ""
    """What answers a check of it that is not good: another check, an update by the shots of this
    one, or a new campaign."""
    file: Literal["", "other", "identified"] = ""
    form: Literal["", "needed", "exported"] = ""
    """Plain parameters, of which a controller without plate tilt takes the file."""
    form_file: str = PLAIN_FILE
    """The form's, in the campaign's folder."""
    form_there: bool = False
    """Whether an older form has the file's default name."""
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
        return NextStep(("run", here, *anew))
    if state.verdict is None:
        return NextStep(("identify", here))
    return state.way_on or _to_answer_a_check(state) or _to_calibrate(state) or _to_show(state)


def _to_measure(state: CampaignState) -> NextStep:
    here, look = state.folder, "look through campaign.yaml (tracker.place_mm!)"
    if not state.planned and not state.answered and not state.offline:
        return NextStep(("devices", here), look)
    if not state.planned:
        return NextStep(("plan", here), look if state.offline else "")
    if state.offline and not state.program:
        return NextStep(("plan", here, "--program", "csv"))
    if state.offline and not state.before:
        first = "run program-before on the controller, and measure at each of its stops"
        return NextStep(("import", here, "FILE", "--stage", "before"), first)
    if state.offline:
        first = "run program-run on the controller, and measure at each of its stops"
        return NextStep(("import", here, "FILE"), first)
    if not state.before:
        return NextStep(("validate", here, "--stage", "before"))
    return NextStep(("run", here))


def _to_answer_a_check(state: CampaignState) -> NextStep | None:
    steps = {
        "again": NextStep(("check", state.folder)),
        "update": NextStep(("identify", state.folder, "--update")),
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
        return NextStep(("plan", here, "--program", "csv", "--stage", "after"))
    if imported:
        put = "put the exported file into the controller, or correct the targets, and measure pairs"
        return NextStep(("import", here, "FILE", "--stage", "after"), put)
    if state.form == "needed":
        again = ["--overwrite"] if state.form_there else []
        return NextStep(("export", here, "--format", PLAIN, *again))
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
