"""pkmcal correct: targets for a controller that takes no parameters."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from app.console import terminal_of
from app.next import tell_next
from app.options import Folder, Json, Overwrite
from campaigns.campaign import open_campaign
from campaigns.controllers.gcode_correction import TOLERANCE_MM
from campaigns.controllers.gcode_moves import ROTARY
from campaigns.errors import OptionsInvalid
from campaigns.settings.option import Option, require_finite
from campaigns.workflow.correction import CorrectionTerms, correct_gcode_file, correct_poses_file

WORD = "-corrected"
LETTERS = ("A", "B", "C")


File = Annotated[Path | None, Option("A program of moves.", metavar="FILE")]
Poses = Annotated[
    Path | None,
    Option("CSV with a column for each coordinate, such as x_mm; name may be left out.", "FILE"),
]
To = Annotated[Path | None, Option(f"Default: beside the file, NAME{WORD}.", metavar="FILE")]
Tolerance = Annotated[
    float, Option("G-code: how far a piece may be off the wanted path.", metavar="MM", least=1e-4)
]
Rotary = Annotated[str, Option("G-code: the word of the robot's turn.", metavar="LETTER")]


def command(
    context: typer.Context,
    folder: Folder,
    terms: CorrectionTerms,
    *,
    poses: Poses = None,
    gcode: File = None,
    to: To = None,
    tolerance: Tolerance = TOLERANCE_MM,
    rotary: Rotary = ROTARY,
    overwrite: Overwrite = False,
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
    require_finite("--tolerance", tolerance)
    source = poses or gcode
    if source is None or (poses and gcode):
        raise OptionsInvalid(
            "both --poses and --gcode" if source else "neither --poses nor --gcode",
            remedy="name one file",
        )
    path = to or source.parent / f"{source.stem}{WORD}{source.suffix}"
    if poses is not None:
        found = correct_poses_file(campaign, poses, path, terms, overwrite=overwrite)
        size = found.correction_mm
        mean_mm, max_mm = float(size.mean()), float(size.max())
        std_mm = None if np.isnan(found.std_mm).any() else float(found.std_mm.max())
        done, counts = f"{len(size)} poses", {"poses": len(size)}
    else:
        program = correct_gcode_file(
            campaign,
            source,
            path,
            terms,
            tolerance_mm=tolerance,
            rotary=_letter(rotary),
            overwrite=overwrite,
        )
        (mean_mm, max_mm), std_mm = program.correction_mm, program.std_mm
        done = f"{program.moves} moves as {program.pieces} straight ones"
        counts = {"moves": program.moves, "pieces": program.pieces}
    terminal.say(f"written: {path}")
    terminal.say(
        f"{done}, corrected by {mean_mm:.3f} mm on average, {max_mm:.3f} mm at most{_sigma(std_mm)}"
    )
    size_mm = {"mean": mean_mm, "max": max_mm}
    found_mm = {"correction_mm": size_mm, "position_std_mm": std_mm}
    document = {"path": path, **counts, **found_mm}
    terminal.document(document | tell_next(terminal, campaign))


def _sigma(std_mm: float | None) -> str:
    if std_mm is None:
        return "; no identification in the journal says how sure that is"
    return f"; 1 σ of the position {std_mm:.3f} mm at most"


def _letter(rotary: str) -> str:
    if rotary.upper() in LETTERS:
        return rotary.upper()
    raise OptionsInvalid(
        f"--rotary {rotary}: must be one of {', '.join(LETTERS)}", remedy="give one of them"
    )
