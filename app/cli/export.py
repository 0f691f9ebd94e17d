"""pkmcal export: the compensated parameter file."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal, terminal_of
from app.next import tell_next
from app.options import Folder, Json, Overwrite
from campaigns.campaign import Campaign, open_campaign
from campaigns.controllers import joint_tables
from campaigns.controllers.export import PLAIN
from campaigns.controllers.model_reduction import ResidualError
from campaigns.controllers.reduced_parameters import FORMATS
from campaigns.errors import OptionsInvalid
from campaigns.files.table import Column, words
from campaigns.robots.robot import FOR_SOME_CONTROLLERS
from campaigns.settings.option import Option, require_finite
from campaigns.workflow import files
from campaigns.workflow.correction import Warm
from campaigns.workflow.reduced_export import ReducedExport, export_joint_tables, export_projected

WORDS = ("yaml", "linuxcnc", *FORMATS, "plain", *files.DESCRIPTIONS)
Format = StrEnum("Format", {word: word for word in WORDS})  # type: ignore[misc] # words of another room
YAML = Format("yaml")
Tables = StrEnum("Tables", {word: word for word in joint_tables.FORMATS})  # type: ignore[misc] # words of another room
Tolerance = Annotated[
    float,
    Option(
        "Allowed error of the tables at a crank's end, or of a carriage.", metavar="MM", least=1e-6
    ),
]


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
            help="yaml: a robot file. linuxcnc: a HAL file for pkmkins. Nearest values for fewer "
            f"parameters: {', '.join(FORMATS)}; plain: a robot file without tilts and skews. "
            "urdf, sdf: a description for simulators.",
        ),
    ] = YAML,
    joint_table: Annotated[
        Tables | None,
        typer.Option(
            metavar="FORM",
            help="Errors of gears and encoders as tables of axes (csv, linuxcnc, twincat), with "
            "a robot file of the rest; together with --format plain, of its plain form.",
        ),
    ] = None,
    tolerance: Tolerance = joint_tables.TOLERANCE_MM,
    temperature: Warm = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Write the identified parameters as a robot file.

    The file contains the parameters, 1 σ of each identified one, their provenance, and the sha256
    of the geometry. Only an identification with the verdict "pass" is written. The file can be the
    nominal robot of a later campaign.

    For a controller with fewer parameters it contains the values that minimise the mean square
    error of position over the workspace, and the remaining error is shown beside that of all
    parameters.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    if temperature is not None:
        require_finite("--temperature", temperature)
        if shots or joint_table is not None or format_ not in {YAML, "linuxcnc"}:
            raise OptionsInvalid(
                "--temperature goes with --format yaml or linuxcnc", remedy="leave the other out"
            )
    if joint_table is not None:
        if shots or format_ not in {YAML, PLAIN}:
            raise OptionsInvalid(
                "--joint-table goes with --format yaml or plain", remedy="leave the other one out"
            )
        found = export_joint_tables(
            campaign,
            str(joint_table),
            to,
            tolerance_mm=tolerance,
            plain=format_ == PLAIN,
            overwrite=overwrite,
        )
        _show(terminal, campaign, found)
        return
    if format_ in {*FORMATS, PLAIN} and not shots:
        _show(terminal, campaign, export_projected(campaign, str(format_), to, overwrite=overwrite))
        return
    if shots:
        path, halves = files.export_shots(campaign, to, overwrite=overwrite)
        if halves:
            terminal.note(f"left out because their pair is incomplete: shots {halves}")
    else:
        path = _whole_set(terminal, campaign, format_, to, temperature, overwrite=overwrite)
    terminal.say(f"written: {path}")
    terminal.document({"path": str(path)} | tell_next(terminal, campaign))


def _whole_set(
    terminal: Terminal,
    campaign: Campaign,
    format_: Format,
    to: Path | None,
    temperature: float | None,
    *,
    overwrite: bool,
) -> Path:
    """File of all identified parameters, written."""
    if format_ in files.DESCRIPTIONS:
        return files.export_description(campaign, str(format_), to, overwrite=overwrite)
    if format_ == "linuxcnc":
        return files.export_hal(campaign, to, temperature, overwrite=overwrite)
    path, robot = files.export(campaign, to, temperature, overwrite=overwrite)
    if robot.is_extended:
        terminal.note(FOR_SOME_CONTROLLERS)
    return path


def _show(terminal: Terminal, campaign: Campaign, found: ReducedExport) -> None:
    """What is left, the file, and the next command, for people and for programs."""
    columns: tuple[Column[tuple[str, ResidualError]], ...] = (
        words("with", lambda row: row[0]),
        Column("mean", lambda row: row[1].mean_mm, decimals=4),
        Column("max", lambda row: row[1].max_mm, decimals=4),
    )
    left = found.left.items()
    terminal.rows("Remaining error of position (mm)", columns, left)
    if found.tables is not None:
        terminal.say(
            f"tables of {len(found.tables.wanted)} points, off by {found.tables.left_mm:.4f} mm at "
            f"most, at a crank's end or of a carriage: {', '.join(e.name for e in found.files)}"
        )
    terminal.say(f"written: {found.path}")
    terminal.document(found.document() | tell_next(terminal, campaign))
