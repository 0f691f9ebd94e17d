"""pkmcal study: many simulated campaigns, to see how good a plan and how honest its σ is."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from app.console import WARNING, Terminal, terminal_of
from app.exits import Exit
from app.options import Folder, Json, Plot
from app.progress import CountedWork
from app.study import tables
from app.study.combinations import Combination, combinations, told_words
from app.study.comparison import Compared, compare, comparison_csv
from app.study.document import document_text, study_document
from app.study.effects import (
    EXPLAINED,
    StudiedEffect,
    effect_combinations,
    effect_names,
    effect_table,
    effects_csv,
    effects_document,
    run_effect_study,
    wrong_by_method,
)
from app.study.running import run_study
from app.study.setup import CHOICES, StudyOptions, left_out
from app.study.workers import workers_of
from campaigns.campaign import Campaign, now_utc, open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, Model, Weights
from campaigns.files.lock import campaign_lock
from campaigns.files.text_file import make_folder, replace_text
from campaigns.identification.options import Fixed, Freed

MOST_CAMPAIGNS = 1_000_000
OUTPUTS = "study"
COMPARISON, DOCUMENT = "comparison.csv", "study.json"
EFFECTS_TABLE, EFFECTS_DOCUMENT = "effects.csv", "effects.json"
"""What is written into the folder beside the tables."""

Campaigns = Annotated[
    int,
    typer.Option(
        min=2,
        max=MOST_CAMPAIGNS,
        metavar="N",
        help="Campaigns of each combination, those already there included.",
    ),
]
Plans = Annotated[
    list[Path] | None,
    typer.Option("--plan", metavar="FILE", help="A plan, if not the plan.csv in DIR; repeatable."),
]
Scenarios = Annotated[
    list[str] | None,
    typer.Option(
        "--scenario",
        metavar="NAME",
        help="What robots and noise to draw, if not by the campaign's own cell; repeatable.",
    ),
]
Estimators = Annotated[
    list[Estimator] | None,
    typer.Option(
        "--estimator", help="What the fits compare; repeatable.", show_default=Estimator.POINTS
    ),
]
WeightsOfDistances = Annotated[
    list[Weights] | None,
    typer.Option("--weights", help="How distances count; repeatable.", show_default=Weights.STATED),
]
Models = Annotated[
    list[Model] | None,
    typer.Option(
        "--model",
        help="What the fits find; repeatable. auto and extended: with --effects.",
        show_default=Model.STANDARD,
    ),
]
Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effects",
        metavar="all|NAME",
        help="What goes wrong in the campaigns: is a pass then wrong? Repeatable.",
        show_default="nothing",
    ),
]
Workers = Annotated[
    str | None,
    typer.Option(
        metavar="N|URL",
        help="Local processes, or the scheduler of a Dask cluster as tcp://HOST:PORT.",
        show_default="one a processor",
    ),
]
SeedOfAll = Annotated[int, typer.Option(min=0, metavar="N", help="Seed of all that is drawn.")]
To = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Where tables go, if not DIR/study.")
]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    campaigns: Campaigns,
    plan: Plans = None,
    scenario: Scenarios = None,
    estimator: Estimators = None,
    weights: WeightsOfDistances = None,
    effects: Effects = None,
    model: Models = None,
    free: Freed = (),
    fix: Fixed = (),
    seed: SeedOfAll = 1,
    workers: Workers = None,
    to: To = None,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Simulate and identify many campaigns, by every plan, scenario, estimator and model named.

    Each draws a robot and the tracker's noise, and that is all there is: what no parameter of the
    model describes (rods, backlash, warm arms) is for `pkmcal dry-run` to show. Tells whether the
    stated σ are true, how near they come to the least that the shots allow, and what is left
    elsewhere.

    --effects lets something go wrong in each (a step of an encoder, a bumped stand, wrong shots,
    unequal rods, …), identifies it as `pkmcal identify` does, and tells how often a "pass" is wrong
    and how often the cause is named.

    The same command goes on where it was stopped; a larger N adds campaigns. Numbers depend on the
    seed, not on the workers. Exit code 1: campaigns were lost with their workers.
    """
    terminal, opened = terminal_of(context, as_json=json), open_campaign(folder)
    asked = StudyOptions(
        plans=plan or (),
        scenarios=scenario or (),
        estimators=estimator or (),
        freed=free,
        fixed=fix,
        seed=seed,
        weights=weights or (),
        models=model or (),
    )
    goal = Goal(campaigns, workers, to or opened.path(OUTPUTS))
    if effects:
        if plot is not None:
            raise OptionsInvalid(
                "--plot draws no effects", remedy="leave it out; the table is in effects.csv"
            )
        told = study_effects(opened, asked, effect_names(effects), goal, terminal)
        terminal.document(told)
        if told["lost"]:
            raise typer.Exit(Exit.NOT_GOOD)
        return
    if chosen := CHOICES & {*asked.models}:
        raise OptionsInvalid(
            f"--model {min(chosen)} finds other parameters in each campaign, whose σ don't compare",
            remedy="name one, such as --model full, or study the choice with --effects",
        )
    document, compared = study(opened, asked, goal, terminal)
    show(terminal, compared)
    if plot is not None:
        draw(terminal, compared, plot)
    terminal.document(document)
    if document["lost"]:
        raise typer.Exit(Exit.NOT_GOOD)


