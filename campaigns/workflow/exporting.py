"""Export of a campaign: identified parameters and measured shots as files."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.controllers import linuxcnc_export
from campaigns.controllers.export import (
    FILE_NAME,
    PLAIN,
    PLAIN_FILE,
    CalibrationRoute,
    WrittenSet,
    compensated_robot,
    latest_identification,
    written_sets,
)
from campaigns.controllers.projection import position_errors, project_plain
from campaigns.errors import IdentificationRefused, VerdictBad
from campaigns.files.text_file import write_text_unless_there
from campaigns.identification.result import PositionStd
from campaigns.journal.records import Finding
from campaigns.kinematics.mechanism import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.robots.reduced_form import FORM, ReducedForm, form_of
from campaigns.robots.robot import RobotDocument, RobotFile, compensated
from campaigns.shots.import_export import ImportedFile, exported_shots
from campaigns.shots.shots_csv import write_shots

SHOTS_FILE = "shots.csv"


def identified_robot(campaign: Campaign) -> RobotDocument:
    """Return the nominal robot with the parameters of the latest identification.

    Raises `ShotsMissing` without one, and `VerdictBad` for one that did not pass.
    """
    with campaign.journal_reader() as journal:
        identification = latest_identification(journal)
        measured = next((s for s in journal.series() if s.number == identification.series), None)
    if outdated := campaign.outdated(identification):
        raise VerdictBad(
            f"{', '.join(outdated)} in campaign.yaml changed since the identification, which rests "
            "on it",
            remedy="identify again, or write it as it was",
        )
    controller = measured.started.robot if measured else None
    return compensated_robot(campaign.config.name, campaign.nominal, identification, controller)


def export(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> tuple[Path, RobotFile]:
    """Write the latest identification as a robot file.

    Raises `ConfigInvalid`, `VerdictBad`, `OutputExists` or `WriteFailed`.
    """
    path = to or campaign.path(FILE_NAME)
    identified = identified_robot(campaign)
    form = form_of(identified.robot.provenance, str(path))
    with recorded(campaign, path, identified.robot.parameters, form=form):
        write_text_unless_there(path, identified.document.text, overwrite=overwrite)
    return path, identified.robot


@dataclass(frozen=True, slots=True)
class PlainExport:
    """Written file, and errors of position over the workspace, mm."""

    path: Path
    form: ReducedForm
    """With what the plain parameters lose."""
    nominal: ReducedForm
    """With what the nominal ones lose."""
    std: PositionStd | None
    """1 σ of positions with all identified parameters; None: it is not known."""


def export_plain(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> PlainExport:
    """Write the nearest parameters of those that every controller knows as a robot file.

    Raises `VerdictBad`, `IdentificationRefused`, `OutputExists` or `WriteFailed`.
    """
    robot = identified_robot(campaign).robot
    plain, form = plain_form(campaign, robot)
    with campaign.journal_reader() as journal:
        std = latest_identification(journal).position_std_mm
    document = compensated(
        campaign.nominal,
        f"{campaign.robot.name}-{PLAIN}",
        plain.parameters,
        {**(robot.provenance or {}), FORM: asdict(form)},
    )
    path = to or campaign.path(PLAIN_FILE)
    with recorded(campaign, path, document.robot.parameters, form=form):
        write_text_unless_there(path, document.document.text, overwrite=overwrite)
    nominal = _form(campaign.robot.kinematics, robot, _workspace(campaign))
    return PlainExport(path, form, nominal, std)


def plain_form(campaign: Campaign, robot: RobotFile) -> tuple[Kinematics, ReducedForm]:
    """Return the nearest plain parameters to a robot's, and their loss over the workspace.

    The only place that says what is lost. Raises `IdentificationRefused`.
    """
    poses = _workspace(campaign)
    plain = project_plain(robot.kinematics, poses)
    return plain, _form(plain, robot, poses)


def _form(controller: Kinematics, robot: RobotFile, poses: Array) -> ReducedForm:
    sizes_mm = position_errors(controller, robot.kinematics, poses)
    return ReducedForm(
        of=robot.digest(),
        lost_mean_mm=float(sizes_mm.mean()),
        lost_max_mm=float(sizes_mm.max()),
        lost_rms_mm=float(np.sqrt(np.mean(sizes_mm**2))),
        name=PLAIN,
    )


def _workspace(campaign: Campaign) -> Array:
    """Return poses (N, t) all over the workspace: those at which every step judges positions."""
    poses = campaign.workspace_sample()
    if poses is None:
        raise IdentificationRefused(
            "the robot can take hardly any pose",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        )
    return poses


@contextmanager
def recorded(
    campaign: Campaign,
    path: Path,
    parameters: Parameters,
    by: CalibrationRoute = "parameters",
    form: ReducedForm | None = None,
) -> Iterator[None]:
    """Hold the journal while the block writes a file for a controller, and then record it.

    Of corrected targets, of which there are many, only the first with a set is recorded.
    """
    with campaign.journal_reader() as reader:
        last = next(written_sets(reader), None)
    if by == "targets" and last is not None and (last.digest, last.by) == (parameters.digest(), by):
        yield
        return
    with campaign.journal() as journal:
        yield
        sha256 = "" if by == "targets" else ImportedFile.of(path).sha256
        written = WrittenSet.of(path.name, parameters, by=by, sha256=sha256, projection=form)
        if written != last:
            journal.append(Finding("export", asdict(written)))


def export_hal(campaign: Campaign, to: Path | None = None, *, overwrite: bool = False) -> Path:
    """Write the latest identification for LinuxCNC's kinematics; raises as `export` does."""
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
        rows, halves = exported_shots(series, accepted, campaign.robot.mechanism)
    write_shots(path, rows, campaign.robot.mechanism, overwrite=overwrite)
    return path, halves
