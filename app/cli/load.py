"""pkmcal load: the compensated parameters into the controller."""

from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal, terminal_of
from app.interrupt import StopRequest, stop_on_signals
from app.options import Dry, Folder, Json
from app.wiring import connected_robot
from campaigns.campaign import open_campaign
from campaigns.chain.loading import load
from campaigns.controllers.export import FILE_NAME
from campaigns.controllers.load import Change, last_kept
from campaigns.errors import OptionsInvalid

SURE = "Write these parameters? The robot must stand still."

File = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Another robot file than DIR/robot-compensated.yaml."),
]
Rollback = Annotated[bool, typer.Option("--rollback", help="Put back what the last load replaced.")]
Standing = Annotated[bool, typer.Option("--yes", "-y", help="Don't ask: the robot stands still.")]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    file: File = None,
    rollback: Rollback = False,
    dry: Dry = False,
    yes: Standing = False,
    json: Json = False,
) -> None:
    """Put the compensated parameters into the controller.

    Shows the difference to what it holds, with Δ/σ, asks, keeps the old as
    controller-before-N.yaml, writes all at once, reads back and compares. What does not verify
    is taken back. Ctrl-C is heard before and after, never in between.
    """
    terminal = terminal_of(context, as_json=json)
    if rollback and file is not None:
        raise OptionsInvalid("--rollback and --file contradict each other", remedy="give one")
    campaign = open_campaign(folder)
    source = last_kept(campaign.folder) if rollback else file or campaign.path(FILE_NAME)

    def approve(found: tuple[Change, ...]) -> bool:
        show(terminal, found)
        if not dry:
            terminal.require_yes(SURE, yes=yes)
        return not dry

    wish = StopRequest()
    connection = connected_robot(campaign)
    kept = load(campaign, connection, source, approve=approve, uninterrupted=stop_on_signals(wish))
    if wish():
        raise KeyboardInterrupt
    if kept is None:
        terminal.say("nothing was written" if dry else "the controller holds these already")
    else:
        terminal.say(f"loaded and verified: {source}", "green")
        terminal.say(f"what it held before: {kept}")
    done = kept is not None
    terminal.document(
        {"loaded": str(source) if done else None, "kept": str(kept) if done else None}
    )


def show(terminal: Terminal, found: tuple[Change, ...]) -> None:
    """Table of the parameters that would change."""
    rows = [
        (
            change.name,
            f"{change.old:.4f}",
            f"{change.new:.4f}",
            f"{change.delta:+.4f}",
            "-" if change.in_sigmas is None else f"{change.in_sigmas:+.0f}",
        )
        for change in found
        if change.delta != 0.0
    ]
    terminal.table("Controller (mm, deg)", ("", "holds", "will hold", "Δ", "Δ/σ"), rows)
