"""Kinematics and parameter file of a controller that a person works by hand."""

# A person types targets and parameters into such a controller, and types back what its display
# shows (drivers/by_hand.py). `HeldParameters` keeps the typed parameters, as nothing reads them
# from the controller: a wrongly typed value is not noticed here. The driver notices it: it compares
# the joints on the display with those that `joints_of_pose` computes by the kept parameters.

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import replace_text
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.robots.robot import RobotDocument, compensated, pose_row, read_robot
from drivers.errors import LimitViolation
from drivers.values import Pose

FILE_NAME = "by-hand-active.yaml"
FILE_BEFORE = "by-hand-active.hal"
"""Name of the file in which earlier versions kept the typed parameters, for LinuxCNC."""


@dataclass(frozen=True, slots=True)
class HeldParameters:
    """Parameters of a controller worked by hand, in a robot file of the campaign's folder."""

    folder: Path
    nominal: RobotDocument

    def read(self) -> Mapping[str, float]:
        """Return the parameters by name, mm and deg; the nominal ones until others are written.

        Raise `ConfigInvalid` for a file that cannot be read, or one of an earlier version.
        """
        path = self.folder / FILE_NAME
        if path.exists():
            return read_robot(path).robot.parameters
        # the nominal set would be wrong here: other parameters were loaded once
        if (self.folder / FILE_BEFORE).exists():
            raise ConfigInvalid(
                f"{self.folder / FILE_BEFORE}: an earlier version kept the typed parameters there",
                remedy=f"copy the robot file that was loaded to {path}, and delete this one",
            )
        return self.nominal.robot.parameters

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace the whole file by these parameters; raise `ConfigInvalid`, `WriteFailed`."""
        robot = compensated(self.nominal, "by-hand-active", geometry)
        replace_text(self.folder / FILE_NAME, robot.document.text)

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:  # noqa: ARG002 - it has them all
        """Return no name: a pose is converted by all parameters."""
        return ()


def joints_of_pose(
    mechanism: Mechanism,
    parameters: Mapping[str, float],
    pose: Pose,
    present: Sequence[float] | None = None,
) -> tuple[float, ...]:
    """Return the joints of a pose as encoders read them, rad or mm.

    `parameters` are by name, in mm and deg, `present` the joints from which the robot goes there.
    Raise `LimitViolation` if the mechanism cannot be assembled at the pose.
    """
    row, model = pose_row(pose), Kinematics.of(mechanism, parameters)
    # no direction of approach is known at a typed pose: assume the middle of the backlash
    solution = model.inverse(row[None])
    if present is not None:
        approach = np.sign(solution.values - np.array(present))
        solution = model.inverse(row[None], np.nan_to_num(approach))
    if not solution.is_solved.all():
        texts = (
            axis.text(value, ".3f")
            for axis, value in zip(mechanism.task, row, strict=True)
            if not axis.is_fixed
        )
        raise LimitViolation(
            f"pose ({', '.join(texts)}): the mechanism cannot be assembled there",
            remedy="compare the plan's robot file with the parameters in use",
        )
    return tuple(solution.values[0].tolist())
