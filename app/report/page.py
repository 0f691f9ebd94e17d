"""Page of the report: an evaluation in the words of sections.jinja and page.html.jinja."""

from collections.abc import Callable
from dataclasses import dataclass

from app.report import (
    certificate_sections,
    groups,
    model_sections,
    record_sections,
    results_sections,
)
from app.report.figures import distances, tests, time_and_parameters, workspace
from app.report.rendering import Outline, no_word, rendered
from campaigns.campaign_state import state_of
from campaigns.evaluation import iso_figures
from campaigns.evaluation.campaign_verdict import RULE
from campaigns.evidence import Evaluation
from campaigns.next_step import next_step

MAKERS = {
    "results": results_sections,
    "iso": iso_figures,
    "model": model_sections,
    "record": record_sections,
    "certificate": certificate_sections,
    "groups": groups,
    "distances": distances,
    "workspace": workspace,
    "tests": tests,
    "course": time_and_parameters,
}
"""Modules whose functions the sections' template asks for rows, groups and figures."""


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Page as a document, and what is on it."""

    evaluation: Evaluation
    html: str
    outline: Outline


def page_of(
    evaluation: Evaluation, made_utc: str, tell: Callable[[str, int, int], None] = no_word
) -> Page:
    """Write the page and draw its figures, of which `tell` hears (`rendered`)."""
    key_figures = results_sections.key_figure_rows(evaluation)
    own = {"evaluation": evaluation, "key_figures": key_figures}
    state = state_of(evaluation, reported=True)
    values = {**MAKERS, **own, "next": next_step(state), "made_utc": made_utc, "rule": RULE}
    return Page(evaluation, *rendered("page.html.jinja", values, tell=tell))
