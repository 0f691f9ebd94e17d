"""pkmcal identify: the geometry from the measured shots."""

from typing import Annotated

import typer

from app.console import terminal_of
from app.exits import Exit
from app.options import Fix, Folder, Free, Json, Plot
from app.report.identification_text import show
from campaigns.campaign import open_campaign
from campaigns.chain.identification import identify
from campaigns.estimation.estimators import Estimator, LossShape, Model, Outliers
from campaigns.options import BENDS_AT, IdentifyOptions

Compared = Annotated[
    Estimator,
    typer.Option(
        help="points: all coordinates of every shot. distances: of pairs, as in the paper."
    ),
]
Extent = Annotated[
    Model,
    typer.Option(
        help="standard: lengths, places and joint offsets. extended: also where the motors' axes "
        "point and what their gears lose, if unseen pairs speak for it."
    ),
]
Prior = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATTERN=σ",
        help="Known to lie about nominal with σ (mm, deg), 'arm*.arm_mm=0.05'; repeatable.",
    ),
]
Shape = Annotated[
    LossShape,
    typer.Option(help="How the price of a misfit grows: with its square, or less where it is big."),
]
LossScale = Annotated[
    float,
    typer.Option(min=0.1, max=1000.0, metavar="N", help="Where soft-l1 and cauchy bend, in σ."),
]
LeftOut = Annotated[
    Outliers,
    typer.Option(help="What becomes of shots that all others contradict; each is named."),
]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    estimator: Compared = Estimator.POINTS,
    model: Extent = Model.STANDARD,
    free: Free = None,
    fix: Fix = None,
    prior: Prior = None,
    loss: Shape = LossShape.LINEAR,
    loss_scale: LossScale = BENDS_AT,
    outliers: LeftOut = Outliers.EXCLUDE,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Find the parameters that explain what was measured.

    Takes the latest run or import. The fit sees the shots of the set "identification" and is
    judged by the pairs of the set "validation", which it never sees. Unless told otherwise it
    finds all parameters but the first motor's place, which holds the frame, and the azimuths,
    which stay nominal. A PATTERN is a parameter's name or a shell's pattern; a whole name outranks
    it.

    Exit code 1: it was computed, but must not be used; the reasons are given.
    """
    terminal, campaign = terminal_of(context, as_json=json), open_campaign(folder)
    options = IdentifyOptions(
        estimator=estimator,
        free=tuple(free or ()),
        fix=tuple(fix or ()),
        prior=tuple(prior or ()),
        loss=loss,
        loss_scale=loss_scale,
        outliers=outliers,
        model=model,
    )
    found = identify(campaign, options)
    terminal.detail(f"estimator: {estimator.value}, {found.seconds} s")
    show(terminal, found, campaign.robot.mechanism.parameters)
    if plot is not None:
        from app.report.plots import plot_residuals  # matplotlib takes longer than the fit

        plot_residuals(plot, found)
        terminal.say(f"drawn: {plot}")
    terminal.document(found.document())
    if found.verdict != "pass":
        raise typer.Exit(Exit.NOT_GOOD)
    terminal.note(f"next: pkmcal export {folder}")
