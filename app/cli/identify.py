"""pkmcal identify: the geometry from the measured shots."""

import typer

from app.console import terminal_of
from app.exits import Exit
from app.next import tell_next
from app.options import Folder, Json, Plot
from app.report.identification_text import show
from app.report.plots import plot_residuals
from campaigns.campaign import open_campaign
from campaigns.identification.options import IdentificationOptions
from campaigns.workflow.identification import identify


def command(
    context: typer.Context,
    folder: Folder,
    options: IdentificationOptions,
    *,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Find the parameters that explain the measured shots.

    Uses the latest run or import. The fit uses the shots of the set "identification" and is judged
    by the pairs of the set "validation", which it never uses. The place of the first motor, which
    defines the base frame, and the azimuths stay nominal by default. A PATTERN is a parameter's
    name or a shell pattern; a whole name takes precedence.

    Exit code 1: computed, but must not be used; the reasons are given.
    """
    terminal, campaign = terminal_of(context, as_json=json), open_campaign(folder)
    with terminal.telling("identifying"):
        found = identify(campaign, options)
    terminal.detail(f"estimator: {options.estimator.value}, {found.seconds} s")
    show(terminal, found, campaign.robot.mechanism.parameters)
    if plot is not None:
        plot_residuals(plot, found)
        terminal.say(f"drawn: {plot}")
    told = tell_next(terminal, campaign)
    if json:
        terminal.document(found.document() | told)
    if found.verdict != "pass":
        raise typer.Exit(Exit.NOT_GOOD)
