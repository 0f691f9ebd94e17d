"""Files of a campaign: shots taken in, identified parameters and measured shots written out."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from campaigns.campaign import Campaign
from campaigns.controllers import export as parameter_file
from campaigns.controllers import linuxcnc_export
from campaigns.evaluation.plausibility import check_distances, check_shots
from campaigns.robots.robot import RobotDocument, RobotFile
from campaigns.shots.import_export import ExportedShots, ImportedFile, append_import, exported_shots
from campaigns.shots.shots import shots_of_rows
from campaigns.shots.shots_csv import ShotRow, write_shots

SHOTS_FILE = "shots.csv"


def identified_robot(campaign: Campaign) -> RobotDocument:
    """Nominal robot with the parameters of the latest identification.

    Raises `ShotsMissing` without one, and `VerdictBad` for one that did not pass.
    """
    with campaign.journal_reader() as journal:
        found = parameter_file.latest_identification(journal)
        measured = next((s for s in journal.series() if s.number == found.series), None)
    controller = measured.started.robot if measured else None
    return parameter_file.compensated_robot(
        campaign.config.name, campaign.nominal, found, controller
    )


def export(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> tuple[Path, RobotFile]:
    """Write the latest identification as a robot file.

    Raises `VerdictBad`, `OutputExists` or `WriteFailed`.
    """
    path, identified = to or campaign.path(parameter_file.FILE_NAME), identified_robot(campaign)
    parameter_file.write_compensated(path, identified, overwrite=overwrite)
    return path, identified.robot


def export_hal(campaign: Campaign, to: Path | None = None, *, overwrite: bool = False) -> Path:
    """Write the same for LinuxCNC's kinematics; raises likewise."""
    path = to or campaign.path(linuxcnc_export.FILE_NAME)
    # a plate tilts as the nominal robot's drawing has it, also where a file says nothing of it
    robot = replace(identified_robot(campaign).robot, mechanism=campaign.robot.mechanism)
    linuxcnc_export.write_hal(path, robot, campaign.robot_identity, overwrite=overwrite)
    return path


def export_shots(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> tuple[Path, ExportedShots]:
    """Write the accepted shots of the latest run or import; raises `OutputExists`."""
    path = to or campaign.path(SHOTS_FILE)
    with campaign.journal_reader() as journal:
        series = campaign.measured_series(journal)
        found = exported_shots(series, journal.shots(series.number))
    write_shots(path, found.rows, campaign.robot.mechanism, overwrite=overwrite)
    return path, found


def import_shots(
    campaign: Campaign,
    rows: Sequence[ShotRow],
    name: str = "shots",
    files: Sequence[ImportedFile] = (),
) -> int:
    """Write shots of files into the journal as a series; gives its number.

    Raises `ShotsInvalid`, naming file and cause, for shots that cannot be this robot's.
    """
    robot, settings = campaign.robot, campaign.config.model_dump(mode="json")
    shots = shots_of_rows(rows, robot.kinematics)
    check_shots(robot.kinematics, shots, name)
    check_distances(robot.kinematics, shots, campaign.config.gate.distance_mm, name)
    with campaign.journal() as journal:
        return append_import(journal, rows, robot.kinematics, robot.digest(), settings, files)
