"""pkmcal correct: targets for a controller that takes no parameters."""

import math
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from app.console import Terminal, terminal_of
from app.options import Folder, Json
from campaigns.campaign import Campaign, open_campaign
from campaigns.chain.correction import CorrectionTerms, correct_gcode_file, correct_poses_file
from campaigns.controllers.calibrated_workspace import MARGIN_MM, TURN_MARGIN_DEG
from campaigns.controllers.gcode_correction import TOLERANCE_MM
from campaigns.controllers.gcode_moves import ROTARY
from campaigns.errors import OptionsInvalid

WORD = "-corrected"
LETTERS = ("A", "B", "C")


def command(
    context: typer.Context,
    folder: Folder,
    *,
    poses: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="CSV with a column for each coordinate, such as x_mm; name may be left out.",
        ),
    ] = None,
    gcode: Annotated[Path | None, typer.Option(metavar="FILE", help="A program of moves.")] = None,
    to: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help=f"Default: beside the file, NAME{WORD}."),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="The identified set. Default, in DIR: robot-compensated.yaml."
        ),
    ] = None,
    tolerance: Annotated[
        float,
        typer.Option(
            min=1e-4, metavar="MM", help="G-code: how far a piece may be off the wanted path."
        ),
    ] = TOLERANCE_MM,
    rotary: Annotated[
        str, typer.Option(metavar="LETTER", help="G-code: the word of the robot's turn.")
    ] = ROTARY,
    margin: Annotated[
        float,
        typer.Option(min=0.0, metavar="MM", help="How far outside of the shots it is believed."),
    ] = MARGIN_MM,
    turn_margin: Annotated[
        float, typer.Option(min=0.0, metavar="DEG", help="The same for the turn.")
    ] = TURN_MARGIN_DEG,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the file if it exists.")
    ] = False,
    json: Json = False,
) -> None:
    """Correct targets for a controller that keeps its nominal parameters.

    For each wanted pose: what to command, so that the robot stands there as if the identified
    parameters had been loaded. Of G-code straight moves and arcs are corrected, split until the
    robot follows the wanted path; everything else stays as it is. Refused by its line is what
    cannot be corrected, what is out of reach or not allowed, and what is outside of the calibrated
    workspace, the hull of the identification's shots and a margin.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    terms = CorrectionTerms(robot, margin, turn_margin)
    _require_finite(tolerance=tolerance, margin=margin, turn_margin=turn_margin)
    if (poses is None) == (gcode is None):
        raise OptionsInvalid(
            "neither --poses nor --gcode" if poses is None else "both --poses and --gcode",
            remedy="name one file",
        )
    if poses is not None:
        _poses(terminal, campaign, poses, to or _beside(poses), terms, overwrite=overwrite)
        return
    assert gcode is not None, "one of them"
    path = to or _beside(gcode)
    found = correct_gcode_file(
        campaign,
        gcode,
        path,
        terms,
        tolerance_mm=tolerance,
        rotary=_letter(rotary),
        overwrite=overwrite,
    )
    mean_mm, max_mm = found.correction_mm
    terminal.say(f"written: {path}")
    terminal.say(
        f"{found.moves} moves as {found.pieces} straight ones, corrected by {mean_mm:.3f} mm on "
        f"average, {max_mm:.3f} mm at most{_sigma(found.std_mm)}"
    )
    terminal.document(
        {
            "path": str(path),
            "moves": found.moves,
            "pieces": found.pieces,
            "correction_mm": {"mean": mean_mm, "max": max_mm},
            "position_std_mm": found.std_mm,
        }
    )


def _poses(
    terminal: Terminal,
    campaign: Campaign,
    source: Path,
    to: Path,
    terms: CorrectionTerms,
    *,
    overwrite: bool,
) -> None:
    found = correct_poses_file(campaign, source, to, terms, overwrite=overwrite)
    size = found.correction_mm
    std = None if np.isnan(found.std_mm).any() else float(found.std_mm.max())
    terminal.say(f"written: {to}")
    terminal.say(
        f"{len(size)} poses, corrected by {size.mean():.3f} mm on average, {size.max():.3f} mm "
        f"at most{_sigma(std)}"
    )
    terminal.document(
        {
            "path": str(to),
            "poses": len(size),
            "correction_mm": {"mean": float(size.mean()), "max": float(size.max())},
            "position_std_mm": std,
        }
    )


def _require_finite(**options: float) -> None:
    for name, value in options.items():
        if not math.isfinite(value):
            raise OptionsInvalid(
                f"--{name.replace('_', '-')} is {value}", remedy="give a finite number"
            )


def _sigma(std_mm: float | None) -> str:
    if std_mm is None:
        return "; no identification in the journal says how sure that is"
    return f"; 1 σ of the position {std_mm:.3f} mm at most"


def _beside(path: Path) -> Path:
    return path.parent / f"{path.stem}{WORD}{path.suffix}"


def _letter(rotary: str) -> str:
    if rotary.upper() in LETTERS:
        return rotary.upper()
    raise OptionsInvalid(
        f"--rotary {rotary}: must be one of {', '.join(LETTERS)}", remedy="give one of them"
    )
