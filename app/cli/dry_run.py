"""pkmcal dry-run: the whole chain against a simulated cell."""

import time
from pathlib import Path
from typing import Annotated

import typer

from app.cli.report import report
from app.console import BAD, GOOD, Terminal
from app.new_campaign import (
    COMPLETED_ROBOT,
    COMPLETED_SCENARIO,
    DEFAULT_ROBOT,
    DEFAULT_SCENARIO,
    create_simulated,
)
from app.next import tell_next
from app.options import Seed
from app.rehearsal import STAGES, heading, rehearse
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.evaluation.verdict import JUDGED
from campaigns.evidence import evaluate
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
        show_default="paper-prototype",
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
    campaign = prepared(folder or _free_folder(), scenario, seed, robot)
    rehearsal, against = rehearse(campaign, terminal, IdentificationOptions())
    heading(terminal, STAGES, "report")
    _, path = report(campaign)
    terminal.say(path.name)
    seconds = time.monotonic() - started_s
    for line in against:
        terminal.say(f"not good: {line}", BAD)
    if not against:
        shown = any(each.shown for each in evaluate(campaign).gains if each.name == JUDGED)
        terminal.say(f"good: {BETTER if shown else NOTHING_TO_CORRECT}", GOOD)
    terminal.say(f"{seconds:.0f} s; everything is in {campaign.folder}")
    following = tell_next(terminal, campaign, reported=True)
    rehearsal.report, rehearsal.seconds = path, seconds
    terminal.conclude(rehearsal, following, is_good=not against)


def prepared(
    folder: Path, scenario: str | None, seed: int | None, robot: str | None = None
) -> Campaign:
    """Make a new campaign on a simulated cell, or open one that stands ready.

    Raise `OptionsInvalid` for one on real devices, with measurements, or of another scenario.
    """
    if not is_there(folder / "campaign.yaml"):
        create_simulated(
            folder,
            robot or DEFAULT_ROBOT,
            scenario or DEFAULT_SCENARIO,
            seed,
            with_limits=True,
            computes_all=True,
            unattended=True,
        )
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
