"""Advice to a mechanic from a campaign's latest identification."""

from dataclasses import replace

from campaigns.campaign import Campaign
from campaigns.controllers.export import latest_identification
from campaigns.estimation.information import Uncertainty
from campaigns.evaluation.mechanical_advice import Dimensions, MechanicalAdvice, mechanical_advice
from campaigns.identification.result import IdentificationResult, RecordedIdentification
from campaigns.robots.robot import RobotFile

OTHER_ROBOT = (
    "the identification rests on another nominal robot than robot.yaml holds now: bring the robot "
    "file back, or identify again"
)


def advise(campaign: Campaign) -> MechanicalAdvice:
    """Advice by the campaign's latest identification; raises `ShotsMissing` without one."""
    with campaign.journal_reader() as journal:
        return advice_by(campaign, latest_identification(journal))


def advice_by(campaign: Campaign, found: RecordedIdentification) -> MechanicalAdvice:
    """What a mechanic may do by an identification, and what to leave alone.

    Where nothing may be read as a dimension, the advice says why.
    """
    robot, poses = campaign.robot, campaign.workspace_sample()
    if found.robot_digest != robot.digest():
        return MechanicalAdvice(refused=OTHER_ROBOT)
    dimensions = dimensions_of(robot, found)
    refused = dimensions.refusal(found.verdict, found.doubts)
    if refused or poses is None:
        return MechanicalAdvice(refused=refused or "hardly any pose of the workspace can be taken")
    return mechanical_advice(dimensions, poses)


def dimensions_of(robot: RobotFile, found: IdentificationResult) -> Dimensions:
    """Changes of the robot's own parameters that were looked for, and how well they are known."""
    known, own = found.covariance or Uncertainty(), robot.parameters.space.of_robot
    known = known.only(name for name in known.names if name in own)
    changes = {name: found.parameters[name].delta for name in known.names}
    if found.ripples is not None:
        robot = replace(robot, mechanism=robot.mechanism.with_ripples(found.ripples.value))
    return Dimensions(robot, changes, known, found.coverage_factor_95 or 0.0, found.hidden)
