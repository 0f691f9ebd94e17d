"""Identification on the terminal."""

from collections.abc import Iterator

from app.console import DECISIONS, WARNING, Terminal
from app.report import model_sections
from campaigns.estimation.estimators import Estimator
from campaigns.evaluation.summary import BeforeAfter
from campaigns.files.table import Column, words
from campaigns.identification.result import STRONG, IdentificationResult
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.robots.robot import FOR_SOME_CONTROLLERS

CORRELATIONS = 5
"""So many of the strongest are shown."""


NAME: Column[model_sections.Named] = words("", lambda row: row[0])
ERRORS: tuple[Column[tuple[str, BeforeAfter]], ...] = (
    words("", lambda row: row[0]),
    Column("mean before", lambda row: row[1].before.mean_abs),
    Column("after", lambda row: row[1].after.mean_abs),
    Column("max before", lambda row: row[1].before.max_abs),
    Column("after", lambda row: row[1].after.max_abs),
)


def show(terminal: Terminal, found: IdentificationResult, space: ParameterSpace) -> None:
    """Result for people: parameters, errors, what is uncertain, the verdict last."""
    columns = (NAME, *model_sections.values(found.coverage_factor_95))
    free = [(name, each) for name, each in found.parameters.items() if each.free]
    terminal.rows("Parameters (mm, deg)", columns, free)
    terminal.rows("Errors (mm)", ERRORS, list(_errors(found)))
    if found.models:
        terminal.rows("Models (mm)", model_sections.MODELS, found.models)
    if found.known_lengths is not None:
        lengths = found.known_lengths.lengths
        terminal.rows("Known lengths", model_sections.KNOWN_LENGTHS, lengths)
    terminal.say(_remaining(found), "bold")
    terminal.say("")
    for line in _uncertainty_lines(found):
        terminal.say(line)
    for line in _warnings(found):
        terminal.say(line, WARNING)
    terminal.say(f"verdict: {found.verdict}", DECISIONS[found.verdict])
    for reason in found.reasons:
        terminal.say(f"  {reason}")
    if any(name in space.extensions for name in found.free):
        terminal.say(FOR_SOME_CONTROLLERS, WARNING)


def _remaining(found: IdentificationResult) -> str:
    if found.estimator is Estimator.DISTANCES:
        return "Residuals of the fitted distances"
    return "Residuals of the fitted coordinates"


def _errors(found: IdentificationResult) -> Iterator[tuple[str, BeforeAfter]]:
    distances = found.estimator is Estimator.DISTANCES
    fitted = "distances of fitted pairs" if distances else "positions of fitted shots"
    both = {fitted: found.residuals_mm, "distances of hold-out pairs": found.unseen_mm}
    return ((name, errors) for name, errors in both.items() if errors is not None)


def _uncertainty_lines(found: IdentificationResult) -> Iterator[str]:
    condition = "infinite" if found.condition is None else f"{found.condition:.0f}"
    yield (
        f"{found.message}; rank {found.rank}, condition {condition}, {found.dof} degrees of freedom"
    )
    yield from model_sections.uncertainty_in_words(found)
    if words := model_sections.interval_in_words(found.coverage_factor_95):
        yield words
    if found.known_lengths is not None:
        yield model_sections.scale_in_words(found.known_lengths)
    known = found.covariance
    for each in known.strongest(CORRELATIONS, STRONG) if known else ():
        yield f"  correlated: {each.a} and {each.b}, {each.value:+.2f}"


def _warnings(found: IdentificationResult) -> Iterator[str]:
    for left in found.excluded:
        yield f"left out: {left.what}: {left.reason}"
    for names in found.known_by_priors_alone:
        yield f"known by the priors alone: {', '.join(names)}"
    for doubt in found.doubts:
        if not doubt.affects_verdict:
            yield f"{doubt.says}{' (accepted)' if doubt.accepted else ''}"
