"""Projection of what a campaign identified to controllers with fewer parameters."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.controllers import model_reduction
from campaigns.controllers.export import PLAIN_FILE, latest_identification
from campaigns.controllers.reduced_parameters import FORMATS, configuration_text, few_parameters
from campaigns.design.pose_sampling import WORKSPACE_SEED, WorkspaceTooSmall, workspace_poses
from campaigns.errors import IdentificationRefused
from campaigns.files.text_file import write_text_unless_there
from campaigns.mechanisms.parameters import Parameters
from campaigns.robots.reduced_form import FORM, ReducedForm
from campaigns.robots.robot import RobotFile, compensated
from campaigns.workflow.files import identified_robot, recorded

PLAIN = "plain"
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


def export_projected(
    campaign: Campaign, word: str, to: Path | None = None, *, overwrite: bool = False
) -> ReducedExport:
    """Write the nearest parameters of a controller that `FORMATS` names, or the plain ones.

    Raises `ConfigInvalid` for another mechanism, `VerdictBad`, `IdentificationRefused`,
    `OutputExists` or `WriteFailed`.
    """
    if word == PLAIN:
        return _export_plain(campaign, to, overwrite=overwrite)
    made, robot = FORMATS[word], identified_robot(campaign).robot
    few, found = few_parameters(robot, campaign.robot, _poses(campaign, robot), made)
    left = found | _full(campaign)
    path = to or campaign.path(made.file_name)
    own = Parameters.of_vector(robot.mechanism.parameters, few.found.kinematics.p)
    with recorded(campaign, path, own, form=_form(robot, word, few.found.error)):
        write_text_unless_there(path, configuration_text(few, left, made), overwrite=overwrite)
    return ReducedExport(path, left)


def _export_plain(campaign: Campaign, to: Path | None, *, overwrite: bool) -> ReducedExport:
    """Write a robot file without extensions."""
    document = identified_robot(campaign)
    robot, nominal = document.robot, campaign.robot
    workspace = model_reduction.Workspace.of(robot.kinematics, _poses(campaign, robot))
    found = model_reduction.project(
        robot.mechanism, model_reduction.NamedParameters.plain(robot.kinematics), workspace
    )
    left = {
        "nominal parameters": model_reduction.left_by(nominal.kinematics, workspace),
        "these values": found.error,
        **_full(campaign),
    }
    form = _form(robot, PLAIN, found.error)
    plain = compensated(
        campaign.nominal,
        f"{nominal.name}-plain",
        found.kinematics.parameters,
        {**(robot.provenance or {}), FORM: asdict(form)},
    )
    path = to or campaign.path(PLAIN_FILE)
    with recorded(campaign, path, plain.robot.parameters, form=form):
        write_text_unless_there(path, plain.document.text, overwrite=overwrite)
    return ReducedExport(path, left)


def _form(robot: RobotFile, name: str, lost: model_reduction.ResidualError) -> ReducedForm:
    return ReducedForm(robot.digest(), lost.mean_mm, lost.max_mm, lost.rms_mm, name)


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
        std = latest_identification(journal).position_std_mm
    return (
        {}
        if std is None
        else {"all identified parameters, 1 σ": model_reduction.ResidualError(std.mean, std.max)}
    )
