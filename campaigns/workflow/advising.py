"""Advice to a mechanic from a campaign's latest identification."""

from campaigns.campaign import Campaign
from campaigns.controllers.export import latest_identification
from campaigns.errors import VerdictBad
from campaigns.estimation.information import Uncertainty
from campaigns.evaluation.mechanical_advice import Dimensions, MechanicalAdvice, mechanical_advice
from campaigns.identification.result import IdentificationResult
from campaigns.robots.robot import RobotFile


def advise(campaign: Campaign) -> MechanicalAdvice:
    """What a mechanic may do about it, and what to leave alone.

    Raises `ShotsMissing` without an identification, and `VerdictBad` for one of another nominal
    robot. Where nothing may be read as a dimension, the advice says why.
    """
    with campaign.journal_reader() as journal:
        found = latest_identification(journal)
    robot, poses = campaign.robot, campaign.workspace_sample()
    if found.robot_digest != robot.digest():
        raise VerdictBad(
            "the identification rests on another nominal robot than robot.yaml holds now",
            remedy="bring the robot file back, or identify again",
        )
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
    return Dimensions(robot, changes, known, found.coverage_factor_95 or 0.0, found.hidden)
