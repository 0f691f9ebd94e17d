"""Result of a validation, for people and as a document."""

from app.console import BAD, GOOD, OPEN, Terminal
from campaigns.chain.validation import Validated, ValidationStage
from campaigns.evaluation.gains import NO_CHANGE, Gain
from campaigns.evaluation.validation import ValidationResult
from campaigns.evidence import Evaluation

STYLES = {"pass": GOOD, "fail": BAD, "not decided": OPEN}


def validation_document(found: Validated) -> dict[str, object]:
    """What `--json` prints."""
    verdict = found.verdict
    return {
        **found.result.document(),
        "series": dict(found.whole.series),
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
        for name, value in found.whole.further_figures_mm().items()
    ]
    columns = ("", stage, "U (k = 2)", "limit", "decision")
    terminal.table(f"Validation, {stage} (mm)", columns, rows)
    _show_series(terminal, stage, found.whole)
    verdict = found.verdict
    for reason in verdict.reasons:
        terminal.say(f"not good: {reason}", STYLES.get(verdict.decision or "", ""))
    if verdict.decision == "pass":
        terminal.say("good: every limit asked for is kept, by more than the uncertainty", GOOD)


def show_gain(terminal: Terminal, found: Evaluation) -> None:
    """Before and after side by side; U (k = 2) is that of the difference."""
    rows = [
        (
            each.name,
            *(in_mm(length.value_mm if length else None) for length in (each.before, each.after)),
            in_mm(each.expanded_uncertainty_mm),
            _change(each),
        )
        for each in found.gains
    ]
    if found.before is not None and found.after is not None:
        old, new = found.before.further_figures_mm(), found.after.further_figures_mm()
        rows += [(name, in_mm(old[name]), in_mm(value), "-", "") for name, value in new.items()]
    columns = ("", "before", "after", "U", "")
    terminal.table("Gain (mm)", columns, rows)
    for stage, whole in (("before", found.before), ("after", found.after)):
        _show_series(terminal, stage, whole)


def _show_series(terminal: Terminal, stage: str, whole: ValidationResult | None) -> None:
    if whole is not None and whole.series_in_words:
        terminal.say(f"{stage}: {whole.series_in_words}")


def in_mm(value: float | None) -> str:
    """A figure as it is shown."""
    return "-" if value is None else f"{value:.3f}"


def _change(gain: Gain) -> str:
    """Factor of the change, unless the difference is within its uncertainty."""
    if gain.shown is False:
        return NO_CHANGE
    if gain.before is None or gain.after is None:
        return ""
    least, most = sorted((gain.before.value_mm, gain.after.value_mm))
    word = "less" if gain.after.value_mm < gain.before.value_mm else "more"
    return f"{most / least:.1f} × {word}" if least > 0.0 else word
