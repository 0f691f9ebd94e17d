"""Correction of targets by a campaign: for controllers that take no parameters."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from campaigns.campaign import Campaign
from campaigns.controllers.calibrated_workspace import (
    MARGIN_MM,
    TURN_MARGIN_DEG,
    CalibratedWorkspace,
)
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.controllers.export import FILE_NAME, warm_uncertainty
from campaigns.controllers.gcode import read_program
from campaigns.controllers.gcode_correction import TOLERANCE_MM, CorrectedProgram, correct_gcode
from campaigns.controllers.gcode_moves import ROTARY
from campaigns.controllers.load_checks import file_objections, read_parameter_file
from campaigns.controllers.program_targets import correct_program
from campaigns.controllers.target_poses import (
    CorrectedPoses,
    correct_poses,
    corrected_text,
    read_poses,
)
from campaigns.errors import ConfigInvalid
from campaigns.estimation.information import Uncertainty
from campaigns.files.text_file import write_text_unless_there
from campaigns.identification.result import RecordedIdentification
from campaigns.robots.reduced_form import form_of
from campaigns.robots.robot import RobotFile, at_temperature
from campaigns.settings.option import Option, require_finite
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.workflow.files import recorded
from campaigns.workflow.work import known_sets

Warm = Annotated[
    float | None,
    Option("Of a robot whose parts are so warm, by identified expansions.", metavar="DEG"),
]


@dataclass(frozen=True, slots=True)
class CorrectionTerms:
    """Parameter set that counts as the robot's, and how far beyond its shots it is believed."""

    robot: Annotated[
        Path | None,
        Option("The identified set. Default, in DIR: robot-compensated.yaml.", metavar="FILE"),
    ] = None
    margin_mm: Annotated[
        float,
        Option(
            "How far outside of the shots it is believed.", metavar="MM", least=0.0, name="--margin"
        ),
    ] = MARGIN_MM
    turn_margin_deg: Annotated[
        float, Option("The same for the turn.", metavar="DEG", least=0.0, name="--turn-margin")
    ] = TURN_MARGIN_DEG
    temperature: Warm = None
    """Of its parts, °C; None: the one that the set is stated for."""

    def __post_init__(self) -> None:
        require_finite("--margin", self.margin_mm)
        require_finite("--turn-margin", self.turn_margin_deg)
        require_finite("--temperature", self.temperature or 0.0)


def target_correction(campaign: Campaign, terms: CorrectionTerms | None = None) -> TargetCorrection:
    """Correction from the identified set to the nominal one, which the controller holds.

    σ are known where the set is that of an identification in the journal. Raises `ConfigInvalid`
    for a robot file that is not for this campaign, `ShotsMissing` without measured shots.
    """
    terms = terms or CorrectionTerms()
    cold = identified_set(campaign, terms.robot)
    robot = _as_warm(cold, terms)
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
        CalibratedWorkspace.of(poses, robot.mechanism.task, terms.margin_mm, terms.turn_margin_deg),
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


def correct_poses_file(
    campaign: Campaign, source: Path, to: Path, terms: CorrectionTerms, *, overwrite: bool
) -> CorrectedPoses:
    """Write a CSV file of wanted and commanded poses.

    Raises `TargetsInvalid`, `OutputExists` or `WriteFailed`.
    """
    mechanism = campaign.robot.mechanism
    targets, cold = read_poses(source, mechanism), identified_set(campaign, terms.robot)
    warm = _as_warm(cold, terms)
    form = form_of(warm.provenance, warm.name)
    found = correct_poses(targets, target_correction(campaign, terms))
    with recorded(campaign, to, warm.parameters, "targets", form):
        write_text_unless_there(to, corrected_text(found, mechanism.task), overwrite=overwrite)
    return found


def correct_program_file(
    campaign: Campaign,
    source: Path,
    to: Path,
    terms: CorrectionTerms,
    *,
    language: str = "gcode",
    tolerance_mm: float = TOLERANCE_MM,
    rotary: str = ROTARY,
    overwrite: bool,
) -> CorrectedProgram:
    """Write a program of corrected moves, or with corrected targets.

    `tolerance_mm` and `rotary` are G-code's. Raises `TargetsInvalid`,
    `OutputExists` or `WriteFailed`.
    """
    text, cold = read_program(source), identified_set(campaign, terms.robot)
    warm = _as_warm(cold, terms)
    form = form_of(warm.provenance, warm.name)
    correction = target_correction(campaign, terms)
    name = str(source)
    if language == "gcode":
        found = correct_gcode(text, name, correction, tolerance_mm=tolerance_mm, rotary=rotary)
    else:
        found = correct_program(text, name, language, correction)
    with recorded(campaign, to, warm.parameters, "targets", form):
        write_text_unless_there(to, found.text, overwrite=overwrite)
    return found


def _as_warm(robot: RobotFile, terms: CorrectionTerms) -> RobotFile:
    return robot if terms.temperature is None else at_temperature(robot, terms.temperature)


def _uncertainty(
    robot: RobotFile, found: RecordedIdentification | None, degC: float | None
) -> Uncertainty | None:
    """Uncertainty of the parameters that the robot file holds, as the identification stated it."""
    if found is None or found.covariance is None:
        return None
    known, own = found.covariance, robot.mechanism.parameters.of_robot
    known = known if degC is None else warm_uncertainty(robot, degC, known)
    return known.only(name for name in known.names if name in own)
