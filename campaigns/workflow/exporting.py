"""Export of a campaign: identified parameters and measured shots as files."""

# Each export of parameters follows one order: take the identification, refuse it unless it passed
# and still fits the nominal robot and the settings, build the file's text, and only then write it
# within `recorded`, which notes in the journal what was written. The forms differ in the
# parameters: all (`export`), all as LinuxCNC's pins (`export_hal`), or the nearest plain set
# (`export_plain`) or values of a printer's firmware (`export_firmware`), whose loss is stated in
# the file, in the journal and on the screen.

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.controllers import linuxcnc_export
from campaigns.controllers.delta_firmware import (
    Bed,
    FirmwareWord,
    Touches,
    firmware_text,
    project_firmware,
)
from campaigns.controllers.export import (
    FILE_NAME,
    PLAIN,
    PLAIN_FILE,
    CalibrationRoute,
    WrittenSet,
    compensated_robot,
    latest_identification,
    require_usable,
    written_sets,
)
from campaigns.controllers.issuer import Issuer
from campaigns.controllers.projection import position_errors, project_plain
from campaigns.errors import IdentificationRefused, ShotsMissing, VerdictBad
from campaigns.files.text_file import write_text_unless_there
from campaigns.identification.result import PositionStd, RecordedIdentification
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import Finding
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.robots.reduced_form import FORM, ReducedForm, form_of
from campaigns.robots.robot import RobotDocument, RobotFile, compensated
from campaigns.shots.import_export import ImportedFile, exported_shots
from campaigns.shots.observation_records import recorded_observations
from campaigns.shots.observations_csv import ObservationRow
from campaigns.shots.shots_csv import write_shots
from campaigns.version import VERSION

SHOTS_FILE = "shots.csv"
FIRMWARE_FILES: Mapping[FirmwareWord, str] = {
    "klipper": "klipper.cfg", "marlin": "marlin.gcode", "reprap": "reprap.gcode",
}  # fmt: skip
FIRMWARE_NOTES: Mapping[FirmwareWord, Sequence[str]] = {
    "klipper": (
        "Put these into printer.cfg, and delete the same keys from its block of SAVE_CONFIG, which",
        "take precedence: delta_radius, arm_length, angle, position_endstop.",
    ),
    "marlin": ("Send these, then M500.",),
    "reprap": ("Put these into config.g; config-override.g, if there is one, takes precedence.",),
}
"""What has to be done with each file."""
FEWEST_ON_PLANE = 3
"""Number of touches that place a bed."""


def identified_robot(campaign: Campaign) -> RobotDocument:
    """Return the nominal robot with the parameters of the latest identification.

    Raise `ShotsMissing` without an identification, and `VerdictBad` if it did not pass, or if the
    settings or the nominal robot have changed since.
    """
    with campaign.journal_reader() as journal:
        identification = usable_identification(campaign, journal)
        number = identification.provenance.series
        measured = next((s for s in journal.series() if s.number == number), None)
        issuer = issuer_of(campaign, journal)
    controller = measured.started.robot if measured else None
    return compensated_robot(issuer.stated(), campaign.nominal, identification, controller)


def usable_identification(campaign: Campaign, journal: JournalReader) -> RecordedIdentification:
    """Return the latest identification of a journal; raise what `identified_robot` does."""
    identification = latest_identification(journal)
    if outdated := campaign.outdated(identification):
        raise VerdictBad(
            f"{', '.join(outdated)} in campaign.yaml changed since the identification, which rests "
            "on it",
            remedy="identify again, or write it as it was",
        )
    require_usable(campaign.nominal, identification)
    return identification


def issuer_of(campaign: Campaign, journal: JournalReader | None = None) -> Issuer:
    """Return the campaign as the issuer of its files, by its journal, which is read if not given.

    Raise `JournalFailed` for a journal that cannot be read.
    """
    config, mechanism = campaign.config, campaign.robot.mechanism
    if journal is None and campaign.journal_path.exists():
        with campaign.journal_reader() as reader:
            return Issuer.of(config.name, config.identity, reader, mechanism)
    return Issuer.of(config.name, config.identity, journal, mechanism)


