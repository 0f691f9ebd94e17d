"""Result of a validation, for people and as a document."""

from collections.abc import Iterable, Mapping

from app.console import BAD, GOOD, OPEN, Terminal
from campaigns.chain.validation import Validated, ValidationStage
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


def figures_mm(found: ValidationResult) -> dict[str, float | None]:
    """All figures by their names on the screen; None for a test that was not run."""
    lengths = found.figures().items()
    values = {name: None if each is None else each.value_mm for name, each in lengths}
    return {**values, **found.further_figures_mm()}


def latest_figures_mm(found: Iterable[ValidationResult]) -> dict[str, float | None]:
    """Figures of several validations, oldest first: of each test the latest."""
    latest: dict[str, float | None] = {}
    for each in found:
        known = {name: value for name, value in figures_mm(each).items() if value is not None}
        latest |= known
    return latest


def show_gain(
    terminal: Terminal, before_mm: Mapping[str, float | None], after: ValidationResult
) -> None:
    """Before and after side by side; of the figures before by their names on the screen."""
    rows = [
        (name, *map(in_mm, (before_mm.get(name), value)), _factor(before_mm.get(name), value))
        for name, value in figures_mm(after).items()
    ]
    terminal.table("Gain (mm)", ("", "before", "after", "before/after"), rows)


def in_mm(value: float | None) -> str:
    """A figure as it is shown."""
    return "-" if value is None else f"{value:.3f}"


def _factor(before: float | None, after: float | None) -> str:
    return f"{before / after:.1f}" if before is not None and after else "-"
