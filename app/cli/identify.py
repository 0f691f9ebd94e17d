"""pkmcal identify: the geometry from the measured shots."""

import re
from typing import Annotated

import typer

from app.console import terminal_of
from app.exits import Exit
from app.options import Fix, Folder, Free, Json, ModelOption, Plot
from app.report.identification_text import show
from campaigns.campaign import open_campaign
from campaigns.chain.identification import identify
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, LossShape, Model, Outliers, Weights
from campaigns.options import BENDS_AT, IdentifyOptions

RANGE = re.compile(r"(\d*)-(\d*)", re.ASCII)
Compared = Annotated[
    Estimator,
    typer.Option(
        help="points: all coordinates of every shot. distances: of pairs, as in the paper."
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

Weigh = Annotated[
    Weights,
    typer.Option(help="Of distances: as stated of both ends, or all equal, as in the paper."),
]
Range = Annotated[
    str | None,
    typer.Option(
        metavar="A-B",
        help="Identify from these alone, by number: 0-60, -60 or 61-; after a change.",
    ),
]
Sessions = Annotated[
    bool,
    typer.Option(
        "--sessions", help="Fit a frame of its own for each session: the tracker was moved between."
    ),
]
HoldOut = Annotated[
    str,
    typer.Option(
        metavar="SHARE", help="Keep so many of the pairs unseen, 20%: for data without any."
    ),
]
AcceptLarge = Annotated[
    bool,
    typer.Option("--accept-large-change", help="Take a change beyond robot.yaml's tolerance."),
]
AcceptScale = Annotated[
    bool, typer.Option("--accept-scale", help="Take it that all lengths changed by one share.")
]


def range_of(text: str | None) -> tuple[int | None, int | None]:
    """First and last number of a range such as `0-60`, `-60` or `61-`; raises `OptionsInvalid`."""
    found = RANGE.fullmatch(text or "-")
    if found is None:
        raise OptionsInvalid(f"--shots is '{text}'", remedy="give a range, 0-60, -60 or 61-")
    first, last = (int(part) if part else None for part in found.groups())
    return first, last


def share_of(text: str) -> float:
    """Share written as `20%` or `0.2`; raises `OptionsInvalid`."""
    try:
        value = float(text.removesuffix("%"))
    except ValueError as error:
        raise OptionsInvalid(f"--hold-out is '{text}'", remedy="give a share, 20%") from error
    return value / 100.0 if text.endswith("%") else value


def command(
    context: typer.Context,
    folder: Folder,
    *,
    estimator: Compared = Estimator.POINTS,
    model: ModelOption = Model.STANDARD,
    free: Free = None,
    fix: Fix = None,
    prior: Prior = None,
    loss: Shape = LossShape.LINEAR,
    loss_scale: LossScale = BENDS_AT,
    outliers: LeftOut = Outliers.EXCLUDE,
    weights: Weigh = Weights.STATED,
    shots: Range = None,
    sessions: Sessions = False,
    hold_out: HoldOut = "0%",
    accept_large_change: AcceptLarge = False,
    accept_scale: AcceptScale = False,
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
        weights=weights,
        shots=range_of(shots),
        sessions=sessions,
        hold_out=share_of(hold_out),
        accept_large_change=accept_large_change,
        accept_scale=accept_scale,
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
