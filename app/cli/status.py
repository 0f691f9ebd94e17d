"""pkmcal status: where a campaign is, and the one next command."""

from dataclasses import fields

import typer

from app.console import BAD, GOOD, OPEN, WARNING, terminal_of
from app.next import next_document
from app.options import Folder, Json
from campaigns.campaign import open_campaign
from campaigns.workflow.status import campaign_status

COLOURS = {"pass": GOOD, "fail": BAD, "not decided": OPEN}
LATEST = 5
"""Series that are listed; `--json` has all."""


def command(context: typer.Context, folder: Folder, *, json: Json = False) -> None:
    """Show where the campaign is, and the next command.

    Who measures now, which series exist, what is open, what is doubtful, the verdict, and the next
    command. Nothing is changed, no device is asked, and a running measurement is not disturbed.
    """
    terminal = terminal_of(context, as_json=json)
    found = campaign_status(open_campaign(folder))
    terminal.say(f"{found.name} ({found.robot}): {found.phase}", "bold")
    if found.held_by is not None:
        terminal.say(f"now: {found.held_by.says}", WARNING)
    for each in found.series[-LATEST:]:
        terminal.say(f"  series {each.series}, {each.says}")
    for text in found.open:
        terminal.say(f"open: {text}", WARNING)
    for text in found.doubtful:
        terminal.say(f"doubtful: {text}", WARNING)
    if found.decision is not None:
        terminal.say(f"verdict: {found.answer}", COLOURS[found.decision])
    for way in found.ways:
        terminal.say(way.says)
    terminal.say(f"next: {found.next.says}" if found.next else "nothing is left to do")
    document = {each.name: getattr(found, each.name) for each in fields(found)}
    document["measuring"] = document.pop("held_by")
    terminal.document(document | next_document(found.next, found.ways))
