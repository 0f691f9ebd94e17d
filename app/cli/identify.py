"""pkmcal identify: the geometry from the measured shots."""

import typer

from app.console import terminal_of
from app.exits import Exit
from app.next import tell_next
from app.options import Folder, Json, Plot
from app.report.identification_text import show
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
    """Find the parameters that explain what was measured.

    Takes the latest run or import. The fit sees the shots of the set "identification" and is
    judged by the pairs of the set "validation", which it never sees. The first motor's place, which
    holds the frame, and the azimuths stay nominal by default. A PATTERN is a parameter's
    name or a shell's pattern; a whole name outranks it.

    Exit code 1: it was computed, but must not be used; the reasons are given.
    """
    terminal, campaign = terminal_of(context, as_json=json), open_campaign(folder)
    found = identify(campaign, options)
    terminal.detail(f"estimator: {options.estimator.value}, {found.seconds} s")
    show(terminal, found, campaign.robot.mechanism.parameters)
    if plot is not None:
        from app.report.plots import plot_residuals  # matplotlib takes longer than the fit

        plot_residuals(plot, found)
        terminal.say(f"drawn: {plot}")
    terminal.document(found.document() | tell_next(terminal, campaign))
    if found.verdict != "pass":
        raise typer.Exit(Exit.NOT_GOOD)
