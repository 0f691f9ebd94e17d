"""Correction of targets by a campaign: for controllers that take no parameters."""

from pathlib import Path

from campaigns.campaign import Campaign
from campaigns.controllers.corrected_targets import CorrectedFile, TargetCorrection, correct_poses
from campaigns.controllers.export import FILE_NAME
from campaigns.controllers.load_checks import file_objections, read_parameter_file
from campaigns.errors import ConfigInvalid, TargetsInvalid
from campaigns.files.text_file import read_text, write_text_unless_there
from campaigns.robots.reduced_form import form_of
from campaigns.robots.robot import RobotFile
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.workflow.exporting import identified_robot, recorded
from campaigns.workflow.work import known_sets
from drivers.bounded_files import CSV_BYTES


def _target_correction(campaign: Campaign, robot: RobotFile) -> TargetCorrection:
    """Return the correction from the identified set to the nominal one.

    σ are known where the set is that of an identification in the journal. Raises `ShotsMissing`
    without measured shots.
    """
    identification = known_sets(campaign).identified.get(robot.digest())
    with campaign.journal_reader() as journal:
        series = (
            identification.series if identification else campaign.measured_series(journal).number
        )
        shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    identified, nominal = robot.kinematics.controlled, campaign.robot.kinematics.controlled
    measured = identified.forward(shots.of_set(ShotSet.IDENTIFICATION).joints)
    poses = measured.values[measured.is_solved]
    return TargetCorrection(
        identified,
        nominal,
        campaign.robot.limits,
        campaign.space,
        None if identification is None else identification.covariance,
        poses,
    )


def identified_set(campaign: Campaign, path: Path | None = None) -> RobotFile:
    """Return the identified robot of a file, by default the exported one, or of the journal.

    Raises `ConfigInvalid`, and `VerdictBad` for an identification that did not pass.
    """
    if path is None and not campaign.path(FILE_NAME).exists():
        return identified_robot(campaign).robot
    path = path or campaign.path(FILE_NAME)
    robot = read_parameter_file(path, campaign.folder, campaign.robot)
    objections = tuple(file_objections(robot, campaign.config.name, campaign.robot))
    if objections:
        problems = "; ".join(each.problem for each in objections)
        raise ConfigInvalid(
            f"{path}: {problems}",
            remedy=f"take the file that `pkmcal export {campaign.folder} --force` writes",
        )
    return robot


def correct_file(
    campaign: Campaign, source: Path, to: Path, identified: Path | None = None, *, overwrite: bool
) -> CorrectedFile:
    """Write a CSV file of wanted and commanded poses, by a robot file, by default export's.

    Raises `TargetsInvalid`, `OutputExists` or `WriteFailed`.
    """
    text = read_text(source, TargetsInvalid, if_missing="name a CSV file", most_bytes=CSV_BYTES)
    robot = identified_set(campaign, identified)
    form = form_of(robot.provenance, robot.name)
    corrected = correct_poses(text, str(source), _target_correction(campaign, robot))
    with recorded(campaign, to, robot.parameters, "targets", form):
        write_text_unless_there(to, corrected.text, overwrite=overwrite)
    return corrected
