"""pkmcal study: many simulated campaigns, to see how good a plan and how honest its σ is."""

import time
from collections.abc import Sequence
from json import dumps as json_text
from pathlib import Path

import typer
from rich.console import Console

from app.console import WARNING, Terminal, terminal_of
from app.exits import Exit
from app.options import Folder, Json, Plot
from app.progress import CountedWork
from app.study.errors import Errors, compare
from app.study.running import run_study
from app.study.setup import CHOICES, Combination, StudyOptions, combinations, left_out
from app.study.verdicts import Verdicts, sized_verdicts
from app.study.workers import workers_of
from campaigns.campaign import Campaign, now_utc, open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.files.lock import campaign_lock
from campaigns.files.text_file import make_folder, replace_text

OUTPUTS = "study"


def command(
    context: typer.Context,
    folder: Folder,
    options: StudyOptions,
    *,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Simulate many campaigns for every plan, scenario, estimator and model named.

    Each campaign draws a robot and the tracker's noise, nothing else: effects that no parameter
    describes (rods, backlash, warm arms) are shown by `pkmcal dry-run`. The study shows whether
    the stated σ are true, how close they come to the least that the shots allow, and the error
    that remains elsewhere.

    --effects adds a fault to each campaign (a step of an encoder, a bumped stand, wrong shots,
    unequal rods, …), identifies it as `pkmcal identify` does, and counts how often a "pass" is
    wrong and how often the cause is named.

    The same command resumes; a larger N adds campaigns. Results depend on the seed, not on the
    workers. Exit code 1: campaigns were lost with their workers.
    """
    terminal, opened = terminal_of(context, as_json=json), open_campaign(folder)
    _check_together(options, plot)
    to = options.to or opened.path(OUTPUTS)
    document, found = study(opened, options, to, terminal)
    found.show(terminal)
    terminal.say(f"written: {to}")
    if plot is not None and isinstance(found, Errors):
        draw(terminal, found, plot)
    terminal.document(document)
    if document["lost"]:
        raise typer.Exit(Exit.NOT_GOOD)


def _check_together(asked: StudyOptions, plot: Path | None) -> None:
    """Raise `OptionsInvalid` for what is for effects alone, or not for them."""
    if asked.effects:
        if plot is not None:
            raise OptionsInvalid(
                "--plot draws no effects", remedy="leave it out; the table is in effects.csv"
            )
    elif chosen := CHOICES & {*asked.model}:
        raise OptionsInvalid(
            f"--model {min(chosen)} finds other parameters in each campaign, whose σ don't compare",
            remedy="name one, such as --model full, or study the choice with --effects",
        )


def study(
    campaign: Campaign, asked: StudyOptions, to: Path, terminal: Terminal
) -> tuple[dict[str, object], Errors | Verdicts]:
    """Run what the tables in `to` lack, with their folder held, and write what all of it shows."""
    began_s = time.monotonic()
    found, results_of = combinations(campaign, asked, to), workers_of(asked.workers)
    tell_what_is_left_out(terminal, found)
    make_folder(to)
    with campaign_lock(to, now_utc=now_utc):
        studied = run_study(found, range(asked.campaigns), results_of, counting)
        summary: Errors | Verdicts
        summary = (
            Verdicts((*sized_verdicts(studied),)) if asked.effects else Errors(compare(studied))
        )
        document = summary.document() | {
            "seed": asked.seed,
            "computed": sum(one.computed for one in studied),
            "lost": sum(one.lost for one in studied),
            "seconds": time.monotonic() - began_s,
            "path": str(to),
        }
        replace_text(to / summary.table_name, summary.csv())
        text = json_text(document, allow_nan=False, indent=1)
        replace_text(to / summary.document_name, f"{text}\n")
    return document, summary


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


def draw(terminal: Terminal, errors: Errors, path: Path) -> None:
    """Draw errors, coverage and what is left; raises `WriteFailed`."""
    from app.report.figures.drawing import save  # matplotlib only where it is used
    from app.study.pictures import study_picture

    save(study_picture(errors.compared), path)
    terminal.say(f"drawn: {path}")
