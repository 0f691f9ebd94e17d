"""Sections of the page on the model: findings, parameters, uncertainty budget."""

from app.report import figures
from app.report import model_tables as tables
from app.report.section import NO_IDENTIFICATION, Section
from campaigns.evidence import Evaluation

STRONGEST = 8
"""Number of correlations that are listed."""


def findings_section(evaluation: Evaluation) -> Section:
    """Return the section on the findings of the identification."""
    section = Section("findings", "Findings")
    found = evaluation.evidence.identification
    if found is None:
        section.lack(NO_IDENTIFICATION)
    elif found.findings:
        section.table(
            "Findings of the identification",
            tables.FINDINGS,
            found.findings,
            "Accepted: somebody took the result with it (`--accept-large-change`).",
        )
    else:
        section.note("The identification has no findings.")
    return section


def parameters_section(evaluation: Evaluation) -> Section:
    """Return the section on the parameters and their correlations."""
    section = Section("parameters", "Parameters")
    found = evaluation.evidence.identification
    if found is None:
        section.lack(NO_IDENTIFICATION)
        return section
    parameters = evaluation.evidence.campaign.robot.mechanism.parameters
    section.text(*tables.in_words(found))
    section.table(
        "Parameters old and new",
        tables.parameters(parameters),
        found.parameters.items(),
        "σ: one standard deviation. Within U: |Δ| is not larger than U = 2 σ, so no change is "
        "shown. Held: not fitted, kept at nominal.",
    )
    if found.undetermined:
        title = "Determined by no shot, and kept at nominal"
        section.table(title, tables.UNDETERMINED, found.undetermined)
    if found.covariance is None:
        section.lack("The identification states no correlations.")
        return section
    known = tables.of_geometry(found.covariance, parameters)
    section.table("Strongest correlations", tables.CORRELATIONS, known.strongest(STRONGEST))
    section.figure(
        "correlations",
        "Correlations of the identified parameters",
        figures.correlation_map(known),
        "The darker, the less these shots separate two parameters.",
    )
    return section


def budget_section(evaluation: Evaluation) -> Section | None:
    """Return the section on the uncertainty of positions; None if nothing was identified."""
    found = evaluation.evidence.identification
    if found is None or not found.budget:
        return None
    section = Section("budget", "Uncertainty of positions")
    section.table(
        "Uncertainty budget of positions",
        tables.BUDGET,
        tables.budget_rows(found),
        "1 σ of a position by the identified parameters, rms over the workspace. Type A: estimated "
        "from the scatter of these shots; B: stated or known before. The rows add up in squares to "
        "the combined σ.",
    )
    section.text(*tables.positions_in_words(found))
    return section
