"""Result of a validation, for people and as a document."""

from collections.abc import Sequence

from app.console import BAD, GOOD, OPEN, Terminal
from campaigns.chain.validation import Validated, ValidationStage
from campaigns.evaluation.gains import NO_CHANGE, Gain, gains_over
from campaigns.evaluation.validation import ValidationResult, ValidationVerdict

STYLES = {"pass": GOOD, "fail": BAD, "not decided": OPEN}


def validation_document(found: Validated) -> dict[str, object]:
    """What `--json` prints."""
    verdict = found.verdict
    return {
        **found.result.document(),
        "decision": verdict.decision,
        "reasons": list(verdict.reasons),
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


def show(terminal: Terminal, stage: ValidationStage, found: Validated) -> None:
    """Results for people: every figure with its uncertainty, and what was decided."""
    rows = [
        (
            each.name,
            *map(in_mm, (each.error, each.expanded_uncertainty, each.limit)),
            each.decision or "-",
        )
        for each in found.verdict.requirements
    ]
    rows += [
        (name, in_mm(value), "-", "-", "-")
        for name, value in found.result.further_figures_mm().items()
    ]
    columns = ("", stage, "U (k = 2)", "limit", "decision")
    terminal.table(f"Validation, {stage} (mm)", columns, rows)
    show_verdict(terminal, found.verdict)


def show_verdict(terminal: Terminal, verdict: ValidationVerdict) -> None:
    """What was decided, and why it is not good."""
    for reason in verdict.reasons:
        terminal.say(f"not good: {reason}", STYLES.get(verdict.decision or "", ""))
    if verdict.decision == "pass":
        terminal.say("good: every limit asked for is kept, by more than the uncertainty", GOOD)


def show_gain(
    terminal: Terminal, before: Sequence[ValidationResult], after: ValidationResult
) -> None:
    """Before, oldest first, and after side by side; U (k = 2) is that of the difference."""
    rows = [
        (
            each.name,
            *(in_mm(length.value_mm if length else None) for length in (each.before, each.after)),
            in_mm(each.expanded_uncertainty_mm),
            _change(each),
        )
        for each in gains_over(before, after)
    ]
    rows += [
        (name, in_mm(_latest_further_mm(before, name)), in_mm(value), "-", "")
        for name, value in after.further_figures_mm().items()
    ]
    columns = ("", "before", "after", "U", "")
    terminal.table("Gain (mm)", columns, rows)


def in_mm(value: float | None) -> str:
    """A figure as it is shown."""
    return "-" if value is None else f"{value:.3f}"


def _latest_further_mm(stages: Sequence[ValidationResult], name: str) -> float | None:
    values = (stage.further_figures_mm()[name] for stage in reversed(stages))
    return next((value for value in values if value is not None), None)


def _change(gain: Gain) -> str:
    """Factor of the change, unless the difference is within its uncertainty."""
    if gain.shown is False:
        return NO_CHANGE
    if gain.before is None or gain.after is None:
        return ""
    least, most = sorted((gain.before.value_mm, gain.after.value_mm))
    word = "less" if gain.after.value_mm < gain.before.value_mm else "more"
    return f"{most / least:.1f} × {word}" if least > 0.0 else word
