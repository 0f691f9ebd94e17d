"""Results of an identification and of a validation on the terminal, and as a document.

The verdict comes first, then its reasons and the few figures that most people read: all of it fits
on a small screen. `--verbose` adds every table, the report has them on its page, and `--json` has
the same figures by stable names.
"""

from collections.abc import Iterable, Iterator, Sequence

from app.console import DECISIONS, WARNING, Terminal
from app.next import tell_next
from app.report import tables
from campaigns.arrays import AXES
from campaigns.assessment import Evaluation
from campaigns.campaign import Campaign
from campaigns.evaluation.decision import NO_LIMIT, Requirement
from campaigns.evaluation.iso_figures import cube_frame, cube_poses
from campaigns.evaluation.summary import BeforeAfter
from campaigns.evaluation.validation import ValidationResult
from campaigns.evaluation.verdict import CampaignVerdict
from campaigns.files.table import NOTHING, Column, number, texts, two_digits, words
from campaigns.identification.findings import WRONG_SHOTS, Finding, remedy_of
from campaigns.identification.result import RecordedIdentification, Residuals
from campaigns.kinematics.parameters import ParameterTable
from campaigns.workflow.validation import Validated

COLUMNS: tuple[Column[tables.Named], ...] = (words("", lambda row: row[0]), *tables.VALUES)
ERRORS: tuple[Column[tuple[str, BeforeAfter]], ...] = (
    words("", lambda row: row[0]),
    Column("mean before", lambda row: row[1].before.mean_abs),
    Column("after", lambda row: row[1].after.mean_abs),
    Column("max before", lambda row: row[1].before.max_abs),
    Column("after", lambda row: row[1].after.max_abs),
)
SHARES_SHOWN = 5
"""Number of rows of the budget that are shown without --verbose: they are nearly all of it."""
SHARES_SHOWN_SMALL = 2
"""Number of rows of the budget that a small screen has room for."""
LEFT_OUT_SHOWN = 5
"""Number of shots left out that have a line each without --verbose."""


def show_identification(
    terminal: Terminal,
    identification: RecordedIdentification,
    table: ParameterTable,
    warnings: Iterable[str] = (),
) -> None:
    """Show the verdict with its reasons and warnings, the largest shares of σ, what was left out.

    `warnings` are those of the series itself, and of the tracker's limits.
    """
    judgement = identification.judgement
    terminal.say(f"verdict: {judgement.verdict}", DECISIONS[judgement.verdict])
    for reason in judgement.reasons:
        terminal.say(f"  {reason}")
    show_warnings(terminal, warnings)
    if terminal.is_verbose:
        _show_tables(terminal, identification, table)
    else:
        _show_largest_shares(terminal, identification)
        _show_changes(terminal, identification)
    _show_left_out(terminal, identification)
    for finding in judgement.findings:
        if not (finding.affects_verdict or _is_listed(finding, identification)):
            terminal.say(f"{finding.says}{' (accepted)' if finding.accepted else ''}", WARNING)


def say_verdict(terminal: Terminal, verdict: CampaignVerdict) -> None:
    """Say the verdict on a campaign first, and of a pass which limits are met."""
    terminal.say(f"verdict: {verdict.decision}", DECISIONS[verdict.decision])
    if verdict.decision == "pass":
        terminal.say(f"  {limits_met(verdict.requirements)}")


def show_warnings(terminal: Terminal, warnings: Iterable[str]) -> None:
    """Show warnings that do not change a verdict, each in a line below it."""
    for text in warnings:
        terminal.say(f"  warning: {text}", WARNING)


def _show_largest_shares(terminal: Terminal, identification: RecordedIdentification) -> None:
    """Show σ of positions and where most of it comes from; of observations what they determine."""
    determined = tables.determined_rows(identification)
    for quantity in determined:
        terminal.say(tables.quantity_in_words(quantity))
    *rows, (_, _, combined) = tables.budget_rows(identification)
    if determined or not rows:
        return
    shown = SHARES_SHOWN_SMALL if terminal.is_small else SHARES_SHOWN
    sizes = "the largest shares" if len(rows) > shown else "its shares"
    terminal.say(f"positions: σ {two_digits(combined)} mm rms over the workspace; {sizes}:")
    for words_of_source, _, mm in rows[:shown]:
        terminal.say(f"  {two_digits(mm):<7} {words_of_source}")


def _show_changes(terminal: Terminal, identification: RecordedIdentification) -> None:
    """Count the parameters that differ from nominal, and say where all of them stand."""
    value = identification.value
    shown = sum(tables.is_shown(value.parameters[name]) for name in value.free)
    terminal.say(
        f"{shown} of {len(value.free)} parameters differ from nominal by more than U: report, "
        "or --verbose"
    )


