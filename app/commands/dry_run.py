"""pkmcal dry-run: the whole chain against a simulated cell, over real sockets."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Json

if TYPE_CHECKING:
    from app.console import Terminal
    from campaigns.validate import Validation

DEFAULT_SCENARIO = "paper-prototype"


def command(
    folder: Annotated[
        Path | None, typer.Argument(metavar="[DIR]", help="Default: a new folder dry-run-N.")
    ] = None,
    *,
    scenario: Annotated[
        str, typer.Option(help="A shipped scenario's name, or a cell file.")
    ] = DEFAULT_SCENARIO,
    seed: Annotated[int | None, typer.Option(min=0, help="Instead of the scenario's.")] = None,
    json: Json = False,
) -> None:
    """Go through a whole campaign without hardware: plan, validate before, run, identify, export,
    load, validate after. Controller and tracker are simulated, but reached through the same
    drivers, protocols and sockets as real ones.
    """
    from app.console import BAD, GOOD, Terminal

    terminal = Terminal(as_json=json)
    chosen = folder or _free_folder()
    document, good = rehearse(chosen, scenario, seed, terminal)
    terminal.document(document)
    if not good:
        terminal.say("dry run done; the result is not good", BAD)
        raise typer.Exit(Exit.NOT_GOOD)
    terminal.say(f"dry run done in {document['seconds']:.0f} s: everything is in {chosen}", GOOD)


def rehearse(
    folder: Path, scenario: str, seed: int | None, terminal: "Terminal"
) -> tuple[dict[str, object], bool]:
    """The whole chain in a new folder; gives what `--json` prints, and whether all is good."""
    import time

    from app.commands import export, identify, load, new, plan, run, validate
    from app.folder import open_campaign
    from sim.scenario import load_scenario

    started_s = time.monotonic()
    new.create_simulated(folder, new.DEFAULT_ROBOT, scenario, seed)
    campaign = open_campaign(folder)
    checked, _ = plan.make(campaign)
    tests = tuple(validate.Test)
    before, _ = validate.validate(campaign, validate.When.BEFORE, tests, terminal)
    run.run_plan(campaign, checked, terminal)
    found, identification = identify.identify(campaign)
    identify.show(terminal, found)
    document = {
        "scenario": load_scenario(scenario).name,
        "seed": _seed_used(folder),
        "before": before.document(),
        "after": None,
        "identification": identification,
        "parameter_file": None,
        "report": None,
    }
    if found.verdict != "pass":
        return document | {"seconds": time.monotonic() - started_s}, False
    path = export.export(campaign)
    load.load(campaign, path, terminal, yes=True)
    after, broken = validate.validate(campaign, validate.When.AFTER, tests, terminal)
    show_gain(terminal, before, after)
    document |= {"after": after.document(), "parameter_file": str(path)}
    return document | {"seconds": time.monotonic() - started_s}, not broken


def show_gain(terminal: "Terminal", before: "Validation", after: "Validation") -> None:
    """Before and after side by side."""
    from app.commands.validate import result_rows

    rows = [
        (name, old, new)
        for (name, old), (_, new) in zip(result_rows(before), result_rows(after), strict=True)
    ]
    terminal.table("Gain (mm)", ("", "before", "after"), rows)


def _seed_used(folder: Path) -> int:
    from app.folder import SCENARIO
    from sim.scenario import load_scenario

    return load_scenario(str(folder / SCENARIO)).seed


def _free_folder() -> Path:
    number = 1
    while (folder := Path(f"dry-run-{number}")).exists():
        number += 1
    return folder
