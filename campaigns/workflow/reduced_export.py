"""Projection of what a campaign identified to controllers that know fewer parameters."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.controllers import export, model_reduction
from campaigns.design.pose_sampling import WORKSPACE_SEED, WorkspaceTooSmall, workspace_poses
from campaigns.errors import IdentificationRefused
from campaigns.files.text_file import write_text_unless_there
from campaigns.kinematics.mechanism import Kinematics
from campaigns.robots.reduced_form import FORM, ReducedForm
from campaigns.robots.robot import RobotFile, compensated
from campaigns.workflow.files import identified_robot, recorded

WORKSPACE_POSES = 1000
"""So many poses stand for the workspace when parameters are fitted to it."""


@dataclass(frozen=True, slots=True)
class ReducedExport:
    """Written file, and what parameters leave of position over the workspace, fewest last."""

    path: Path
    left: Mapping[str, model_reduction.ResidualError]

    def document(self) -> dict[str, JsonValue]:
        """As `export --json` prints it."""
        left: dict[str, JsonValue] = {
            name: {"mean": each.mean_mm, "max": each.max_mm} for name, each in self.left.items()
        }
        return {"path": str(self.path), "left_mm": left}


def export_plain(
    campaign: Campaign, to: Path | None = None, *, overwrite: bool = False
) -> ReducedExport:
    """Write the nearest parameters of those that every controller knows as a robot file.

    Raises `VerdictBad`, `IdentificationRefused`, `OutputExists` or `WriteFailed`.
    """
    robot = identified_robot(campaign).robot
    poses = _poses(campaign, robot)
    plain = _plain(robot, poses)
    lost = _left(plain, robot, poses)
    left = {
        "nominal parameters": _left(campaign.robot.kinematics, robot, poses),
        "these values": lost,
        **_full(campaign),
    }
    form = ReducedForm(robot.digest(), lost.mean_mm, lost.max_mm, lost.rms_mm, export.PLAIN)
    document = compensated(
        campaign.nominal,
        f"{campaign.robot.name}-{export.PLAIN}",
        plain.parameters,
        {**(robot.provenance or {}), FORM: asdict(form)},
    )
    path = to or campaign.path(export.PLAIN_FILE)
    with recorded(campaign, path, document.robot.parameters, form=form):
        write_text_unless_there(path, document.document.text, overwrite=overwrite)
    return ReducedExport(path, left)


def left_by_forms(campaign: Campaign, robot: RobotFile) -> dict[str, model_reduction.ResidualError]:
    """What each form of a set leaves of position for a controller that lacks some parameters.

    Raises `IdentificationRefused`.
    """
    poses = _poses(campaign, robot)
    return {
        export.PLAIN: _left(_plain(robot, poses), robot, poses),
        "corrected targets": _left(robot.kinematics, robot, poses),
    }


def _plain(robot: RobotFile, poses: Array) -> Kinematics:
    workspace = model_reduction.Workspace.of(robot.kinematics, poses)
    return model_reduction.project_plain(robot.kinematics, workspace).kinematics


def _left(controller: Kinematics, robot: RobotFile, poses: Array) -> model_reduction.ResidualError:
    """What a controller's kinematics leaves of poses that joints reach from drawn sides."""
    shape = len(poses), len(robot.mechanism.joints)
    sides = np.random.default_rng(WORKSPACE_SEED).choice((-1.0, 1.0), shape)
    return model_reduction.left_as_commanded(controller, robot.kinematics, poses, sides)


def _poses(campaign: Campaign, robot: RobotFile) -> Array:
    """Poses (N, t) all over the workspace."""
    rng = np.random.default_rng(WORKSPACE_SEED)
    try:
        return workspace_poses(
            robot.kinematics, robot.limits, campaign.centre, WORKSPACE_POSES, rng, campaign.space
        )
    except WorkspaceTooSmall as error:
        raise IdentificationRefused(
            f"the identified robot can take hardly any pose: {error}",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        ) from error


def _full(campaign: Campaign) -> dict[str, model_reduction.ResidualError]:
    """What all identified parameters leave: their own uncertainty."""
    with campaign.journal_reader() as journal:
        std = export.latest_identification(journal).position_std_mm
    return (
        {}
        if std is None
        else {"all identified parameters, 1 σ": model_reduction.ResidualError(std.mean, std.max)}
    )