def _show_tables(
    terminal: Terminal, identification: RecordedIdentification, table: ParameterTable
) -> None:
    """Show parameters, errors, the budget and sentences on the model."""
    # The full model has dozens of parameters of imperfect parts and drives. Those within U of
    # nominal are only counted.
    value = identification.value
    free = [(name, value.parameters[name]) for name in value.free]
    listed = [(name, p) for name, p in free if name in table.names or tables.is_shown(p)]
    terminal.rows("Parameters (mm, deg, ppm)", COLUMNS, listed)
    if others := len(free) - len(listed):
        terminal.say(f"{others} parameters of imperfect parts and drives are within U of nominal")
    _show_errors(terminal, identification.residuals)
    if identification.uncertainty.budget:
        title = "Uncertainty of positions, 1 σ, rms over the workspace"
        terminal.rows(title, tables.BUDGET, tables.budget_rows(identification))
    terminal.rows(
        "What these observations determine, 1 σ",
        tables.DETERMINED,
        tables.determined_rows(identification),
    )
    terminal.rows("Errors of the tracker", tables.TRACKER_ERRORS, value.tracker.items())
    for line in _sentences(identification):
        if line not in identification.judgement.reasons:  # they stand below the verdict
            terminal.say(line)


def _show_left_out(terminal: Terminal, identification: RecordedIdentification) -> None:
    """Show the shots and pairs that were left out: the first ones, and how many more."""
    lines = [*_left_out(identification)]
    shown = lines if terminal.is_verbose else lines[:LEFT_OUT_SHOWN]
    for line in shown:
        terminal.say(f"left out: {line}", WARNING)
    if more := len(lines) - len(shown):
        terminal.say(f"left out: {more} more, which the report lists", WARNING)


def _show_errors(terminal: Terminal, residuals: Residuals) -> None:
    """Show the errors of fitted shots and hold-out pairs, as far as there are any."""
    of_pairs = residuals.fitted is not None and residuals.fitted.of == "pairs"
    fitted = "distances of fitted pairs" if of_pairs else "positions of fitted shots"
    errors = {fitted: residuals.residuals_mm, "distances of hold-out pairs": residuals.unseen_mm}
    rows = [(name, sizes) for name, sizes in errors.items() if sizes is not None]
    terminal.rows("Errors (mm)", ERRORS, rows)


# A change has one line by its finding. Wrong shots have a line each, with size and remedy: then a
# finding that only counts them adds nothing, and is left out unless they have something in common.
def _left_out(identification: RecordedIdentification) -> Iterator[str]:
    """Yield each shot and pair that was left out, with the reason, and what to do about it."""
    judgement = identification.judgement
    event_of = {event.first: event for event in judgement.events if event.leaves_out}
    for excluded in judgement.excluded:
        event = None if excluded.shot is None else event_of.get(excluded.shot)
        if event is None:
            yield f"{excluded.what}: {excluded.reason}"
        elif event.kind == "no assembly":
            yield f"{excluded.what}: {excluded.reason}: {remedy_of(event)}"
        else:
            size = tables.size_of(event, ())  # of a wrong shot always in mm
            yield f"{excluded.what}: {size} off where all others put it: {remedy_of(event)}"


def _is_listed(finding: Finding, identification: RecordedIdentification) -> bool:
    """Return whether a finding only counts shots that have a line each."""
    is_listed = any(event.leaves_out for event in identification.judgement.events)
    return finding.name == WRONG_SHOTS and is_listed and "pattern" not in finding.numbers


def _sentences(identification: RecordedIdentification) -> Iterator[str]:
    yield from tables.in_words(identification)
    if (test := identification.judgement.hold_out) is not None:
        yield tables.hold_out_in_words(test)
    yield from tables.positions_in_words(identification)
    yield from tables.undetermined_in_words(identification)


def validation_answer(validated: Validated) -> dict[str, object]:
    """Return a validation's result for programs: each test's figures, and what was decided."""
    verdict, whole = validated.verdict, validated.campaign_verdict
    requirements = [
        {
            "name": requirement.name,
            "error_mm": requirement.error,
            "expanded_uncertainty_mm": requirement.expanded_uncertainty,
            "limit_mm": requirement.limit,
            "decision": requirement.decision,
        }
        for requirement in verdict.requirements
    ]
    answer: dict[str, object] = {
        "series": dict(validated.stage_result.series),
        "decision": verdict.decision,
        "reasons": verdict.reasons,
        "scatter": validated.stage_result.scatter.says,
        "held": validated.evaluation.evidence.held(validated.stage),
        "campaign": None,  # before calibration
        "requirements": requirements,
    }
    if whole is not None:
        decision = whole.decision
        answer["campaign"] = {"decision": decision, "answer": decision, "reasons": whole.reasons}
    return validated.result.document() | answer


