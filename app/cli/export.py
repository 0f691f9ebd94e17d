"""pkmcal export: the compensated parameter file."""

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.robots.robot import RobotDocument, RobotFile

SHOTS = "shots.csv"


class Format(Enum):
    """What the identified parameters are written as."""

    YAML = "yaml"
    LINUXCNC = "linuxcnc"


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
        Format, typer.Option("--format", help="yaml: a robot file. linuxcnc: a HAL file.")
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
    """
    from app.console import terminal_of
    from app.folder import open_campaign
    from campaigns.robots.robot import NOT_FOR_CONTROLLERS

    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    if shots:
        path, next_step = export_shots(campaign, to, terminal, overwrite=overwrite), ""
    elif format_ is Format.LINUXCNC:
        path, next_step = export_hal(campaign, to, overwrite=overwrite), ""
    else:
        path, robot = export(campaign, to, overwrite=overwrite)
        next_step = NOT_FOR_CONTROLLERS if robot.is_tilted else f"next: pkmcal load {folder}"
    terminal.say(f"written: {path}")
    if next_step:
        terminal.note(next_step)
    terminal.document({"path": str(path)})


def export(
    campaign: "Campaign", to: Path | None = None, *, overwrite: bool = False
) -> "tuple[Path, RobotFile]":
    """Write the latest identification; raises `VerdictBad`, `OutputExists` or `WriteFailed`."""
    from campaigns.controllers.export import FILE_NAME, write_compensated

    path, identified = to or campaign.path(FILE_NAME), _identified(campaign)
    write_compensated(path, identified, overwrite=overwrite)
    return path, identified.robot


def export_hal(campaign: "Campaign", to: Path | None = None, *, overwrite: bool = False) -> Path:
    """Write the same for LinuxCNC's kinematics par4kins; raises likewise."""
    from campaigns.controllers.linuxcnc_export import FILE_NAME, write_hal

    path = to or campaign.path(FILE_NAME)
    write_hal(path, _identified(campaign).robot, campaign.robot_identity, overwrite=overwrite)
    return path


def _identified(campaign: "Campaign") -> "RobotDocument":
    """The nominal robot with the parameters of the latest identification."""
    from app.folder import require_journal
    from campaigns.controllers.export import compensated_robot, latest_identification
    from campaigns.journal.journal import read_journal

    with read_journal(require_journal(campaign)) as journal:
        finding = latest_identification(journal)
    return compensated_robot(campaign.config.name, campaign.nominal, finding)


def export_shots(
    campaign: "Campaign", to: Path | None, terminal: "Terminal", *, overwrite: bool
) -> Path:
    """Write the accepted shots of the latest run or import; raises `OutputExists`."""
    from app.folder import measured_series, require_journal
    from campaigns.journal.journal import read_journal
    from campaigns.shots.import_export import exported_shots
    from campaigns.shots.shots_csv import write_shots

    path = to or campaign.path(SHOTS)
    with read_journal(require_journal(campaign)) as journal:
        series = measured_series(campaign, journal)
        found = exported_shots(series, journal.shots(series.number))
    write_shots(path, found.rows, overwrite=overwrite)
    if found.halves:
        terminal.note(f"left out, as their partner is missing: shots {found.halves}")
    return path
