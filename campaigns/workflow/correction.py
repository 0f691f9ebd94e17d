"""Correction of targets with a campaign's parameters, for controllers that take no parameters."""

# The mathematics is in controllers/corrected_targets.py. Here its parts are collected: the set to
# correct with (a file, by default that of `export`, or else the journal's latest identification),
# the covariance for the column of σ, and the shots that fix the frame to which σ refers.

from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.controllers.corrected_targets import CorrectedFile, TargetCorrection, correct_poses
from campaigns.controllers.export import FILE_NAME
from campaigns.controllers.load_checks import file_objections, read_parameter_file
from campaigns.controllers.objections import ObjectionName
from campaigns.errors import ConfigInvalid, TargetsInvalid
from campaigns.files.text_file import read_text, write_text_unless_there
from campaigns.identification.result import WITHOUT_SHOTS, RecordedIdentification
from campaigns.journal.journal import JournalReader
from campaigns.robots.reduced_form import form_of
from campaigns.robots.robot import RobotFile
from campaigns.shots.observation_records import recorded_observations
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.shots.turn_forms import TurnForm
from campaigns.workflow.exporting import identified_robot, issuer_of, recorded
from campaigns.workflow.work import known_sets
from drivers.bounded_files import CSV_BYTES


def _target_correction(campaign: Campaign, robot: RobotFile) -> TargetCorrection:
    """Return the correction from an identified robot to the campaign's nominal one.

    It has a covariance only if the set is an identification in the journal. Raise `ShotsMissing`
    if nothing was measured.
    """
    # A file may hold a form of an identification, or an older one. σ of the latest identification
    # would be those of another set, so without a match by digest none is given.
    identification = known_sets(campaign).identified.get(robot.digest())
    with campaign.journal_reader() as journal:
        joints = _measured_joints(campaign, journal, identification)
    identified, nominal = robot.kinematics.controlled, campaign.robot.kinematics.controlled
    measured = identified.forward(joints)
    poses = measured.values[measured.is_solved]
    return TargetCorrection(
        identified,
        nominal,
        campaign.robot.limits,
        campaign.space,
        None if identification is None else identification.uncertainty.covariance,
        poses,
        () if identification is None else identification.value.layers,
        None if identification is None else identification.uncertainty.position_std_mm,
    )


def _measured_joints(
    campaign: Campaign, journal: JournalReader, identification: RecordedIdentification | None
) -> Array:
    """Return the joints (N, n) at which it was identified: of shots, or else of observations.

    Without an identification of the set they are those of the latest shots. Raise `ShotsMissing` if
    nothing was measured.
    """
    observed = recorded_observations(journal).rows
    if identification is not None:
        series = identification.provenance.series
    elif observed and campaign.series_to_identify(journal) is None:
        series = WITHOUT_SHOTS
    else:
        series = campaign.measured_series(journal).number
    if series == WITHOUT_SHOTS:
        return np.array([joints for row in observed for joints in row.joints])
    shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    return shots.of_set(ShotSet.IDENTIFICATION).joints


def identified_set(campaign: Campaign, path: Path | None = None) -> RobotFile:
    """Return the identified robot of a file; by default the exported one, or else the journal's.

    Raise `ConfigInvalid` for a file that is not of this campaign, `ShotsMissing` without an
    identification, and `VerdictBad` for one that did not pass.
    """
    if path is None and not campaign.path(FILE_NAME).exists():
        return identified_robot(campaign).robot
    # who names a file may mean an earlier set or one of their own: it is corrected without σ then
    allowed = {ObjectionName.CHANGED, ObjectionName.SUPERSEDED} if path is not None else set()
    path = path or campaign.path(FILE_NAME)
    robot = read_parameter_file(path, campaign.robot)
    judged = file_objections(robot, issuer_of(campaign), campaign.robot)
    objections = [objection for objection in judged if objection.name not in allowed]
    if objections:
        problems = "; ".join(each.problem for each in objections)
        raise ConfigInvalid(
            f"{path}: {problems}", remedy="take the file that `pkmcal export DIR --force` writes"
        )
    return robot


def correct_file(
    campaign: Campaign,
    source: Path,
    to: Path,
    identified: Path | None = None,
    *,
    turns: TurnForm | None = None,
    overwrite: bool,
) -> CorrectedFile:
    """Correct the poses of the CSV file `source`, and write wanted and commanded poses to `to`.

    `identified` is the robot file to correct with, as in `identified_set`, `turns` how the file
    writes three turns. Raise `TargetsInvalid` for a wrong row, `OutputExists` or `WriteFailed`,
    and as `identified_set` does.
    """
    text = read_text(source, TargetsInvalid, if_missing="name a CSV file", most_bytes=CSV_BYTES)
    robot = identified_set(campaign, identified)
    form = form_of(robot.provenance, robot.name)
    corrected = correct_poses(text, str(source), _target_correction(campaign, robot), turns)
    with recorded(campaign, to, robot.parameters, "targets", form):
        write_text_unless_there(to, corrected.text, overwrite=overwrite)
    return corrected
