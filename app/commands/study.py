"""pkmcal study: many simulated campaigns, to see how good a plan and how honest its σ is."""

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Folder, Json

if TYPE_CHECKING:
    from app.console import Terminal
    from app.folder import Campaign
    from app.study.running import Studied
    from campaigns.study import Estimator
    from campaigns.study_summary import StudySummary
    from campaigns.study_table import StudyTable

SCHEMA = "pkmcal/study/1"
TABLE = "study.csv"


class Compared(Enum):
    """What the fits compare; the value is the word on the command line."""

    DISTANCES = "distances"
    POINTS = "points"


def command(
    context: typer.Context,
    folder: Folder,
    *,
    campaigns: Annotated[
        int, typer.Option(min=2, metavar="N", help="How many campaigns there shall be in all.")
    ],
    estimator: Annotated[Compared, typer.Option(help="What the fits compare.")] = Compared.POINTS,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="What robots and noise to draw; else the campaign's own."
        ),
    ] = None,
    free: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Find this parameter too; repeatable.")
    ] = None,
    fix: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Hold this parameter; repeatable.")
    ] = None,
    workers: Annotated[
        str, typer.Option(metavar="N|URL", help="Local processes, or a Dask scheduler's tcp://….")
    ] = "1",
    seed: Annotated[int, typer.Option(min=0, metavar="N", help="Seed of all that is drawn.")] = 1,
    to: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The table, if not study.csv in DIR.")
    ] = None,
    json: Json = False,
) -> None:
    """Simulate and identify many campaigns with the plan of DIR; no device is needed.

    Each campaign draws a robot and the tracker's noise by the scenario. Shots are the model's own:
    what no parameter describes (rods, backlash, warm arms) is not in them. Tells how far off the
    parameters are, and whether the stated standard deviations are true.

    The table has one row a campaign. The same command goes on where it was stopped, and with a
    larger N adds campaigns. The numbers depend on the seed alone, not on the workers.
    """
    from app.commands.identify import free_names
    from app.console import WARNING, terminal_of
    from app.folder import open_campaign

    terminal = terminal_of(context, as_json=json)
    names = free_names(free or (), fix or ())
    asked = Asked(campaigns, estimator.value, scenario, names, workers, seed, to)
    summary, studied, table = study(open_campaign(folder), asked, terminal)
    show(terminal, summary)
    for lost in studied.lost:
        terminal.note(f"lost: {len(lost.numbers)} campaigns ({lost.reason})", WARNING)
    terminal.say(f"written: {table.path}")
    terminal.document(study_document(summary, studied, table))
    if studied.lost:
        terminal.note("next: the same command, for what was lost")
        raise typer.Exit(Exit.NOT_GOOD)


@dataclass(frozen=True, slots=True)
class Asked:
    """What the options say."""

    campaigns: int
    estimator: "Estimator"
    scenario: str | None
    free: tuple[str, ...]
    workers: str
    seed: int
    to: Path | None


def study(
    campaign: "Campaign", asked: Asked, terminal: "Terminal"
) -> "tuple[StudySummary, Studied, StudyTable]":
    """Run what the table lacks, with the campaign held, and look at all of it."""
    from app.folder import held
    from app.study.running import run_study
    from app.study.setup import robots_drawn, study_scenario, study_setup
    from campaigns.study_summary import summarise
    from campaigns.study_table import StudyTable

    drawn = study_scenario(campaign, asked.scenario)
    setup = study_setup(campaign, drawn, asked.estimator, asked.free, asked.seed)
    path = asked.to or campaign.path(TABLE)
    table = StudyTable(path, setup.digest(robots_drawn(drawn)), setup.free)
    wanted = range(asked.campaigns)
    with held(campaign):
        studied = run_study(setup, drawn, table, wanted, asked.workers, terminal.note)
    return summarise(setup, studied.outcomes), studied, table


def show(terminal: "Terminal", summary: "StudySummary") -> None:
    """The result for people."""
    rows = [
        (
            p.name,
            f"{p.bias:+.5f}",
            f"{p.std:.5f}",
            f"{p.stated_std:.5f}",
            f"{p.ratio:.3f}",
            f"{100.0 * p.covered:.1f} %",
        )
        for p in summary.parameters
    ]
    columns = ("", "bias", "σ found", "stated", "ratio", "in 95 %")
    terminal.table("Errors of the parameters (mm, deg)", columns, rows)
    failed = f", {summary.failed} without an answer" if summary.failed else ""
    terminal.say(f"{summary.campaigns} campaigns{failed}")
    if summary.unseen_mean_mm and summary.unseen_max_mm:
        for what, (half, most) in (
            ("mean", summary.unseen_mean_mm),
            ("largest", summary.unseen_max_mm),
        ):
            terminal.say(
                f"{what} error of unseen distances: {half:.4f} mm in half of the campaigns, "
                f"{most:.4f} mm in 95 %"
            )


def study_document(
    summary: "StudySummary", studied: "Studied", table: "StudyTable"
) -> dict[str, object]:
    """The study as `--json` prints it."""
    return {
        "schema": SCHEMA,
        "study": table.study,
        "campaigns": summary.campaigns,
        "failed": summary.failed,
        "lost": sum(len(lost.numbers) for lost in studied.lost),
        "parameters": {
            p.name: {
                "bias": p.bias,
                "std": p.std,
                "stated_std": p.stated_std,
                "ratio": p.ratio,
                "covered_95": p.covered,
            }
            for p in summary.parameters
        },
        "unseen_mean_mm": _quantiles(summary.unseen_mean_mm),
        "unseen_max_mm": _quantiles(summary.unseen_max_mm),
        "computed": studied.computed,
        "seconds": studied.seconds,
        "path": str(table.path),
    }


def _quantiles(values: tuple[float, ...] | None) -> dict[str, float] | None:
    return None if values is None else dict(zip(("median", "q95"), values, strict=True))
