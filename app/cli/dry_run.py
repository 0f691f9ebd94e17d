"""pkmcal dry-run: a whole campaign on a simulated cell."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from app.cli.report import report
from app.console import BAD, Terminal
from app.new_campaign import (
    COMPLETED_ROBOT,
    COMPLETED_SCENARIO,
    DEFAULT_ROBOT,
    DEFAULT_SCENARIO,
    OTHERS_SCENARIO,
    CellChoice,
    create_on_cell,
    trust_typed,
)
from app.next import tell_next
from app.options import Seed
from app.rehearsal import STAGES, heading, rehearse
from app.report.terminal_text import say_gain, say_verdict, show_warnings
from campaigns.assessment import Evaluation
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.evaluation.verdict import JUDGED_FIGURE
from campaigns.identification.options import IdentificationOptions
from drivers.bounded_files import is_there

BETTER = "calibration improved accuracy at independent poses"
NOTHING_TO_CORRECT = "no change shown at poses that were not fitted: there is nothing to correct"
NewFolder = Annotated[
    Path | None, typer.Argument(metavar="DIR", help="Default: a new folder dry-run-N.")
]
Scenario = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="A shipped scenario or a cell file.",
        show_default=f"{DEFAULT_SCENARIO}, or {OTHERS_SCENARIO}",
        autocompletion=COMPLETED_SCENARIO,
    ),
]

Robot = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="The nominal robot: a shipped one, or a robot file. The cell becomes one of its kind.",
        show_default=DEFAULT_ROBOT,
        autocompletion=COMPLETED_ROBOT,
    ),
]


def command(
    terminal: Terminal,
    folder: NewFolder = None,
    *,
    scenario: Scenario = None,
    robot: Robot = None,
    seed: Seed = None,
) -> None:
    """Run a whole campaign without hardware.

    Plan, validate before, run, identify, export, load, validate after. Controller and tracker are
    simulated, but reached through the same drivers and protocols as real ones, and the
    identification has to find the simulated robot's errors. The controller of a new cell computes
    plate tilt and the errors of gears.

    DIR may also be a campaign made by `pkmcal new` on a simulated cell in which nothing has been
    measured: then its settings apply.
    """
    started_s = time.monotonic()
    campaign = prepare_campaign(folder or _free_folder(), scenario, seed, robot)
    rehearsal, reasons_against = rehearse(campaign, terminal, IdentificationOptions())
    # the report is written also of a dry run that ended early: it says what is missing
    heading(terminal, STAGES, "report")
    page, path, _ = report(campaign)
    seconds = time.monotonic() - started_s
    terminal.say("")
    _show_verdict(terminal, page.evaluation, reasons_against)
    terminal.say(f"Open {path.resolve().as_uri()}")
    terminal.say(f"{seconds:.0f} s; everything is in {campaign.folder}")
    following = tell_next(terminal, campaign, reported=True, evaluation=page.evaluation)
    rehearsal.report, rehearsal.seconds = path, seconds
    terminal.conclude(rehearsal, following, is_good=not reasons_against)


def _show_verdict(
    terminal: Terminal, evaluation: Evaluation, reasons_against: Sequence[str]
) -> None:
    """Show the verdict on the campaign first, then its reasons and the gain."""
    verdict = evaluation.verdict
    say_verdict(terminal, verdict)
    for reason in reasons_against:
        terminal.say(f"  not good: {reason}", BAD)
    show_warnings(terminal, evaluation.evidence.warnings)
    if reasons_against:
        return
    say_gain(terminal, evaluation)
    shown = any(gain.shown for gain in evaluation.gains if gain.name == JUDGED_FIGURE)
    terminal.say(f"  {BETTER if shown else NOTHING_TO_CORRECT}")


def prepare_campaign(
    folder: Path, scenario: str | None, seed: int | None, robot: str | None = None
) -> Campaign:
    """Create a campaign on a simulated cell, or open one in which nothing has been measured.

    Raise `OptionsInvalid` for an existing campaign on real devices or with measurements, and for
    one that another robot, scenario or seed is asked of.
    """
    if not is_there(folder / "campaign.yaml"):
        trust_typed(robot or DEFAULT_ROBOT)
        cell = CellChoice(scenario=scenario, seed=seed, with_limits=True, for_dry_run=True)
        create_on_cell(folder, robot or DEFAULT_ROBOT, cell)
        return open_campaign(folder)
    remedy = "name a new folder"
    if scenario is not None or seed is not None or robot is not None:
        raise OptionsInvalid(
            f"{folder} is a campaign already, with a robot, scenario and seed of its own",
            remedy=remedy,
        )
    campaign = open_campaign(folder)
    if not campaign.is_simulated:
        raise OptionsInvalid(f"{folder} is a campaign on real devices, or on none", remedy=remedy)
    if campaign.journal_path.exists():
        raise OptionsInvalid(f"{folder} has measurements already", remedy=remedy)
    return campaign


def _free_folder() -> Path:
    number = 1
    while (folder := Path(f"dry-run-{number}")).exists():
        number += 1
    return folder
