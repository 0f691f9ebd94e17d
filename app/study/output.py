"""Output of a study: tables for people and programs, and whether the stated σ are true."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.console import WARNING, Terminal
from app.study.running import Studied
from campaigns.files.table import Column, csv_table
from campaigns.files.wording import listed
from campaigns.studies.summary import CONFIDENCE, ParameterSummary, StudySummary

MOST_NAMED = 3
"""Parameters whose σ is wrong, and failures, that are named in a line."""
SHOWN: tuple[Column[ParameterSummary], ...] = (
    Column("", lambda p: p.name, kind="words"),
    Column("bias", lambda p: p.bias, decimals=5, signed=True),
    Column("σ found", lambda p: p.std, decimals=5),
    Column("stated", lambda p: p.stated_std, decimals=5),
    Column("ratio", lambda p: p.ratio),
    Column("95 %", lambda p: 100.0 * p.covered, decimals=1),
)
"""Columns on the screen, with a row for each parameter, mm and deg."""
TABLE: tuple[Column[ParameterSummary], ...] = (
    Column("parameter", lambda p: p.name, kind="words"),
    Column("bias", lambda p: p.bias),
    Column("std", lambda p: p.std),
    Column("stated_std", lambda p: p.stated_std),
    Column("ratio", lambda p: p.ratio),
    Column("covered_95", lambda p: p.covered),
)
"""Columns of the .csv file and of the .json file."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyAnswer:
    """Answer of `study`, and what is in its .json file."""

    schema: str = "pkmcal/study/3"
    plan: str
    scenario: str
    study: object
    seed: int
    shots: int
    campaigns: int
    failed: int
    computed: int
    lost: int
    parameters: Mapping[str, Mapping[str, object]]
    """Figures of each parameter, as in the .csv file."""
    unseen: Sequence[str]
    """Names of the parameters without figures, for no shot shows them."""
    chance: Mapping[str, Sequence[float]]
    """Limits in which an honest study's figures lie."""
    position_mm: float
    stated_mm: float
    seconds: float
    path: Path


def csv(summary: StudySummary) -> str:
    """Return the table for programs, a row a parameter."""
    return csv_table(TABLE, summary.parameters)


def study_answer(
    studied: Studied, summary: StudySummary, path: Path, seconds: float
) -> StudyAnswer:
    """Return the result for programs."""
    study = studied.study
    return StudyAnswer(
        plan=study.plan,
        scenario=study.scenario.name,
        study=study.table_head()["study"],
        seed=study.setup.seed,
        shots=len(study.setup.shots),
        campaigns=summary.campaigns,
        failed=summary.failed,
        computed=studied.computed,
        lost=studied.lost,
        parameters={
            p.name: {column.head: column.of(p) for column in TABLE[1:]} for p in summary.parameters
        },
        unseen=summary.unseen,
        chance=summary.chance,
        position_mm=summary.position_mm,
        stated_mm=summary.stated_mm,
        seconds=seconds,
        path=path,
    )


def show(terminal: Terminal, studied: Studied, summary: StudySummary) -> None:
    """Show parameters, positions, and whether the stated σ are true."""
    terminal.rows("Errors of the parameters (mm, deg)", SHOWN, summary.parameters)
    terminal.note("ratio: σ found over σ stated; 95 %: share of intervals that hold the truth")
    if summary.unseen:
        terminal.note(f"without figures, for no shot shows them: {', '.join(summary.unseen)}")
    terminal.say(
        f"positions over the workspace (rms): real {summary.position_mm:.4f} mm, stated "
        f"{summary.stated_mm:.4f} mm, ratio {summary.position_mm / summary.stated_mm:.3f}"
    )
    terminal.say(honesty(summary), WARNING if summary.too_sure else "")
    for line in shortcomings(studied):
        terminal.say(line, WARNING)


def honesty(summary: StudySummary) -> str:
    """Say in a line whether the stated σ are true, with the figures that show it."""
    # Too small comes first: a σ that promises too much does harm, one that is too large only costs.
    low, high = summary.chance["ratio"]
    if summary.too_sure:
        worst = sorted(summary.too_sure, key=lambda p: p.ratio, reverse=True)
        words = [_figure(p, by_ratio=p.ratio > high) for p in worst]
        return f"stated σ are too small: {listed(words, MOST_NAMED)}"
    if summary.too_unsure:
        worst = sorted(summary.too_unsure, key=lambda p: p.ratio)
        words = [_figure(p, by_ratio=p.ratio < low) for p in worst]
        return f"stated σ are larger than need be: {listed(words, MOST_NAMED)}"
    span = f"from {low:.3f} to {high:.3f}" if low > 0.0 else f"up to {high:.3f}"
    return (
        f"stated σ are true, as far as {summary.campaigns} campaigns show "
        f"(ratios {span} may be chance)"
    )


def _figure(parameter: ParameterSummary, *, by_ratio: bool) -> str:
    """Return a parameter's name with the figure that lies beyond chance."""
    if by_ratio:
        return f"{parameter.name} found {parameter.ratio:.2f} × stated"
    return f"{parameter.name} covered {parameter.covered:.2f} of {CONFIDENCE:.2f}"


def shortcomings(studied: Studied) -> Iterator[str]:
    """Yield the numbers of campaigns that have no estimate or were lost, why, and a remedy."""
    # Campaigns without an answer are an outcome: the same seed fails again. Lost ones are not.
    reasons = Counter(row.failure for row in studied.rows if row.failure)
    if reasons:
        worded = "; ".join(
            f"{count} × {reason}" for reason, count in reasons.most_common(MOST_NAMED)
        )
        yield f"{sum(reasons.values())} campaigns without an answer: {worded}"
    if studied.lost:
        why = "; ".join(studied.reasons[:MOST_NAMED])
        yield f"{studied.lost} campaigns lost: {why} → the same command tries them again"
