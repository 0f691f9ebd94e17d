"""Active kinematics: poses to joints and back for a controller that cannot do it itself."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.mechanism import Axis, Kinematics, KinematicSolution
from campaigns.robots.robot import pose_of, pose_row
from drivers.errors import LimitViolation
from drivers.values import Pose


class ActiveKinematics:
    """Parameter set at work: by name, mm and deg."""

    def __init__(self, mechanism: ClosedChain, parameters: Mapping[str, float]) -> None:
        self._mechanism = mechanism
        self._kinematics = Kinematics.of(mechanism, parameters)

    def joints(self, pose: Pose) -> tuple[float, ...]:
        """Joints of a pose; raises `LimitViolation`."""
        row = pose_row(pose)
        found = self._kinematics.inverse(row[None])
        return tuple(_only(found, f"pose {_listed(self._mechanism.task, row)}").tolist())

    def pose(self, joints: Sequence[float]) -> Pose:
        """Pose of joints; raises `LimitViolation`."""
        found = self._kinematics.forward(np.array([joints], dtype=np.float64))
        return pose_of(_only(found, f"joints {_listed(self._mechanism.joints, joints)}"))


def _listed(axes: Sequence[Axis], values: Iterable[float]) -> str:
    texts = (axis.text(value, ".3f") for axis, value in zip(axes, values, strict=True))
    return f"({', '.join(texts)})"


def _only(solution: KinematicSolution, what: str) -> Array:
    if not solution.found.all():
        raise LimitViolation(
            f"{what}: the mechanism cannot be assembled there",
            remedy="compare the plan's robot file with the parameters in use",
        )
    return np.asarray(solution.values[0])
