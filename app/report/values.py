"""Figures of a report as programs and spreadsheets take them: one row each, in `--csv`, `--json`.

Figures that cannot be compared stand in rows of their own, so that a table of many campaigns is the
files one below the other. Numbers are those of the page before rounding.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Literal

from app.report.tables import STAGES, error_rows
from campaigns.assessment import Evaluation
from campaigns.evaluation.decision import COVERAGE, Verdict
from campaigns.files.table import Column, csv_table, words
from campaigns.identification.result import IdentificationResult
from campaigns.kinematics.parameters import ParameterTable

Table = Literal["verdict", "limits", "stages", "errors", "budget", "parameters"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportedValue:
    """Figure of a campaign with its uncertainty, and what it is compared with."""

    table: Table
    """Part of the page: the verdict, limits, both stages' figures, errors, budget, parameters."""
    name: str
    """What it is of, without blanks: `distances_mean_error`, `arm0.x_mm`."""
    stage: str = ""
    """`before` or `after` calibration, or `change`: after minus before; empty for others."""
    unit: str = ""
    value: float | None = None
    """None: it was not measured."""
    std: float | None = None
    """1 σ; None: not determined, or not stated as such."""
    expanded_uncertainty: float | None = None
    """U = k u; None: unknown."""
    nominal: float | None = None
    """Nominal value of a parameter; None for others."""
    limit: float | None = None
    """Specified limit; None: there is none."""
    decision: Verdict | None = None
    """Decision by the limit; None without one."""
    type: Literal["A", "B"] | None = None
    """How a row of the budget is estimated, GUM's two types; None for others."""


Row = tuple[str, ReportedValue]
"""Name of the campaign, and a figure of it."""
COLUMNS: tuple[Column[Row], ...] = (
    words("campaign", lambda row: row[0]),
    words("table", lambda row: row[1].table),
    words("name", lambda row: row[1].name),
    words("stage", lambda row: row[1].stage),
    words("unit", lambda row: row[1].unit),
    Column("value", lambda row: row[1].value),
    Column("std", lambda row: row[1].std),
    Column("expanded_uncertainty", lambda row: row[1].expanded_uncertainty),
    Column("nominal", lambda row: row[1].nominal),
    Column("limit", lambda row: row[1].limit),
    words("decision", lambda row: row[1].decision or ""),
    words("type", lambda row: row[1].type or ""),
)
"""Columns of the CSV file."""


def values_csv(campaign: str, values: tuple[ReportedValue, ...]) -> str:
    """Write the figures of a campaign as a CSV file's text, a row each."""
    return csv_table(COLUMNS, ((campaign, value) for value in values))


def reported_values(evaluation: Evaluation) -> tuple[ReportedValue, ...]:
    """Return the figures of the page's tables: verdict, limits, errors, budget and parameters."""
    # In the order of the page, so that a row is found there too.
    evidence = evaluation.evidence
    values = [ReportedValue(table="verdict", name="campaign", decision=evaluation.verdict.decision)]
    values += [*_limits(evaluation), *_stages(evaluation), *_errors(evaluation)]
    if (identification := evidence.identification) is not None:
        table = evidence.campaign.robot.mechanism.parameters
        values += [*_budget(identification), *_parameters(identification, table)]
    return tuple(values)


def _limits(evaluation: Evaluation) -> Iterator[ReportedValue]:
    """Yield the figures that are judged, also those that were not measured."""
    for requirement in evaluation.verdict.requirements:
        is_measured = requirement.error is not None
        yield ReportedValue(
            table="limits",
            name=_name(requirement.name),
            stage="after",
            unit="mm",
            value=requirement.error,
            std=requirement.standard_uncertainty if is_measured else None,
            expanded_uncertainty=requirement.expanded_uncertainty,
            limit=requirement.limit,
            decision=requirement.decision,
        )


def _stages(evaluation: Evaluation) -> Iterator[ReportedValue]:
    """Yield the figures of the commanded robot before and after, and by how much they changed."""
    for stage, result in zip(STAGES, (evaluation.before, evaluation.after), strict=True):
        for name, length in (result.figures() if result else {}).items():
            if length is not None:
                yield ReportedValue(
                    table="stages",
                    name=_name(name),
                    stage=stage,
                    unit="mm",
                    value=length.value_mm,
                    std=length.standard_uncertainty_mm,
                    expanded_uncertainty=length.expanded_uncertainty_mm,
                )
    # U of a difference is its own: errors of the instrument common to both stages cancel in it.
    for gain in evaluation.gains:
        if gain.before is not None and gain.after is not None:
            yield ReportedValue(
                table="stages",
                name=_name(gain.name),
                stage="change",
                unit="mm",
                value=gain.after.value_mm - gain.before.value_mm,
                expanded_uncertainty=gain.expanded_uncertainty_mm,
            )


def _errors(evaluation: Evaluation) -> Iterator[ReportedValue]:
    """Yield the statistics of each set of errors: their number, and mean, σ, largest and P95."""
    for of, stage, summary in error_rows(evaluation):
        for statistic, value in asdict(summary).items():
            yield ReportedValue(
                table="errors",
                name=f"{_name(of)}_{statistic}",
                stage=stage,
                unit="" if statistic == "n" else "mm",
                value=value,
            )


def _budget(identification: IdentificationResult) -> Iterator[ReportedValue]:
    """Yield 1 σ of positions by each source, and of all together."""
    # Shares add up in squares: the last row is their root, as the page's table ends.
    shares = identification.uncertainty.budget
    for share in shares:
        yield ReportedValue(
            table="budget", name=_name(share.source), unit="mm", std=share.mm, type=share.kind
        )
    if shares:
        combined_mm = math.hypot(*(share.mm for share in shares))
        yield ReportedValue(table="budget", name="combined", unit="mm", std=combined_mm)


def _parameters(
    identification: IdentificationResult, table: ParameterTable
) -> Iterator[ReportedValue]:
    """Yield the parameters in their files' units; those that were held have no σ."""
    # U by k = 2 as on the page; a parameter that was held has neither σ nor U, and empty cells.
    for name, parameter in identification.value.parameters.items():
        std = parameter.std
        yield ReportedValue(
            table="parameters",
            name=name,
            unit=table[name].unit,
            value=parameter.value,
            std=std,
            expanded_uncertainty=None if std is None else COVERAGE * std,
            nominal=parameter.nominal,
        )


def _name(words_of: str) -> str:
    """Return words as a name for programs: without blanks and signs, in small letters."""
    return "_".join(re.findall(r"[^\W_]+", words_of.lower()))
