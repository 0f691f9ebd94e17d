"""Output of a study: tables for people and programs, and what the stated σ are worth."""

from collections import Counter
from collections.abc import Iterator, Sequence

from app.console import WARNING, Terminal
from app.study.running import Studied
from campaigns.files.table import Column, csv_table
from campaigns.studies.summary import ParameterSummary, StudySummary

SCHEMA = "pkmcal/study/3"
NAMED = 3
"""Parameters whose σ is wrong, and failures, that are named in a line."""
PERCENT = 100.0
EXPLAINED = "ratio: σ found over σ stated; 95 %: share of intervals that hold the truth"
SHOWN: tuple[Column[ParameterSummary], ...] = (
    Column("", lambda p: p.name, kind="words"),
    Column("bias", lambda p: p.bias, decimals=5, signed=True),
    Column("σ found", lambda p: p.std, decimals=5),
    Column("stated", lambda p: p.stated_std, decimals=5),
    Column("ratio", lambda p: p.ratio),
    Column("95 %", lambda p: PERCENT * p.covered, decimals=1),
)
"""A row a parameter, mm and deg."""
TABLE: tuple[Column[ParameterSummary], ...] = (
    Column("parameter", lambda p: p.name, kind="words"),
    Column("bias", lambda p: p.bias),
    Column("std", lambda p: p.std),
    Column("stated_std", lambda p: p.stated_std),
    Column("ratio", lambda p: p.ratio),
    Column("covered_95", lambda p: p.covered),
)
"""The same for programs."""


def csv(summary: StudySummary) -> str:
    """Table for programs, a row a parameter."""
    return csv_table(TABLE, summary.parameters)


def document(studied: Studied, summary: StudySummary) -> dict[str, object]:
    """What is in `pkmcal/study/3`."""
    setup, head = studied.study.setup, studied.study.table_head()
    return {
        "schema": SCHEMA,
        **studied.study.words,
        "study": head["study"],
        "seed": setup.seed,
        "shots": len(setup.shots),
        "campaigns": summary.campaigns,
        "failed": summary.failed,
        "computed": studied.computed,
        "lost": studied.lost,
        "parameters": {
            p.name: {column.head: column.of(p) for column in TABLE[1:]} for p in summary.parameters
        },
        "chance": {"ratio": summary.chance.ratio, "covered_95": summary.chance.covered},
        "position_mm": summary.position_mm,
        "stated_mm": summary.stated_mm,
    }


def show(terminal: Terminal, studied: Studied, summary: StudySummary) -> None:
    """Show parameters, positions, and whether the stated σ are true."""
    terminal.rows("Errors of the parameters (mm, deg)", SHOWN, summary.parameters)
    terminal.note(EXPLAINED)
    terminal.say(
        f"positions over the workspace (rms): real {summary.position_mm:.4f} mm, stated "
        f"{summary.stated_mm:.4f} mm, ratio {summary.position_mm / summary.stated_mm:.3f}"
    )
    terminal.say(honesty(summary), WARNING if summary.too_sure else "")
    for line in shortcomings(studied):
        terminal.say(line, WARNING)


def honesty(summary: StudySummary) -> str:
    """What the study says of the stated σ, in a line."""
    if summary.too_sure:
        worst = sorted(summary.too_sure, key=lambda p: p.ratio, reverse=True)
        return f"stated σ are too small: {_named(worst)}"
    if summary.too_unsure:
        worst = sorted(summary.too_unsure, key=lambda p: p.ratio)
        return f"stated σ are larger than need be: {_named(worst)}"
    low, high = summary.chance.ratio
    return (
        f"stated σ are true, as far as {summary.campaigns} campaigns tell "
        f"(ratios from {max(low, 0.0):.3f} to {high:.3f} may be chance)"
    )


def shortcomings(studied: Studied) -> Iterator[str]:
    """How many campaigns ended without an answer, or never came back; why, and what next."""
    reasons = Counter(row.failure for row in studied.rows if row.failure)
    if reasons:
        worded = "; ".join(f"{count} × {reason}" for reason, count in reasons.most_common(NAMED))
        yield f"{sum(reasons.values())} campaigns without an answer: {worded}"
    if studied.lost:
        why = "; ".join(studied.reasons[:NAMED])
        yield f"{studied.lost} campaigns lost: {why} → the same command tries them again"


def _named(parameters: Sequence[ParameterSummary]) -> str:
    named = [f"{p.name} found {p.ratio:.2f} × stated" for p in parameters[:NAMED]]
    more = len(parameters) - len(named)
    return ", ".join([*named, *([f"and {more} more"] if more else [])])
