"""Page of the report: an evaluation in the words of sections.jinja and page.html.jinja."""

from dataclasses import dataclass

from app.report import groups, model_sections, record_sections, results_sections
from app.report.figures import distances, tests, time_and_parameters, workspace
from app.report.parts import Section
from app.report.rendering import GENERATOR, rendered, sections_of
from campaigns.evaluation.campaign_verdict import RULE
from campaigns.evidence import Evaluation
from campaigns.files.table import Row

MAKERS = {
    "results": results_sections,
    "model": model_sections,
    "record": record_sections,
    "groups": groups,
    "distances": distances,
    "workspace": workspace,
    "tests": tests,
    "course": time_and_parameters,
}
"""Modules whose functions the sections' template asks for rows, groups and figures."""


@dataclass(frozen=True, slots=True, eq=False)
class Page:
    """Page as its template is given it."""

    evaluation: Evaluation
    made_utc: str
    sections: tuple[Section, ...]
    rule: str = RULE
    generator: str = GENERATOR

    @property
    def decision(self) -> str:
        """Decision of the verdict."""
        return self.evaluation.verdict.decision

    @property
    def answer(self) -> str:
        """Decision, or that no limit was asked for where only that leaves it open."""
        return self.evaluation.verdict.answer

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons of the verdict, a sentence each."""
        return self.evaluation.verdict.reasons

    @property
    def key_figures(self) -> tuple[Row, ...]:
        """Rows of name, before, after (mm), and whether that shows a change."""
        return results_sections.key_figure_rows(self.evaluation)

    @property
    def missing(self) -> tuple[tuple[str, str], ...]:
        """Lacks, each once, with the first section that has it."""
        found: dict[str, str] = {}
        for section in self.sections:
            for text in section.missing:
                found.setdefault(text, section.name)
        return tuple(found.items())


def page_of(evaluation: Evaluation, made_utc: str) -> Page:
    """Put the page together."""
    sections = sections_of("sections.jinja", {"evaluation": evaluation, **MAKERS})
    return Page(evaluation, made_utc, sections)


def page_html(page: Page) -> str:
    """Draw the figures and write the document."""
    return rendered("page.html.jinja", page)
