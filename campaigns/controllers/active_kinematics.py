"""What a controller worked by hand cannot do itself: convert poses, and state its parameters."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import replace_text
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.mechanism import Kinematics, KinematicSolution
from campaigns.kinematics.transmission import STANDS
from campaigns.robots.robot import RobotDocument, compensated, pose_of, pose_row, read_robot
from drivers.errors import LimitViolation
from drivers.values import Pose

FILE_NAME = "by-hand-active.yaml"
FILE_BEFORE = "by-hand-active.hal"
"""Name under which earlier versions kept them, for LinuxCNC."""


@dataclass(frozen=True, slots=True)
class HeldParameters:
    """Parameters of a controller worked by hand, in a robot file of the campaign's folder."""

    folder: Path
    nominal: RobotDocument

    def read(self) -> Mapping[str, float]:
        """Return parameters by name; nominal until others were written. Raise `ConfigInvalid`."""
        path = self.folder / FILE_NAME
        if path.exists():
            return read_robot(path).robot.parameters
        if (self.folder / FILE_BEFORE).exists():
            raise ConfigInvalid(
                f"{self.folder / FILE_BEFORE}: an earlier version kept the typed parameters there",
                remedy=f"copy the robot file that was loaded to {path}, and delete this one",
            )
        return self.nominal.robot.parameters

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace the file whole; raise `ConfigInvalid`, `WriteFailed`."""
        held = compensated(self.nominal, "by-hand-active", geometry)
        replace_text(self.folder / FILE_NAME, held.document.text)

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:  # noqa: ARG002 - it has them all
        """Return no name: poses are converted by all parameters."""
        return ()


class ActiveKinematics:
    """Parameter set at work: by name, mm and deg."""

    def __init__(self, mechanism: ClosedChain, parameters: Mapping[str, float]) -> None:
        self._mechanism = mechanism
        self._kinematics = Kinematics.of(mechanism, parameters)

    def joints(self, pose: Pose, here: Sequence[float] | None = None) -> tuple[float, ...]:
        """Return the joints of a pose as encoders read them, from `here`; raise `LimitViolation`.

        Of the readings of both sides it is the one beyond; between them the nearer one.
        """
        row = pose_row(pose)
        name = f"pose {_listed(self._mechanism.task, row)}"
        if here is None:
            return tuple(_only(self._kinematics.inverse(row[None]), name).tolist())
        falling, rising = (
            _only(self._kinematics.inverse(row[None], np.full((1, len(here)), side)), name)
            for side in (-1.0, 1.0)
        )
        now = np.array(here)
        comes_up = now < falling - STANDS
        stays_up = (now > 0.5 * (falling + rising)) & (now <= rising + STANDS)
        return tuple(np.where(comes_up | stays_up, rising, falling).tolist())

    def pose(self, joints: Sequence[float]) -> Pose:
        """Return the pose of joints; raise `LimitViolation`."""
        solution = self._kinematics.forward(np.array([joints], dtype=np.float64))
        return pose_of(_only(solution, f"joints {_listed(self._mechanism.joints, joints)}"))


def _listed(axes: Sequence[Axis], values: Iterable[float]) -> str:
    texts = (axis.text(value, ".3f") for axis, value in zip(axes, values, strict=True))
    return f"({', '.join(texts)})"


def _only(solution: KinematicSolution, what: str) -> Array:
    if not solution.is_solved.all():
        raise LimitViolation(
            f"{what}: the mechanism cannot be assembled there",
            remedy="compare the plan's robot file with the parameters in use",
        )
    return np.asarray(solution.values[0])