def export(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> tuple[Path, RobotFile]:
    """Write the latest identification as a robot file.

    Args:
        campaign: The campaign, identified with the verdict pass.
        to: The file; by default `robot-compensated.yaml` in the campaign's folder.
        overwrite: Whether a file of that name is replaced.

    Returns:
        The file's path, and the robot as written: parameters, 1 σ and provenance.

    Raises:
        ShotsMissing: Nothing has been identified yet.
        VerdictBad: The identification did not pass, or robot or settings changed since.
        OutputExists, WriteFailed: The file is there, or cannot be written.

    Example:
        >>> path, robot = workflow.export(open_campaign("cell-7"), overwrite=True)
    """
    path = to or campaign.path(FILE_NAME)
    identified = identified_robot(campaign)
    form = form_of(identified.robot.provenance, str(path))
    with recorded(campaign, path, identified.robot.parameters, form=form):
        write_text_unless_there(path, identified.document.text, overwrite=overwrite)
    return path, identified.robot


@dataclass(frozen=True, slots=True)
class PlainExport:
    """Written plain set, and its errors of position over the workspace beside two others."""

    path: Path
    form: ReducedForm
    """Position errors of the plain parameters, mm."""
    nominal: ReducedForm
    """Position errors of the nominal parameters, mm, to compare with."""
    std: PositionStd | None
    """1 σ of positions with all identified parameters, mm; None if unknown."""


def export_plain(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> PlainExport:
    """Write the nearest plain parameters, which every controller has, as a robot file.

    Raise `ShotsMissing` or `VerdictBad` without an identification that passed,
    `IdentificationRefused` if there are no nearest parameters, `OutputExists` or `WriteFailed`.
    """
    robot = identified_robot(campaign).robot
    plain, form = plain_form(campaign, robot)
    with campaign.journal_reader() as journal:
        std = latest_identification(journal).uncertainty.position_std_mm
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


@dataclass(frozen=True, slots=True)
class FirmwareExport(PlainExport):
    """Written values of a printer's firmware."""

    bed: Bed | None
    """Bed that they are level to; None: no heights were observed."""


def export_firmware(
    campaign: Campaign, firmware: FirmwareWord, to: Path | None = None, *, overwrite: bool = False
) -> FirmwareExport:
    """Write the values of a Delta printer's firmware that come nearest to what was identified.

    Where heights of a bed were observed, z = 0 is that bed. Raise `ShotsMissing` or `VerdictBad`
    without an identification that passed, `IdentificationRefused` for a robot that is no linear
    Delta, `OutputExists` or `WriteFailed`.
    """
    robot, poses = identified_robot(campaign).robot, _workspace(campaign)
    with campaign.journal_reader() as journal:
        std = latest_identification(journal).uncertainty.position_std_mm
        touches = _touches_of_bed(recorded_observations(journal).rows)
    switch_mm = robot.limits.joint_range[1]
    made = project_firmware(robot.kinematics, poses, switch_mm, touches)
    form = _form_of_errors(robot, made.errors_mm, firmware)
    origin = "of the base frame" if touches is None else "the bed, by the heights observed"
    notes = [
        f"{firmware}: values of {campaign.robot_identity}, written by pkmcal {VERSION}",
        f"identified sha256: {robot.digest()}",
        f"a reduced set of the identified parameters, which {form.loses}",
        f"z = 0 is {origin}; end stops at a reading of {switch_mm:g} mm",
        *FIRMWARE_NOTES[firmware],
    ]
    path = to or campaign.path(FIRMWARE_FILES[firmware])
    with recorded(campaign, path, made.kinematics.parameters, form=form):
        text = firmware_text(firmware, made.values, notes)
        write_text_unless_there(path, text, overwrite=overwrite)
    return FirmwareExport(path, form, _form(campaign.robot.kinematics, robot, poses), std, made.bed)


def _touches_of_bed(rows: Sequence[ObservationRow]) -> Touches | None:
    """Return the touches of the bed that was touched most; None without enough of them."""
    heights = [row for row in rows if row.kind == "height"]
    counts = Counter(row.object for row in heights)
    touched = [row for row in heights if row.object == max(counts, key=lambda name: counts[name])]
    if len(touched) < FEWEST_ON_PLANE:
        return None
    joints = np.array([row.joints[0] for row in touched])
    return Touches(joints, np.array([row.values[0] for row in touched]))


def plain_form(campaign: Campaign, robot: RobotFile) -> tuple[Kinematics, ReducedForm]:
    """Return the model of the nearest plain parameters, and their loss over the workspace.

    Raise `IdentificationRefused` if the robot can take hardly any pose.
    """
    # export and load both call this function, so that both state the same loss
    poses = _workspace(campaign)
    plain = project_plain(robot.kinematics, poses)
    return plain, _form(plain, robot, poses)


def _form(controller: Kinematics, robot: RobotFile, poses: Array) -> ReducedForm:
    """Return a controller's model as a form of a robot's set, with its errors at poses (N, t)."""
    return _form_of_errors(robot, position_errors(controller, robot.kinematics, poses), PLAIN)


def _form_of_errors(robot: RobotFile, sizes_mm: Array, name: str) -> ReducedForm:
    """Return a named form of a robot's set, by the sizes (M,) of its position errors."""
    return ReducedForm(
        of=robot.digest(),
        lost_mean_mm=float(sizes_mm.mean()),
        lost_max_mm=float(sizes_mm.max()),
        lost_rms_mm=float(np.sqrt(np.mean(sizes_mm**2))),
        name=name,
    )


def _workspace(campaign: Campaign) -> Array:
    """Return poses (N, t) all over the workspace, at which every step judges positions.

    Raise `IdentificationRefused` if there are hardly any.
    """
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
    """Hold the journal while the block writes a file for a controller, and then record the file.

    A block that raises leaves no record. Corrected targets are recorded once for each set.
    """
    with campaign.journal_reader() as reader:
        last = next(written_sets(reader), None)
    # One program after another is corrected with the same set: the record of the first one says
    # everything that later commands ask, and the journal need not be locked for the others.
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
    """Write the latest identification as a HAL file for LinuxCNC's kinematics module pkmkins.

    Args:
        campaign: The campaign, identified with the verdict pass.
        to: The file; by default `calib.hal` in the campaign's folder.
        overwrite: Whether a file of that name is replaced.

    Returns:
        The file's path.

    Raises:
        ShotsMissing, VerdictBad, OutputExists, WriteFailed: As of `export`.
        ConfigInvalid: The ripples of joints have unlike rates, which pkmkins cannot have.
    """
    path = to or campaign.path(linuxcnc_export.FILE_NAME)
    # The drawing of the plate is the nominal robot's: identified tilts refer to it, and an
    # identification lists parameters only. The ripples' rates are the identified set's.
    identified = identified_robot(campaign).robot
    mechanism = campaign.robot.mechanism.with_ripples(identified.mechanism.rates)
    robot = replace(identified, mechanism=mechanism)
    form = form_of(robot.provenance, str(path))
    with recorded(campaign, path, robot.parameters, form=form):
        linuxcnc_export.write_hal(path, robot, campaign.robot_identity, overwrite=overwrite)
    return path


def export_shots(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> tuple[Path, tuple[int, ...]]:
    """Write the accepted shots of the latest run or import as a CSV file.

    Args:
        campaign: The campaign.
        to: The file; by default `shots.csv` in the campaign's folder.
        overwrite: Whether a file of that name is replaced.

    Returns:
        The file's path, and the numbers of shots left out because their pair is not whole.

    Raises:
        ShotsMissing: Nothing has been measured yet.
        OutputExists, WriteFailed: The file is there, or cannot be written.
    """
    path = to or campaign.path(SHOTS_FILE)
    with campaign.journal_reader() as journal:
        if recorded_observations(journal).files and campaign.series_to_identify(journal) is None:
            raise ShotsMissing(
                f"{campaign.folder}: no tracker has measured: there are observations and no shots",
                remedy="the imported files of observations are as they were measured",
            )
        series = campaign.measured_series(journal)
        accepted = journal.shots(series.number)
        rows, halves = exported_shots(series, accepted, campaign.robot.mechanism)
    write_shots(path, rows, campaign.robot.mechanism, overwrite=overwrite)
    return path, halves
