"""Result of a validation, for people and as a document."""

import typer

from app.console import DECISIONS, GOOD, Terminal
from app.exits import Exit
from app.next import tell_next
from app.report.result_tables import BEFORE_AND_AFTER, CUBE, limits
from campaigns.arrays import AXES
from campaigns.campaign import Campaign
from campaigns.evaluation.gains import NO_CHANGE, Gain
from campaigns.evaluation.iso_figures import cube_frame, cube_poses
from campaigns.evaluation.validation import ValidationResult
from campaigns.evidence import Evaluation
from campaigns.files.table import NOTHING, Column, number, texts, words
from campaigns.options import ValidationStage
from campaigns.workflow.validation import Validated


def validation_document(found: Validated) -> dict[str, object]:
    """What `--json` prints."""
    verdict, whole = found.verdict, found.campaign_verdict
    return {
        **found.result.document(),
        "series": dict(found.whole.series),
        "decision": verdict.decision,
        "reasons": list(verdict.reasons),
        "held": found.evaluation.evidence.held(found.stage),
        "campaign": whole
        and {"decision": whole.decision, "answer": whole.answer, "reasons": whole.reasons},
        "requirements": [
            {
                "name": each.name,
                "error_mm": each.error,
                "expanded_uncertainty_mm": each.expanded_uncertainty,
                "limit_mm": each.limit,
                "decision": each.decision,
            }
            for each in verdict.requirements
        ],
    }


def show_validation(terminal: Terminal, found: Validated, campaign: Campaign) -> None:
    """Results for people and for programs, and the next command; raises `Exit` unless good."""
    _show(terminal, found.stage, found)
    if found.stage == "after" and found.evaluation.before is not None:
        show_gain(terminal, found.evaluation)
    terminal.document(validation_document(found) | tell_next(terminal, campaign))
    if found.verdict.decision not in {None, "pass"} or found.otherwise is not None:
        raise typer.Exit(Exit.NOT_GOOD)


def _show(terminal: Terminal, stage: ValidationStage, found: Validated) -> None:
    """Results for people: every figure with its uncertainty, and what was decided."""
    further = found.whole.further_figures_mm()
    columns, nothing = limits(""), (NOTHING,) * 4
    rows = texts(columns, found.verdict.requirements)
    rows += tuple((name, number(each), *nothing) for name, each in further.items())
    terminal.table(f"Validation, {stage} (mm)", [column.head for column in columns], rows)
    if found.whole.cube:
        shown = [each for each in CUBE[1:] if each.head not in (*AXES, "n")]  # they fill 80 columns
        terminal.rows("ISO 9283, pose by pose (mm)", shown, cube_poses(**{stage: found.whole}))
        terminal.say(f"AP: {cube_frame(found.whole)}; U: k = 2")
    _show_series(terminal, stage, found.whole)
    held = found.evaluation.evidence.held(stage)
    if held is not None and (held.form or held.declared or held.kind == "other"):
        terminal.say(f"the controller held {held.says}")
    verdict = found.verdict
    # limits are for the calibrated robot
    says, style = "before calibration, only stated", ""
    if stage == "after":
        says, style = "not good", DECISIONS.get(verdict.decision or "", "")
    for reason in verdict.reasons:
        terminal.say(f"{says}: {reason}", style)
    whole = found.campaign_verdict
    if verdict.decision == "pass" and found.otherwise is None:
        terminal.say("good: every limit asked for is kept, by more than the uncertainty", GOOD)
    if whole is not None and whole.answer != verdict.decision:
        terminal.say(f"the campaign as a whole: {whole.says}", DECISIONS[whole.decision])


def show_gain(terminal: Terminal, found: Evaluation) -> None:
    """Before and after side by side; U (k = 2) is that of the difference."""
    rows = texts(GAIN, found.gains)
    if found.before is not None and found.after is not None:
        old, new = found.before.further_figures_mm(), found.after.further_figures_mm()
        further = ((name, number(old[name]), number(each)) for name, each in new.items())
        rows += tuple((*both, NOTHING, "") for both in further)
    terminal.table("Gain (mm)", [column.head for column in GAIN], rows)
    for stage, whole in (("before", found.before), ("after", found.after)):
        _show_series(terminal, stage, whole)


def _show_series(terminal: Terminal, stage: str, whole: ValidationResult | None) -> None:
    if whole is not None and whole.series_in_words:
        terminal.say(f"{stage}: {whole.series_in_words}")


def _change(gain: Gain) -> str:
    """Factor of the change, unless the difference is within its uncertainty."""
    if gain.shown is False:
        return NO_CHANGE
    if gain.before is None or gain.after is None:
        return ""
    least, most = sorted((gain.before.value_mm, gain.after.value_mm))
    word = "less" if gain.after.value_mm < gain.before.value_mm else "more"
    return f"{most / least:.1f} × {word}" if least > 0.0 else word


GAIN: tuple[Column[Gain], ...] = (
    *BEFORE_AND_AFTER,
    Column("U", lambda gain: gain.expanded_uncertainty_mm),
    words("", _change),
)
