"""pkmcal correct: targets for a controller that takes no parameters."""

from pathlib import Path
from typing import Annotated

import typer

from app.console import terminal_of
from app.next import tell_next
from app.options import Folder, Json, Overwrite
from campaigns.campaign import Campaign, open_campaign
from campaigns.controllers.export import FILE_NAME
from campaigns.controllers.gcode_correction import TOLERANCE_MM
from campaigns.controllers.gcode_moves import ROTARY
from campaigns.controllers.programs import LANGUAGES
from campaigns.errors import OptionsInvalid
from campaigns.options import ProgramLanguage
from campaigns.settings.option import Option, require_finite
from campaigns.workflow.correction import POSES, CorrectionTerms, correct_file

WORD = "-corrected"
LETTERS = ("A", "B", "C")
ENDINGS = {".nc": "gcode", ".gcode": "gcode", ".prg": "rapid", ".dat": "krl", ".pg": "vplus"}
"""More endings of files than those of the programs that are written."""


File = Annotated[Path | None, Option("A program of moves in G-code.", metavar="FILE")]
Program = Annotated[Path | None, Option("A program in the language of --format.", metavar="FILE")]
Language = Annotated[
    ProgramLanguage | None, Option("Of --program.", name="--format", default="by the file's ending")
]
Poses = Annotated[
    Path | None,
    Option("CSV with a column for each coordinate, such as x_mm; name may be left out.", "FILE"),
]
To = Annotated[Path | None, Option(f"Default: beside the file, NAME{WORD}.", metavar="FILE")]
Tolerance = Annotated[
    float,
    Option(
        "G-code: allowed deviation of a segment from the wanted path.", metavar="MM", least=1e-4
    ),
]
Rotary = Annotated[str, Option("G-code: the word for the robot's rotation.", metavar="LETTER")]


def command(
    context: typer.Context,
    folder: Folder,
    terms: CorrectionTerms,
    *,
    poses: Poses = None,
    gcode: File = None,
    program: Program = None,
    language: Language = None,
    to: To = None,
    tolerance: Tolerance = TOLERANCE_MM,
    rotary: Rotary = ROTARY,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Correct targets for a controller that keeps its nominal parameters.

    For each wanted pose: the pose to command, so that the robot stands where it would with the
    identified parameters loaded. In G-code, straight moves and arcs are corrected, split until the
    robot follows the wanted path; everything else stays as it is. In RAPID, KRL, V+ and CSV, the
    poses written as numbers are corrected and nothing else changes. A line is refused if it cannot
    be corrected, is out of reach or not allowed, or lies outside the calibrated workspace (the
    hull of the identification's shots and a margin).
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    require_finite("--tolerance", tolerance)
    named = {"--poses": poses, "--gcode": gcode, "--program": program}
    given = {option: each for option, each in named.items() if each is not None}
    if len(given) != 1:
        both = f"both {' and '.join(given)}"
        raise OptionsInvalid(
            both if given else f"neither {' nor '.join(named)}", remedy="name one file"
        )
    (source,) = given.values()
    path = to or source.parent / f"{source.stem}{WORD}{source.suffix}"
    spoken = POSES if poses is not None else "gcode"
    if program is not None:
        spoken = _language(source, language)
    found = correct_file(
        campaign,
        source,
        path,
        terms,
        language=spoken,
        tolerance_mm=tolerance,
        rotary=_letter(rotary),
        overwrite=overwrite,
    )
    (mean_mm, max_mm), std_mm = found.correction_mm, found.std_mm
    counted = spoken if spoken == POSES else "targets"
    done, counts = f"{found.targets} {counted}", {counted: found.targets}
    if spoken == "gcode":
        done = f"{found.targets} moves as {found.pieces} straight ones"
        counts = {"moves": found.targets, "pieces": found.pieces}
    terminal.say(f"written: {path}")
    terminal.say(
        f"{done}, corrected by {mean_mm:.3f} mm on average, {max_mm:.3f} mm at most"
        f"{_sigma(std_mm, campaign, terms)}"
    )
    size_mm = {"mean": mean_mm, "max": max_mm}
    found_mm = {"correction_mm": size_mm, "position_std_mm": std_mm}
    document = {"path": path, **counts, **found_mm}
    terminal.document(document | tell_next(terminal, campaign))


def _sigma(std_mm: float | None, campaign: Campaign, terms: CorrectionTerms) -> str:
    if std_mm is not None:
        return f"; 1 σ of the position {std_mm:.3f} mm at most"
    file = terms.robot.name if terms.robot else FILE_NAME
    again = f"`pkmcal correct {campaign.folder}`"
    again += " without --robot takes it" if terms.robot else " again"
    return (
        f"; its uncertainty is unknown: {file} holds no set that an identification in the journal "
        f"found → `pkmcal export {campaign.folder} --overwrite` writes such a {FILE_NAME}, {again}"
    )


def _language(path: Path, told: ProgramLanguage | None) -> str:
    """Language of a program, by its ending where it is not told."""
    endings = {own.suffix: name for name, own in LANGUAGES.items()} | ENDINGS
    if told is None and path.suffix.lower() not in endings:
        raise OptionsInvalid(
            f"--program {path}: its ending does not say which language it is",
            remedy=f"give --format, one of {', '.join(LANGUAGES)}",
        )
    return endings[path.suffix.lower()] if told is None else told.value


def _letter(rotary: str) -> str:
    if rotary.upper() in LETTERS:
        return rotary.upper()
    raise OptionsInvalid(
        f"--rotary {rotary}: must be one of {', '.join(LETTERS)}", remedy="give one of them"
    )
