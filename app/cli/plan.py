"""pkmcal plan: where to measure."""

import shlex
from typing import Annotated

import typer

from app.console import WARNING, Terminal, terminal_of
from app.options import Fix, Folder, Free, Json, ModelOption, Plot
from app.plan_text import (
    plan_line,
    plate_warning,
    precision_document,
    refusals_document,
    refusals_lines,
    show_precision,
)
from app.terminal_picture import plan_picture
from campaigns.campaign import Campaign, open_campaign
from campaigns.chain.planning import PlannedCampaign, plan
from campaigns.design.criteria import CriterionName
from campaigns.estimation.estimators import Estimator, Model
from campaigns.options import PlanOptions
from campaigns.planning.plans import Placement, pairs_of
from campaigns.shots.shot_sets import ShotSet

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
    CriterionName | None,
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
Scatter = Annotated[
    float,
    typer.Option(
        metavar="MM",
        help="The robot's own scatter (1 σ) where it is known, as `identify` has told it.",
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
    model: ModelOption = Model.STANDARD,
    free: Free = None,
    fix: Fix = None,
    scatter: Scatter = 0.0,
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
    options = PlanOptions(
        estimator=estimator,
        model=model,
        free=tuple(free or ()),
        fix=tuple(fix or ()),
        shots=shots,
        placement=placement,
        until=until,
        criterion=criterion,
        candidates=candidates,
        scatter_mm=scatter,
        seed=seed,
    )
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    planned = plan(campaign, options)
    show(terminal, campaign, planned)
    terminal.say(f"written: {campaign.plan_path}")
    if plot is not None:
        from app.report.plots import plot_plan  # matplotlib takes longer than a plan

        precision = planned.forecast.precision.predicted
        plot_plan(plot, planned.checked.shots, precision, planned.forecast.curve, campaign.space)
        terminal.say(f"drawn: {plot}")
    validation = shlex.join(["pkmcal", "validate", str(folder), "--stage", "before"])
    run = shlex.join(["pkmcal", "run", str(folder), *options.words()])
    terminal.note(f"next: {validation}, {run}")
    terminal.document(plan_document(campaign, planned))


def plan_document(campaign: Campaign, planned: PlannedCampaign) -> dict[str, object]:
    """Plan as `--json` prints it."""
    pairs = len(pairs_of(planned.checked.shots, ShotSet.IDENTIFICATION))
    return {
        "shots": 2 * pairs,
        "pairs": pairs,
        **precision_document(planned.forecast),
        "space": None if planned.refusals is None else refusals_document(planned.refusals),
        "seconds_estimated": planned.checked.seconds,
        "path": str(campaign.plan_path),
    }


def show(terminal: Terminal, campaign: Campaign, planned: PlannedCampaign) -> None:
    """Plan for people: picture, what it will tell, what it takes."""
    for line in plan_picture(planned.checked.shots):
        terminal.say(line)
    if planned.refusals is not None:
        for line in refusals_lines(campaign.space, planned.refusals):
            terminal.say(line)
    if warning := plate_warning(campaign.space):
        terminal.say(warning, WARNING)
    show_precision(terminal, planned.forecast)
    detours = planned.checked.detours
    terminal.say(f"{plan_line(planned.checked)}; {detours} ways go round something")
