"""Files of a campaign: identified parameters and measured shots written out."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path

from campaigns.campaign import Campaign
from campaigns.controllers import export as parameter_file
from campaigns.controllers import linuxcnc_export
from campaigns.controllers.export import CalibrationRoute, WrittenSet
from campaigns.errors import VerdictBad
from campaigns.files.text_file import write_text_unless_there
from campaigns.journal.records import Finding
from campaigns.kinematics.parameters import Parameters
from campaigns.robots.reduced_form import ReducedForm, form_of
from campaigns.robots.robot import RobotDocument, RobotFile
from campaigns.shots.import_export import ImportedFile, exported_shots
from campaigns.shots.shots import shots_of_journal
from campaigns.shots.shots_csv import write_shots

SHOTS_FILE = "shots.csv"


def identified_robot(campaign: Campaign) -> RobotDocument:
    """Nominal robot with the parameters of the latest identification.

    Raises `ShotsMissing` without one, and `VerdictBad` for one that did not pass.
    """
    with campaign.journal_reader() as journal:
        found = parameter_file.latest_identification(journal)
        measured = next((s for s in journal.series() if s.number == found.series), None)
    if outdated := campaign.outdated(found):
        raise VerdictBad(
            f"{', '.join(outdated)} in campaign.yaml changed since the identification, which rests "
            "on it",
            remedy="identify again, or write it as it was",
        )
    controller = measured.started.robot if measured else None
    return parameter_file.compensated_robot(
        campaign.config.name, campaign.nominal, found, controller
    )


def export(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> tuple[Path, RobotFile]:
    """Write the latest identification as a robot file.

    Raises `ConfigInvalid`, `VerdictBad`, `OutputExists` or `WriteFailed`.
    """
    path = to or campaign.path(parameter_file.FILE_NAME)
    identified = identified_robot(campaign)
    form = form_of(identified.robot.provenance, str(path))
    with recorded(campaign, path, identified.robot.parameters, form=form):
        write_text_unless_there(path, identified.document.text, overwrite=overwrite)
    return path, identified.robot


@contextmanager
def recorded(
    campaign: Campaign,
    path: Path,
    own: Parameters,
    by: CalibrationRoute = "parameters",
    form: ReducedForm | None = None,
) -> Iterator[None]:
    """While the block writes a file for a controller, hold the journal that then tells of it.

    Of corrected targets, of which there are many, the first with a set alone is told and held for.
    """
    with campaign.journal_reader() as reader:
        last = next(parameter_file.written_sets(reader), None)
    if by == "targets" and last is not None and (last.digest, last.by) == (own.digest(), by):
        yield
        return
    with campaign.journal() as journal:
        yield
        sha256 = "" if by == "targets" else ImportedFile.of(path).sha256
        more = {"by": by, "sha256": sha256, "projection": form}
        written = WrittenSet.of(path.name, own, **more)
        if written != last:
            journal.append(Finding("export", asdict(written)))


def export_hal(campaign: Campaign, to: Path | None = None, *, overwrite: bool = False) -> Path:
    """Write the same for LinuxCNC's kinematics; raises likewise."""
    path = to or campaign.path(linuxcnc_export.FILE_NAME)
    # a plate tilts as the nominal robot's drawing has it, also where a file says nothing of it
    identified = identified_robot(campaign).robot
    mechanism = campaign.robot.mechanism.with_ripples(identified.mechanism.rate)
    robot = replace(identified, mechanism=mechanism)
    form = form_of(robot.provenance, str(path))
    with recorded(campaign, path, robot.parameters, form=form):
        linuxcnc_export.write_hal(path, robot, campaign.robot_identity, overwrite=overwrite)
    return path


def export_shots(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> tuple[Path, tuple[int, ...]]:
    """Write the accepted shots of the latest run or import; raises `OutputExists`.

    Gives the file, and the shots that were left out.
    """
    path = to or campaign.path(SHOTS_FILE)
    with campaign.journal_reader() as journal:
        series = campaign.measured_series(journal)
        accepted = journal.shots(series.number)
        approach = shots_of_journal(accepted, campaign.robot.mechanism).approach
        rows, halves = exported_shots(series, accepted, approach)
    write_shots(path, rows, campaign.robot.mechanism, overwrite=overwrite)
    return path, halves
