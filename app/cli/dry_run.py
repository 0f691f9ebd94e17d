"""pkmcal dry-run: the whole chain against a simulated cell, over real sockets."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Json, Seed

if TYPE_CHECKING:
    from app.cli.identify import IdentifyOptions
    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.evaluation.validation import Validation

STAGES = 8


NewFolder = Annotated[
    Path | None, typer.Argument(metavar="[DIR]", help="Default: a new folder dry-run-N.")
]
Scenario = Annotated[
    str | None,
    typer.Option(
        metavar="NAME", help="A shipped scenario or a cell file.", show_default="paper-prototype"
    ),
]


def command(
    context: typer.Context,
    folder: NewFolder = None,
    *,
    scenario: Scenario = None,
    seed: Seed = None,
    json: Json = False,
) -> None:
    """Go through a whole campaign without hardware.

    Plan, validate before, run, identify, export, load, validate after. Controller and tracker
    are simulated, but reached through the same drivers, protocols and sockets as real ones, and
    what the simulated robot's errors are, the identification has to find out.

    DIR may also be a campaign made by `pkmcal new` on a simulated cell in which nothing was
    measured yet: then its settings hold.
    """
    from app.console import BAD, GOOD, terminal_of

    terminal = terminal_of(context, as_json=json)
    started_s = time.monotonic()
    campaign = prepared(folder or _free_folder(), scenario, seed)
    document, against = rehearse(campaign, terminal)
    document["report"] = str(_reported(campaign, terminal))
    seconds = time.monotonic() - started_s
    for line in against:
        terminal.say(f"not good: {line}", BAD)
    if not against:
        terminal.say(
            "good: the loaded parameters make the robot better where it never fitted", GOOD
        )
    terminal.say(f"{seconds:.0f} s; everything is in {campaign.folder}")
    terminal.document(document | {"seconds": seconds})
    if against:
        raise typer.Exit(Exit.NOT_GOOD)


def prepared(folder: Path, scenario: str | None, seed: int | None) -> "Campaign":
    """A new campaign on a simulated cell, or one that stands ready.

    Raises `UsageInvalid` for one on real devices, with measurements, or of another scenario.
    """
    from app.cli import new
    from app.exits import UsageInvalid
    from app.folder import open_campaign

    if not (folder / "campaign.yaml").exists():
        new.create_simulated(folder, new.DEFAULT_ROBOT, scenario or new.DEFAULT_SCENARIO, seed)
        return open_campaign(folder)
    remedy = "name a new folder"
    if scenario is not None or seed is not None:
        raise UsageInvalid(
            f"{folder} is a campaign already, with a scenario and seed of its own", remedy=remedy
        )
    campaign = open_campaign(folder)
    if not campaign.is_simulated:
        raise UsageInvalid(f"{folder} is a campaign on real devices", remedy=remedy)
    if campaign.journal_path.exists():
        raise UsageInvalid(f"{folder} has measurements already", remedy=remedy)
    return campaign


def rehearse(
    campaign: "Campaign", terminal: "Terminal", asked: "IdentifyOptions | None" = None
) -> tuple[dict[str, object], tuple[str, ...]]:
    """The whole chain but its report; gives what `--json` prints, and what speaks against it.

    `asked` says how to identify, if not as `pkmcal identify` does by itself.
    """
    from app import planning
    from app.cli import export, identify, load, plan, run, validate
    from app.report.identification_text import show

    document = _beginning(campaign, terminal)
    _heading(terminal, 1, "plan")
    checked, _ = planning.make(campaign)
    terminal.say(plan.plan_line(checked))
    _heading(terminal, 2, "validate before")
    tests = tuple(validate.Test)
    before, _ = validate.validate(campaign, validate.When.BEFORE, tests, terminal)
    terminal.say(distance_line(before))
    document["before"] = before.document()
    _heading(terminal, 3, "run")
    run.run_plan(campaign, checked, terminal)
    _heading(terminal, 4, "identify")
    found, document["identification"] = identify.identify(
        campaign, asked or identify.IdentifyOptions()
    )
    show(terminal, found)
    if found.verdict != "pass":
        return document, found.reasons
    _heading(terminal, 5, "export")
    path, _ = export.export(campaign)
    terminal.say(path.name)
    document["parameter_file"] = str(path)
    _heading(terminal, 6, "load")
    kept = load.load(campaign, path, lambda _: True)
    terminal.say(f"written, read back and compared; the old ones: {kept.name if kept else '-'}")
    _heading(terminal, 7, "validate after")
    after, against = validate.validate(campaign, validate.When.AFTER, tests, terminal)
    terminal.say(distance_line(after))
    document["after"] = after.document()
    show_gain(terminal, before, after)
    return document, tuple(against)


def _reported(campaign: "Campaign", terminal: "Terminal") -> Path:
    """The last stage: the page about all that was measured."""
    from app.cli import report

    _heading(terminal, STAGES, "report")
    path = report.report(campaign)
    terminal.say(path.name)
    return path


def _beginning(campaign: "Campaign", terminal: "Terminal") -> dict[str, object]:
    """Say what will be done; gives the document with what is known so far."""
    from app.wiring import scenario_of

    scenario = scenario_of(campaign.folder, campaign.config.controller.url)
    terminal.say(f"dry run of {scenario.name}, seed {scenario.seed}, in {campaign.folder}", "bold")
    return {
        "scenario": scenario.name,
        "seed": scenario.seed,
        "before": None,
        "after": None,
        "identification": None,
        "parameter_file": None,
        "report": None,
    }


def _heading(terminal: "Terminal", number: int, stage: str) -> None:
    terminal.say(f"\n{number}/{STAGES} {stage}", "bold cyan")


def distance_line(found: "Validation") -> str:
    """The figure that counts, in a line."""
    distances = found.distances
    if distances is None:
        return "no distances measured"
    return (
        f"distances of unseen pairs off by {distances.mean_abs:.3f} mm on average, "
        f"{distances.max_abs:.3f} mm at most"
    )


def show_gain(terminal: "Terminal", before: "Validation", after: "Validation") -> None:
    """Before and after side by side."""
    from app.cli.validate import figures, in_mm

    old, new = figures(before), figures(after)
    rows = [
        (name, in_mm(old[name]), in_mm(new[name]), _factor(old[name], new[name])) for name in old
    ]
    terminal.table("Gain (mm)", ("", "before", "after", "before/after"), rows)


def _factor(before: float | None, after: float | None) -> str:
    return f"{before / after:.1f}" if before is not None and after else "-"


def _free_folder() -> Path:
    number = 1
    while (folder := Path(f"dry-run-{number}")).exists():
        number += 1
    return folder
