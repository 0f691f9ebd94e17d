"""pkmcal advise: the mechanic's list."""

import textwrap

import typer

from app.console import GOOD, WARNING, Terminal, terminal_of
from app.exits import Exit
from app.options import Folder, Json
from app.report.advice_sections import BROUGHT
from campaigns.campaign import open_campaign
from campaigns.evaluation.mechanical_advice import LEFT_AND_RIGHT
from campaigns.workflow.advising import advise


def command(context: typer.Context, folder: Folder, *, json: Json = False) -> None:
    """List what a mechanic may adjust, from the latest identification.

    A parameter is read as a dimension only if its change exceeds twice its U, what the tests of
    the model may miss, and what the parts that define the base frame may add. The list then names
    the part, its error, what to do, and by how much positions improve under a controller with
    nominal parameters, simulated in the order of largest improvement. Everything left alone is
    listed with the reason. Nothing is changed.

    Exit code 1: no parameter may be read as a dimension; the reason is given.
    """
    terminal = terminal_of(context, as_json=json)
    found = advise(open_campaign(folder))
    for place, each in found.numbered:
        _say(terminal, f"{place}. {each.says}:", "", "   ")
        terminal.say(f"   {each.act}", GOOD)
    if found.instructions:
        title = f"Error of position, now {found.mean_mm:.3f} (mm)"
        terminal.rows(title, BROUGHT, found.numbered)
        terminal.say(f"U: k = 2. {LEFT_AND_RIGHT}")
        terminal.say("Then measure and identify again.")
    elif not found.refused:
        terminal.say("no part is off by an amount that a mechanic could adjust")
    if found.left:
        terminal.say("Leave alone:", "bold")
    for why, parts in found.left.items():
        _say(terminal, f"{', '.join(parts)}: {why}", "  ", "    ")
    if found.refused:
        terminal.say(f"no advice: {found.refused}", WARNING)
    terminal.document({"schema": "pkmcal/advice/1", "advice": found})
    if found.refused:
        raise typer.Exit(Exit.NOT_GOOD)


def _say(terminal: Terminal, text: str, first: str, further: str) -> None:
    """Long line, broken for a terminal of 80 columns."""
    for line in textwrap.wrap(text, 79, initial_indent=first, subsequent_indent=further):
        terminal.say(line)
