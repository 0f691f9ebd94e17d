"""Projection of what a campaign identified to controllers with fewer parameters."""

from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.controllers import export, joint_tables, model_reduction
from campaigns.controllers.reduced_parameters import FORMATS, configuration_text, few_parameters
from campaigns.design.pose_sampling import WORKSPACE_SEED, WorkspaceTooSmall, workspace_poses
from campaigns.errors import IdentificationRefused
from campaigns.files.text_file import write_text_unless_there
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.robots.reduced_form import FORM, ReducedForm
from campaigns.robots.robot import RobotDocument, RobotFile, compensated
from campaigns.workflow.files import identified_robot, recorded

WORKSPACE_POSES = 1000
"""So many poses stand for the workspace when parameters are fitted to it."""


@dataclass(frozen=True, slots=True)
class ReducedExport:
    """Written file, and what parameters leave of position over the workspace, fewest last."""

    path: Path
    left: Mapping[str, model_reduction.ResidualError]
    tables: joint_tables.JointTables | None = None
    files: tuple[Path, ...] = ()
    """Of the joint tables."""

    def document(self) -> dict[str, JsonValue]:
        """As `export --json` prints it."""
        left: dict[str, JsonValue] = {
            name: {"mean": each.mean_mm, "max": each.max_mm} for name, each in self.left.items()
        }
        found: dict[str, JsonValue] = {"path": str(self.path), "left_mm": left}
        if self.tables is not None:
            found["joint_tables"] = {
                "files": [str(each) for each in self.files],
                "points": len(self.tables.wanted),
                "left_mm": self.tables.left_mm,
            }
        return found


def export_projected(
    campaign: Campaign, word: str, to: Path | None = None, *, overwrite: bool = False
) -> ReducedExport:
    """Write the nearest parameters of a controller that `FORMATS` names, or the plain ones.

    Raises `ConfigInvalid` for another mechanism, `VerdictBad`, `IdentificationRefused`,
    `OutputExists` or `WriteFailed`.
    """
    if word == export.PLAIN:
        return _export_plain(campaign, to, overwrite=overwrite)
    made, robot = FORMATS[word], identified_robot(campaign).robot
    few, found = few_parameters(robot, campaign.robot, _poses(campaign, robot), made)
    left = found | _full(campaign)
    path = to or campaign.path(made.file_name)
    own = few.found.kinematics.parameters
    with recorded(campaign, path, own, form=_form(robot, word, few.found.error)):
        write_text_unless_there(path, configuration_text(few, left, made), overwrite=overwrite)
    return ReducedExport(path, left)


def _export_plain(campaign: Campaign, to: Path | None, *, overwrite: bool) -> ReducedExport:
    """Write a robot file without extensions."""
    robot, nominal = identified_robot(campaign).robot, campaign.robot
    workspace = model_reduction.Workspace.of(robot.kinematics, _poses(campaign, robot))
    found = model_reduction.project_plain(robot.kinematics, workspace)
    left = {
        "nominal parameters": model_reduction.left_by(nominal.kinematics, workspace),
        "these values": found.error,
        **_full(campaign),
    }
    form, plain = _written_form(campaign, robot, export.PLAIN, found.kinematics, found.error)
    path = to or campaign.path(export.PLAIN_FILE)
    with recorded(campaign, path, plain.robot.parameters, form=form):
        write_text_unless_there(path, plain.document.text, overwrite=overwrite)
    return ReducedExport(path, left)


