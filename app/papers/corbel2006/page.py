"""The page: the paper's figures beside ours, in one file that needs no network."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from app.papers.corbel2006 import pictures
from app.papers.corbel2006.comparison import Comparison
from app.papers.corbel2006.evidence import Evidence
from app.papers.corbel2006.experiments import PROTOTYPE, REPEATABILITY, SIMULATION, Experiment
from app.papers.corbel2006.misfit import misfit_in_words
from app.papers.corbel2006.tables import (
    comparison_tables,
    floor_table,
    geometry_table,
    reach_table,
    reason_lines,
    table_ii,
)
from app.papers.corbel2006.trials import TrialResult
from app.papers.corbel2006.verdict import Verdict
from app.report.parts import Paragraph, Part, Row, Section, Table, moment, number
from app.report.rendering import GENERATOR, rendered

SOURCE = (
    "D. Corbel, O. Company, V. Nabat, P. Maurine: Geometrical Calibration of the High Speed Robot "
    "Par4 Using a Laser Tracker. MMAR 2006"
)
HOW_DONE = (
    "Every seed is a campaign of its own on a simulated cell, through the same drivers, protocols "
    "and sockets as a real one: plan, validate, run, identify, export, load, validate. It draws 60 "
    "pairs near the limits of the workspace to identify from, 20 unseen pairs, and all noise. The "
    "simulated robot is built of eight rods and shares no equation with the identification."
)
HOW_COMPARED = (
    "The median over the seeds is set beside the paper's figure, with the range from 5 to 95 %. A "
    'figure differs when nothing that the paper\'s words allow lies in this range; "about" allows '
    "10 %. How each figure is defined: docs/model.md; more on this page: docs/reproduction.md."
)


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """What the page is made of."""

    results: tuple[TrialResult, ...]
    comparison: Comparison
    evidence: Evidence
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Page:
    """What the template fills in."""

    facts: tuple[Row, ...]
    verdict: Verdict
    sections: tuple[Section, ...]
    source: str = SOURCE
    generator: str = GENERATOR


def page_of(material: Material, made_utc: str) -> Page:
    """Put the page together; no figure is drawn yet."""
    return Page(tuple(_facts(material, made_utc)), material.verdict, tuple(_sections(material)))


def page_html(page: Page) -> str:
    """Draw the figures and write the document."""
    return rendered("reproduction.html.jinja", page, package="app.papers.corbel2006")


def _facts(material: Material, made_utc: str) -> Iterator[Row]:
    yield "seeds of each", f"{material.verdict.seeds}"
    yield "computing time", f"{number(sum(r.seconds for r in material.results) / 60.0, 1)} min"
    yield "page made", moment(made_utc)
    yield "software", GENERATOR


def _sections(material: Material) -> Iterator[Section]:
    yield Section("glance", "At a glance", tuple(pictures.overview(material.comparison)))
    yield Section("simulation", "Section IV.D: the simulation", tuple(_simulation(material)))
    yield Section("experiment", "Section IV.E: the experiment", tuple(_experiment(material)))
    yield Section("differences", "Where they differ, and why", tuple(_differences(material)))
    yield Section("table-1", "Table I as printed", tuple(_misfit(material)))
    yield Section("how", "How this was done", (Paragraph(HOW_DONE), Paragraph(HOW_COMPARED)))


def _simulation(material: Material) -> Iterator[Part]:
    yield from pictures.fig_7(material.results)
    yield from _tables_of(material, (SIMULATION, REPEATABILITY))
    yield from pictures.parameters(material.results)


def _experiment(material: Material) -> Iterator[Part]:
    yield from pictures.fig_8(material.results)
    yield from _tables_of(material, (PROTOTYPE,))
    yield from _present(table_ii(material.comparison))


def _differences(material: Material) -> Iterator[Part]:
    for letter, text in reason_lines(material.comparison.reasons).items():
        yield Paragraph(f"({letter}) {text}")
    yield from pictures.noise(material.comparison, material.evidence)
    yield floor_table(material.evidence)
    yield from _present(geometry_table(material.evidence))
    yield from pictures.lengths(material.evidence)
    if material.evidence.pairs is not None:
        yield Paragraph(material.evidence.pairs.in_words())


def _misfit(material: Material) -> Iterator[Part]:
    yield Paragraph(misfit_in_words(material.evidence.reaches[0]))
    yield pictures.reached(material.evidence)
    yield reach_table(material.evidence)


def _tables_of(material: Material, experiments: Sequence[Experiment]) -> Iterable[Table]:
    """The tables of the experiments' groups."""
    tables = comparison_tables(material.comparison)
    for compared, table in zip(material.comparison.groups, tables, strict=True):
        if compared.group.experiment in experiments:
            yield table


def _present(table: Table | None) -> Iterator[Table]:
    if table is not None:
        yield table