@dataclass(frozen=True, slots=True)
class Goal:
    """How many campaigns of each combination there shall be, by whom, and where."""

    campaigns: int
    workers: str | None
    to: Path


def study(
    campaign: Campaign, asked: StudyOptions, goal: Goal, terminal: Terminal
) -> tuple[dict[str, object], tuple[Compared, ...]]:
    """Run what the tables lack, with their folder held, and write what all of it shows."""
    began_s = time.monotonic()
    found, results_of = combinations(campaign, asked, goal.to), workers_of(goal.workers)
    tell_what_is_left_out(terminal, found)
    make_folder(goal.to)
    with campaign_lock(goal.to, now_utc=now_utc):
        studied = run_study(found, range(goal.campaigns), results_of, counting)
        compared = compare(studied)
        told = study_document(compared, asked.seed, time.monotonic() - began_s)
        document = told | {"path": str(goal.to)}
        replace_text(goal.to / COMPARISON, comparison_csv(compared))
        replace_text(goal.to / DOCUMENT, document_text(document))
    return document, compared


def study_effects(
    campaign: Campaign,
    asked: StudyOptions,
    effects: Sequence[str],
    goal: Goal,
    terminal: Terminal,
) -> dict[str, object]:
    """Run what the tables of effects lack, with their folder held, and write what all of it shows.

    Gives the document.
    """
    began_s = time.monotonic()
    found = effect_combinations(campaign, asked, effects, goal.to)
    results_of = workers_of(goal.workers)
    tell_what_is_left_out(terminal, [each.base for each in found])
    make_folder(goal.to)
    with campaign_lock(goal.to, now_utc=now_utc):
        studied = run_effect_study(found, range(goal.campaigns), results_of, counting)
        told = effects_document(studied, asked.seed, time.monotonic() - began_s)
        document = told | {"path": str(goal.to)}
        replace_text(goal.to / EFFECTS_TABLE, effects_csv(studied))
        replace_text(goal.to / EFFECTS_DOCUMENT, document_text(document))
    show_effects(terminal, studied, goal.to)
    return document


def show_effects(terminal: Terminal, studied: Sequence[StudiedEffect], folder: Path) -> None:
    """The table for people, and the sum over all effects."""
    terminal.table('How often is "pass" wrong?', *effect_table(studied))
    terminal.note(EXPLAINED)
    for method, (wrong, campaigns) in wrong_by_method(studied).items():
        terminal.say(f"{method}: {wrong} wrong of {campaigns} campaigns")
    for one in studied:
        words = " · ".join(told_words(one.combination.words))
        if one.found.failed:
            terminal.say(f"{words}: {one.found.failed} campaigns without an answer", WARNING)
        if one.lost:
            reasons = "; ".join(one.reasons[: tables.NAMED])
            again = "the same command tries them again"
            terminal.say(f"{words}: {one.lost} campaigns lost: {reasons} → {again}", WARNING)
    terminal.say(f"written: {folder}")


def counting(total: int, done: int) -> CountedWork:
    """Shows how far the campaigns are."""
    screen = Console(stderr=True, highlight=False)
    return CountedWork(screen, "campaigns", total, done=done, now_s=time.monotonic)


def tell_what_is_left_out(terminal: Terminal, combinations: Sequence[Combination]) -> None:
    """Say what the scenarios have that no campaign of a study has."""
    models = [one.method.model for one in combinations]
    for scenario in {one.scenario.name: one.scenario for one in combinations}.values():
        if effects := left_out(scenario, models):
            terminal.note(f"{scenario.name}: not simulated here: {', '.join(effects)}", WARNING)


def show(terminal: Terminal, compared: Sequence[Compared]) -> None:
    """The result for people: of one combination every parameter, of several the worst of each."""
    if len(compared) == 1:
        rows = tables.parameter_rows(compared[0].summary)
        terminal.table("Errors of the parameters (mm, deg)", tables.PARAMETERS, rows)
    else:
        rows = tables.honesty_rows(compared)
        terminal.table("Errors of the parameters", tables.HONESTY, rows)
    terminal.note(tables.EXPLAINED)
    if unseen := tables.unseen_rows(compared):
        terminal.table("Errors of unseen distances (mm)", tables.UNSEEN, unseen)
    for label, one in zip(tables.labels(compared), compared, strict=True):
        style = WARNING if one.summary.too_sure else ""
        terminal.say(f"{label}: {tables.honesty(one.summary)}", style)
        if one.summary.failed:
            terminal.say(f"{label}: {tables.failures(one)}", WARNING)
        if one.studied.lost:
            terminal.say(f"{label}: {tables.losses(one)}", WARNING)
    terminal.say(f"written: {compared[0].combination.table.path.parent}")


def draw(terminal: Terminal, compared: Sequence[Compared], path: Path) -> None:
    """Draw errors, coverage and what is left; raises `WriteFailed`."""
    from app.report.figures.drawing import save  # matplotlib only where it is used
    from app.study.pictures import study_picture

    save(study_picture(compared), path)
    terminal.say(f"drawn: {path}")
