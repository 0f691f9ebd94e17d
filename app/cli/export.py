"""pkmcal export: the compensated parameter file."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from app.console import Terminal, terminal_of
from app.next import tell_next
from app.options import Folder, Json, Overwrite
from campaigns.campaign import Campaign, open_campaign
from campaigns.controllers.model_reduction import ResidualError
from campaigns.files.table import Column, words
from campaigns.robots.robot import FOR_SOME_CONTROLLERS
from campaigns.workflow import files
from campaigns.workflow.reduced_export import ReducedExport, export_plain

Format = Literal["yaml", "linuxcnc", "plain"]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    to: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Default, in DIR: robot-compensated.yaml, calib.hal, shots.csv …"
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
            help="yaml: a robot file. linuxcnc: a HAL file for pkmkins. plain: a robot file "
            "without tilts, skews and gears, of the nearest values.",
        ),
    ] = "yaml",
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write the identified parameters as a robot file.

    The file contains the parameters, 1 σ of each identified one, their provenance, and the sha256
    of the geometry. Only an identification with the verdict "pass" is written. The file can be the
    nominal robot of a later campaign.

    For a controller with fewer parameters (plain) it contains the values that minimise the mean
    square error of position over the workspace, and the remaining error is shown beside that of all
    parameters.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    with terminal.refusals_documented():
        if format_ == "plain" and not shots:
            _show(terminal, campaign, export_plain(campaign, to, overwrite=overwrite))
            return
        if shots:
            path, halves = files.export_shots(campaign, to, overwrite=overwrite)
            if halves:
                terminal.note(f"left out because their pair is incomplete: shots {halves}")
        elif format_ == "linuxcnc":
            path = files.export_hal(campaign, to, overwrite=overwrite)
        else:
            path, robot = files.export(campaign, to, overwrite=overwrite)
            if robot.is_extended:
                terminal.note(FOR_SOME_CONTROLLERS)
    terminal.say(f"written: {path}")
    terminal.document({"path": str(path)} | tell_next(terminal, campaign))


def _show(terminal: Terminal, campaign: Campaign, found: ReducedExport) -> None:
    """What is left, the file, and the next command, for people and for programs."""
    columns: tuple[Column[tuple[str, ResidualError]], ...] = (
        words("with", lambda row: row[0]),
        Column("mean", lambda row: row[1].mean_mm, decimals=4),
        Column("max", lambda row: row[1].max_mm, decimals=4),
    )
    terminal.rows("Remaining error of position (mm)", columns, found.left.items())
    terminal.say(f"written: {found.path}")
    terminal.document(found.document() | tell_next(terminal, campaign))
