"""Identification on the terminal."""

from collections.abc import Iterator

from app.console import DECISIONS, WARNING, Terminal
from app.report import model_tables
from campaigns.evaluation.summary import BeforeAfter
from campaigns.files.table import Column, words
from campaigns.identification.result import RecordedIdentification
from campaigns.kinematics.parameters import ParameterTable

COLUMNS: tuple[Column[model_tables.Named], ...] = (
    words("", lambda row: row[0]),
    *model_tables.VALUES,
)
ERRORS: tuple[Column[tuple[str, BeforeAfter]], ...] = (
    words("", lambda row: row[0]),
    Column("mean before", lambda row: row[1].before.mean_abs),
    Column("after", lambda row: row[1].after.mean_abs),
    Column("max before", lambda row: row[1].before.max_abs),
    Column("after", lambda row: row[1].after.max_abs),
)


def show(terminal: Terminal, found: RecordedIdentification, table: ParameterTable) -> None:
    """Show parameters, errors, budget, findings, and the verdict last.

    Of imperfect parts and drives only those that differ from nominal beyond U are listed.
    """
    free = [(name, found.parameters[name]) for name in found.free]
    listed = [(n, own) for n, own in free if n in table.names or model_tables.is_shown(own)]
    terminal.rows("Parameters (mm, deg, ppm)", COLUMNS, listed)
    if others := len(free) - len(listed):
        terminal.say(f"{others} parameters of imperfect parts and drives are within U of nominal")
    terminal.rows("Errors (mm)", ERRORS, list(_errors(found)))
    if found.budget:
        title = "Uncertainty of positions, 1 σ, rms over the workspace"
        terminal.rows(title, model_tables.BUDGET, model_tables.budget_rows(found))
    if found.tracker:
        columns = model_tables.TRACKER_ERRORS
        terminal.rows("Errors of the tracker", columns, found.tracker.items())
    for line in _sentences(found):
        if line not in found.reasons:
            terminal.say(line)
    for line in _warnings(found):
        terminal.say(line, WARNING)
    terminal.say(f"verdict: {found.verdict}", DECISIONS[found.verdict])
    for reason in found.reasons:
        terminal.say(f"  {reason}")


def _sentences(found: RecordedIdentification) -> Iterator[str]:
    yield from model_tables.in_words(found)
    if found.hold_out is not None:
        yield model_tables.hold_out_in_words(found.hold_out)
    yield from model_tables.positions_in_words(found)
    yield from model_tables.undetermined_in_words(found)


def _errors(found: RecordedIdentification) -> Iterator[tuple[str, BeforeAfter]]:
    """Yield the sizes of the errors of what was fitted and of hold-out pairs."""
    of_pairs = found.fitted is not None and found.fitted.of == "pairs"
    fitted = "distances of fitted pairs" if of_pairs else "positions of fitted shots"
    both = {fitted: found.residuals_mm, "distances of hold-out pairs": found.unseen_mm}
    return ((name, errors) for name, errors in both.items() if errors is not None)


def _warnings(found: RecordedIdentification) -> Iterator[str]:
    """Yield what was left out, and the findings that the verdict does not give as reasons."""
    for left in found.excluded:
        yield f"left out: {left.what}: {left.reason}"
    for finding in found.findings:
        if not finding.affects_verdict:
            yield f"{finding.says}{' (accepted)' if finding.accepted else ''}"
