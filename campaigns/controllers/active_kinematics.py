"""Kinematics and parameter file of a controller that a person works by hand."""

# Theory of operation
#
# A controller that speaks no protocol of ours is worked by hand: the program prints a target or a
# table of parameters, a person types it into the controller, and types back what the display shows
# (drivers/by_hand.py). Two things that a connected controller answers itself come from here:
#
# - Which parameters it holds. `HeldParameters` keeps them in a robot file in the campaign's folder.
#   The file is replaced once the person has confirmed that all values are typed. Nothing reads
#   the real controller, so a value that was typed wrongly is not noticed here.
# - Which joints belong to a commanded pose. The controller moves to the pose by its own kinematics;
#   `joints_of_pose` computes by the kept parameters where that must lead. The driver compares
#   these joints with the display, and so notices parameters that were not typed as recorded.

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import replace_text
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.mechanism import Kinematics
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
        document = compensated(self.nominal, "by-hand-active", geometry)
        replace_text(self.folder / FILE_NAME, document.document.text)

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:  # noqa: ARG002 - it has them all
        """Return no name: a pose is converted by all parameters."""
        return ()


def joints_of_pose(
    mechanism: ClosedChain, parameters: Mapping[str, float], pose: Pose
) -> tuple[float, ...]:
    """Return the joints of a pose as encoders read them, rad or mm.

    `parameters` are by name, in mm and deg. Raise `LimitViolation` if the mechanism cannot be
    assembled at the pose.
    """
    row = pose_row(pose)
    # without a direction of approach: no one types the way by which each joint arrives, so the
    # reading is that of the middle of the backlash
    solution = Kinematics.of(mechanism, parameters).inverse(row[None])
    if not solution.is_solved.all():
        texts = (axis.text(value, ".3f") for axis, value in zip(mechanism.task, row, strict=True))
        raise LimitViolation(
            f"pose ({', '.join(texts)}): the mechanism cannot be assembled there",
            remedy="compare the plan's robot file with the parameters in use",
        )
    return tuple(solution.values[0].tolist())
