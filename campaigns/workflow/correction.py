"""Correction of targets by a campaign: for controllers that take no parameters."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from campaigns.campaign import Campaign
from campaigns.controllers.corrected_targets import CorrectedFile, TargetCorrection
from campaigns.controllers.export import FILE_NAME, warm_uncertainty
from campaigns.controllers.load_checks import file_objections, read_parameter_file
from campaigns.controllers.target_poses import correct_poses
from campaigns.errors import ConfigInvalid, TargetsInvalid
from campaigns.estimation.information import Uncertainty
from campaigns.files.text_file import read_text, write_text_unless_there
from campaigns.identification.result import RecordedIdentification
from campaigns.robots.reduced_form import form_of
from campaigns.robots.robot import RobotFile, at_temperature
from campaigns.settings.option import Option, require_finite
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.workflow.files import recorded
from campaigns.workflow.work import known_sets
from drivers.bounded_files import CSV_BYTES

Warm = Annotated[
    float | None,
    Option(
        "Of a robot whose parts are so warm, by identified expansions.",
        metavar="DEG",
        least=-50.0,
        most=150.0,
    ),
]


@dataclass(frozen=True, slots=True)
class CorrectionTerms:
    """Parameter set that counts as the robot's, and how warm its parts are."""

    robot: Annotated[
        Path | None,
        Option("The identified set. Default, in DIR: robot-compensated.yaml.", metavar="FILE"),
    ] = None
    temperature: Warm = None
    """Of its parts, °C; None: the one that the set is stated for."""

    def __post_init__(self) -> None:
        require_finite("--temperature", self.temperature or 0.0)


def _target_correction(campaign: Campaign, cold: RobotFile, robot: RobotFile) -> TargetCorrection:
    """Correction from the identified set, as warm as it is, to the nominal one.

    σ are known where the set is that of an identification in the journal. Raises `ShotsMissing`
    without measured shots.
    """
    found = known_sets(campaign).identified.get(cold.digest())
    with campaign.journal_reader() as journal:
        series = found.series if found else campaign.measured_series(journal).number
        shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    identified, own = robot.kinematics.controlled, campaign.robot.kinematics.controlled
    measured = identified.forward(shots.of_set(ShotSet.IDENTIFICATION).joints)
    poses = measured.values[measured.found]
    return TargetCorrection(
        identified,
        own,
        campaign.robot.limits,
        campaign.space,
        _uncertainty(cold, found, robot.reference_degC),
        poses,
    )


def identified_set(campaign: Campaign, path: Path | None = None) -> RobotFile:
    """Identified robot of a file, the exported one by default; raises `ConfigInvalid`."""
    path = path or campaign.path(FILE_NAME)
    robot = read_parameter_file(path, campaign.folder, campaign.robot)
    objections = tuple(file_objections(robot, campaign.config.name, campaign.robot))
    if objections:
        problems = "; ".join(each.problem for each in objections)
        raise ConfigInvalid(
            f"{path}: {problems}",
            remedy=f"take the file that `pkmcal export {campaign.folder} --overwrite` writes",
        )
    return robot


def correct_file(
    campaign: Campaign, source: Path, to: Path, terms: CorrectionTerms, *, overwrite: bool
) -> CorrectedFile:
    """Write a CSV file of wanted and commanded poses.

    Raises `TargetsInvalid`, `OutputExists` or `WriteFailed`.
    """
    text = read_text(source, TargetsInvalid, if_missing="name a CSV file", most_bytes=CSV_BYTES)
    warm = cold = identified_set(campaign, terms.robot)
    if terms.temperature is not None:
        warm = at_temperature(cold, terms.temperature)
    form = form_of(warm.provenance, warm.name)
    found = correct_poses(text, str(source), _target_correction(campaign, cold, warm))
    with recorded(campaign, to, warm.parameters, "targets", form):
        write_text_unless_there(to, found.text, overwrite=overwrite)
    return found


def _uncertainty(
    robot: RobotFile, found: RecordedIdentification | None, degC: float | None
) -> Uncertainty | None:
    """Uncertainty of the parameters that the robot file holds, as the identification stated it."""
    if found is None or found.covariance is None:
        return None
    known, own = found.covariance, robot.mechanism.parameters.of_robot
    known = known if degC is None else warm_uncertainty(robot, degC, known)
    return known.only(name for name in known.names if name in own)