def show_validation(terminal: Terminal, validated: Validated, campaign: Campaign) -> None:
    """Show the results, for people and programs, and what is next; raise `Exit` unless good.

    Before calibration errors are only stated: a limit that is missed then is no fault.
    """
    is_good = True
    if validated.stage == "before":
        _show_stated(terminal, validated)
    else:
        _show_judged(terminal, validated)
        has_passed = validated.verdict.decision in {NO_LIMIT, "pass"}
        is_good = has_passed and validated.differing_verdict is None
    following = tell_next(terminal, campaign, evaluation=validated.evaluation)
    terminal.conclude(validation_answer(validated), following, is_good=is_good)


def limits_met(requirements: Sequence[Requirement]) -> str:
    """Return how many limits are specified and met, in words."""
    count = sum(requirement.limit is not None for requirement in requirements)
    met = "the specified limit is" if count == 1 else f"all {count} specified limits are"
    return f"{met} met, measurement uncertainty included"


def _show_stated(terminal: Terminal, validated: Validated) -> None:
    """Show the figures of the robot before calibration, and the limits that it misses."""
    unmet = validated.verdict.reasons
    missed = f"; {len(unmet)} of the limits for the calibrated robot are not met" if unmet else ""
    terminal.say(f"before calibration, errors are only stated{missed}")
    for reason in unmet if terminal.is_verbose else ():
        terminal.say(f"  {reason}")
    _show_figures(terminal, validated)


def _show_judged(terminal: Terminal, validated: Validated) -> None:
    """Show the decisions on stage and campaign, the gain, and every figure with its U."""
    verdict, whole = validated.verdict, validated.campaign_verdict
    terminal.say(f"verdict: {verdict.decision}", DECISIONS[verdict.decision])
    for reason in verdict.reasons:
        terminal.say(f"  not good: {reason}")
    if verdict.decision == "pass":
        terminal.say(f"  {limits_met(verdict.requirements)}")
    if whole is not None and whole.decision not in {verdict.decision} - {NO_LIMIT}:
        terminal.say(f"the campaign as a whole: {whole.decision}", DECISIONS[whole.decision])
        for reason in whole.reasons:
            terminal.say(f"  {reason}")
    show_warnings(terminal, validated.evaluation.evidence.warnings)
    _show_figures(terminal, validated)
    if validated.evaluation.before is None:
        return
    if terminal.is_verbose:
        show_gain(terminal, validated.evaluation)
    else:
        say_gain(terminal, validated.evaluation)


def _show_figures(terminal: Terminal, validated: Validated) -> None:
    """Show every figure with its uncertainty, and what the robot was measured with."""
    # a small screen has room for the verdict, its reasons and the gain: the table would push the
    # verdict out of sight
    if terminal.is_small and not terminal.is_verbose:
        terminal.say("every figure with its U: report, or --verbose")
        return
    stage, result, verdict = validated.stage, validated.stage_result, validated.verdict
    columns = tables.limits("")
    rows = texts(columns, verdict.requirements)
    further = result.further_figures_mm().items()
    if terminal.is_verbose:
        rows += tuple((name, number(value), *[NOTHING] * 4) for name, value in further)
    terminal.table(f"Validation, {stage} (mm)", [column.head for column in columns], rows)
    if result.cube:
        # a terminal of 80 columns has no room for the stage, the poses' places and n
        shown = [column for column in tables.CUBE[1:] if column.head not in (*AXES, "n")]
        terminal.rows("ISO 9283, pose by pose (mm)", shown, cube_poses(**{stage: result}))
        terminal.say(f"AP: {cube_frame(result)}")
    terminal.say(result.scatter.says)
    _show_series(terminal, stage, result)
    held = validated.evaluation.evidence.held(stage)
    if held is not None and (held.form or held.declared or held.kind == "other"):
        terminal.say(f"the controller held {held.says}")


def say_gain(terminal: Terminal, evaluation: Evaluation) -> None:
    """Say what the distances gained, mean and largest, each in a line."""
    names = ("distances, mean error", "distances, largest error")
    for gain in evaluation.gains:
        if gain.name in names and gain.shown is not None:
            words_of_gain = "" if gain.shown is False else f" ({tables.change(gain)})"
            terminal.say(f"  {gain.in_words()}{words_of_gain}")


def show_gain(terminal: Terminal, evaluation: Evaluation) -> None:
    """Show before and after side by side; U is that of the difference."""
    rows = texts(tables.GAINS, evaluation.gains)
    if evaluation.before is not None and evaluation.after is not None:
        old, new = evaluation.before.further_figures_mm(), evaluation.after.further_figures_mm()
        further = ((name, number(old[name]), number(value)) for name, value in new.items())
        rows += tuple((*both, "", NOTHING) for both in further)
    terminal.table("Gain (mm; U of the difference)", [column.head for column in tables.GAINS], rows)
    for stage, result in (("before", evaluation.before), ("after", evaluation.after)):
        _show_series(terminal, stage, result)


def _show_series(terminal: Terminal, stage: str, result: ValidationResult | None) -> None:
    if result is not None and result.series_in_words:
        terminal.say(f"{stage}: {result.series_in_words}")
