"""pkmcal export: the compensated parameter file."""

from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal, terminal_of
from app.options import Folder, Json
from campaigns.campaign import open_campaign
from campaigns.chain.files import export, export_hal, export_shots
from campaigns.chain.projecting import ReducedExport, export_projected
from campaigns.robots.robot import FOR_SOME_CONTROLLERS


class Format(Enum):
    """What the identified parameters are written as."""

    YAML = "yaml"
    LINUXCNC = "linuxcnc"
    LINUXCNC_ROTARYDELTA = "linuxcnc-rotarydelta"
    LINUXCNC_LINEARDELTA = "linuxcnc-lineardelta"
    KLIPPER_ROTARY_DELTA = "klipper-rotary-delta"
    KLIPPER_DELTA = "klipper-delta"
    PLAIN = "plain"


FEWER = [each.value for each in Format if each not in {Format.YAML, Format.LINUXCNC, Format.PLAIN}]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    to: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Default, in DIR: robot-compensated.yaml, calib.hal or shots.csv."
        ),
    ] = None,
    shots: Annotated[
        bool, typer.Option("--shots", help="Write the measured shots as shots.csv instead.")
    ] = False,
    format_: Annotated[
        Format,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="yaml: a robot file. linuxcnc: a HAL file for pkmkins. Nearest values for fewer "
            f"parameters: {', '.join(FEWER)}; plain: a robot file without tilts and skews.",
        ),
    ] = Format.YAML,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the file if it exists.")
    ] = False,
    json: Json = False,
) -> None:
    """Write the identified parameters as a robot file.

    It holds the parameters, 1 σ of each that was identified, where they come from, and the
    sha256 of the geometry. Only an identification whose verdict is "pass" is written. The file
    can be the nominal robot of a next campaign.

    For a controller with fewer parameters it is the values that leave the least mean square error
    of position over the workspace, and what they leave is said beside what all parameters leave.
    """
    terminal, next_step = terminal_of(context, as_json=json), ""
    campaign = open_campaign(folder)
    if shots:
        path, exported = export_shots(campaign, to, overwrite=overwrite)
        if exported.halves:
            terminal.note(f"left out, as their partner is missing: shots {exported.halves}")
    elif format_ is Format.LINUXCNC:
        path = export_hal(campaign, to, overwrite=overwrite)
    elif format_ is not Format.YAML:
        found = export_projected(campaign, format_.value, to, overwrite=overwrite)
        _show(terminal, found)
        if format_ is Format.PLAIN:
            terminal.note(f"next: pkmcal load {folder} --file {found.path}")
        terminal.document(found.document())
        return
    else:
        path, robot = export(campaign, to, overwrite=overwrite)
        next_step = f"next: pkmcal load {folder}"
        if robot.is_extended:
            terminal.note(FOR_SOME_CONTROLLERS)
    terminal.say(f"written: {path}")
    if next_step:
        terminal.note(next_step)
    terminal.document({"path": str(path)})


def _show(terminal: Terminal, found: ReducedExport) -> None:
    """What is left, and the file."""
    left = found.left.items()
    rows = [(name, f"{each.mean_mm:.4f}", f"{each.max_mm:.4f}") for name, each in left]
    terminal.table("Left of position over the workspace (mm)", ("with", "mean", "max"), rows)
    terminal.say(f"written: {found.path}")