def export_joint_tables(
    campaign: Campaign,
    word: str,
    to: Path | None = None,
    *,
    tolerance_mm: float = joint_tables.TOLERANCE_MM,
    plain: bool = False,
    overwrite: bool = False,
) -> ReducedExport:
    """Write the joints' transmission as tables of axes, and a robot file of the rest beside them.

    The rest is the whole geometry, or the nearest `plain` one. Raises as `export_projected` does.
    """
    robot = identified_robot(campaign).robot
    files_of, most = joint_tables.FORMATS[word]
    tables = joint_tables.joint_tables(robot.kinematics, robot.limits.joint, tolerance_mm, most)
    poses = _poses(campaign, robot)
    rest = without_transmission(robot.kinematics)
    if plain:
        workspace = model_reduction.Workspace.of(rest, poses)
        rest = model_reduction.project_plain(rest, workspace).kinematics
    left = {
        "nominal parameters": _left(campaign.robot.kinematics, robot, poses),
        "these values without tables": _left(rest, robot, poses),
        "these values and tables": _left(rest, robot, poses, tables),
        **_full(campaign),
    }
    name = export.PLAIN_WITH_TABLES if plain else export.JOINT_TABLES
    form, own = _written_form(campaign, robot, name, rest, left["these values and tables"])
    path = to or campaign.path(export.TABLES_FILE)
    texts = {path.with_name(each): text for each, text in files_of(tables).items()}
    with recorded(campaign, path, own.robot.parameters, form=form, tables=word):
        for file, text in (texts | {path: own.document.text}).items():
            write_text_unless_there(file, text, overwrite=overwrite)
    return ReducedExport(path, left, tables, tuple(texts))


def offered_forms(
    campaign: Campaign, robot: RobotFile, lacking: Collection[str]
) -> dict[str, tuple[str, model_reduction.ResidualError]]:
    """Forms of a set for a controller that lacks some of its parameters, the fullest first.

    By name: the command, and what the form leaves of position. Raises `IdentificationRefused`.
    """
    poses, found = _poses(campaign, robot), dict[str, tuple[str, model_reduction.ResidualError]]()
    written = {
        file: export.CSV for file, _ in export.FORMS.values() if campaign.path(file).exists()
    }
    if campaign.journal_path.exists():
        with campaign.journal_reader() as journal:
            oldest_first = reversed([*export.written_sets(journal)])
        written |= {each.file: each.tables for each in oldest_first if each.file in written}
    for name in export.forms_taken(robot.mechanism.parameters, lacking):
        own, tables = robot.kinematics, None
        if name != export.PLAIN:
            tables = joint_tables.joint_tables(own, robot.limits.joint)
            own = without_transmission(own)
        if name != export.JOINT_TABLES:
            workspace = model_reduction.Workspace.of(own, poses)
            own = model_reduction.project_plain(own, workspace).kinematics
        command = " ".join(
            ("pkmcal export", str(campaign.folder), *export.form_options(name, written))
        )
        found[name] = command, _left(own, robot, poses, tables)
    by_targets = _left(robot.kinematics, robot, poses)
    found["corrected targets"] = f"pkmcal correct {campaign.folder}", by_targets
    return found


def without_transmission(kinematics: Kinematics) -> Kinematics:
    """Model of the same geometry behind perfect gears and encoders."""
    p = kinematics.p.copy()
    p[len(kinematics.mechanism.parameters.geometry) :] = 0.0
    return Kinematics(kinematics.mechanism, p)


def _left(
    controller: Kinematics,
    robot: RobotFile,
    poses: Array,
    tables: joint_tables.JointTables | None = None,
) -> model_reduction.ResidualError:
    """What a controller's kinematics leaves of poses that joints reach from drawn sides."""
    shape = len(poses), len(robot.mechanism.joints)
    sides = np.random.default_rng(WORKSPACE_SEED).choice((-1.0, 1.0), shape)
    told = {} if tables is None else {"readings": tables.readings}
    return model_reduction.left_as_commanded(controller, robot.kinematics, poses, sides, **told)


def _written_form(
    campaign: Campaign,
    robot: RobotFile,
    name: str,
    kinematics: Kinematics,
    lost: model_reduction.ResidualError,
) -> tuple[ReducedForm, RobotDocument]:
    """Form of an identified robot, and its file."""
    form = _form(robot, name, lost)
    document = compensated(
        campaign.nominal,
        f"{campaign.robot.name}-{name.replace(' ', '-')}",
        kinematics.parameters,
        {**(robot.provenance or {}), FORM: asdict(form)},
    )
    return form, document


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
        std = export.latest_identification(journal).position_std_mm
    return (
        {}
        if std is None
        else {"all identified parameters, 1 σ": model_reduction.ResidualError(std.mean, std.max)}
    )
