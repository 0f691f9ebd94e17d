"""pkmcal plan: where to measure."""

import shlex
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from app.options import Fix, Folder, Free, Json, Plot, identifying_words
from app.planning import Placement, PlanOptions, make
from campaigns.estimation.estimators import Estimator

if TYPE_CHECKING:
    from pathlib import Path

    from app.console import Terminal
    from app.folder import Campaign
    from app.plan_precision_text import PlanForecast
    from campaigns.planning.plan_check import CheckedPlan

Shots = Annotated[
    int | None,
    typer.Option(
        min=2,
        metavar="N",
        help="Shots to identify from, two a pair, others on top; with --until the most allowed.",
    ),
]
Placed = Annotated[
    Placement | None,
    typer.Option(
        help="boundary: near the limits of the workspace, as in the paper. optimal: those of "
        "thousands of candidates that tell most together."
    ),
]
Until = Annotated[
    str | None,
    typer.Option(
        metavar="GOAL",
        help="Optimal, and as few shots as bring every length to this σ, such as σ=0.02.",
    ),
]
Criterion = Annotated[
    Literal["I", "D", "A", "E"] | None,
    typer.Option(
        help="Optimal for what. I: positions all over the workspace, the default. D: all "
        "parameters together. A: each of them, on average. E: what is known worst."
    ),
]
Candidates = Annotated[
    int | None,
    typer.Option(
        min=100, max=20_000, metavar="N", help="Optimal, of so many poses; 4000 unless told."
    ),
]
UsedBy = Annotated[
    Estimator,
    typer.Option(
        help="By what identify will use the shots. points: all their coordinates. distances: "
        "those of pairs, as in the paper."
    ),
]
Seed = Annotated[
    int | None, typer.Option(min=0, metavar="N", help="Another seed than campaign.yaml's.")
]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    shots: Shots = None,
    placement: Placed = None,
    until: Until = None,
    criterion: Criterion = None,
    candidates: Candidates = None,
    estimator: UsedBy = Estimator.POINTS,
    free: Free = None,
    fix: Fix = None,
    seed: Seed = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Choose the poses and write plan.csv.

    Pairs to identify from, pairs all over the workspace that stay unseen by the fit, and one pose
    at start, middle and end that shows drift. Every pose and every way is checked.

    Says before anything moves how well parameters and positions will be known, and, where shots
    are chosen, when more of them stop paying. Defaults stand under `plan` in campaign.yaml.
    plan.csv may be edited and is checked again; an older one is kept.
    """
    from app.console import terminal_of
    from app.folder import open_campaign

    knowledge = tuple(free or ()), tuple(fix or ())
    asked = PlanOptions(shots, placement, until, criterion, candidates, estimator, *knowledge, seed)
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    checked, forecast = make(campaign, asked)
    show(terminal, checked, forecast)
    terminal.say(f"written: {campaign.plan_path}")
    if plot is not None:
        draw(plot, checked, forecast)
        terminal.say(f"drawn: {plot}")
    validation = shlex.join(["pkmcal", "validate", str(folder), "--stage", "before"])
    options = identifying_words(estimator, *knowledge)
    terminal.note(f"next: {validation}, {shlex.join(['pkmcal', 'run', str(folder), *options])}")
    terminal.document(plan_document(campaign, checked, forecast))


def plan_document(
    campaign: "Campaign", checked: "CheckedPlan", forecast: "PlanForecast"
) -> dict[str, object]:
    """The plan as `--json` prints it."""
    from app.plan_precision_text import precision_document
    from campaigns.planning.plans import pairs_of
    from campaigns.shots.shot_sets import ShotSet

    pairs = len(pairs_of(checked.shots, ShotSet.IDENTIFICATION))
    return {
        "shots": 2 * pairs,
        "pairs": pairs,
        **precision_document(forecast),
        "seconds_estimated": checked.seconds,
        "path": str(campaign.plan_path),
    }


def show(terminal: "Terminal", checked: "CheckedPlan", forecast: "PlanForecast") -> None:
    """The plan for people: picture, what it will tell, what it takes."""
    from app.plan_precision_text import show_precision
    from app.terminal_picture import plan_picture

    for line in plan_picture(checked.shots):
        terminal.say(line)
    show_precision(terminal, forecast)
    terminal.say(f"{plan_line(checked)}; {checked.detours} ways go round something")


def draw(path: "Path", checked: "CheckedPlan", forecast: "PlanForecast") -> None:
    """The same as a picture; raises `WriteFailed`."""
    from app.report.plots import plot_plan

    plot_plan(path, checked.shots, forecast.foresight.expected, forecast.curve)


def plan_line(checked: "CheckedPlan") -> str:
    """What a plan holds and takes, in one line."""
    from collections import Counter

    from app.progress import interval

    counts = Counter(shot.purpose.value for shot in checked.shots)
    sets = ", ".join(f"{count} {purpose}" for purpose, count in counts.items())
    took = interval((checked.seconds, checked.seconds))
    return f"{len(checked.shots)} shots ({sets}), about {took}"
