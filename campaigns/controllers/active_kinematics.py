"""Active kinematics: poses to joints and back for a controller that cannot do it itself."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from campaigns.arrays import Array
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.mechanism import Kinematics, KinematicSolution
from campaigns.kinematics.transmission import STANDS
from campaigns.robots.robot import pose_of, pose_row
from drivers.errors import LimitViolation
from drivers.values import Pose


class ActiveKinematics:
    """Parameter set at work: by name, mm and deg."""

    def __init__(self, mechanism: ClosedChain, parameters: Mapping[str, float]) -> None:
        self._mechanism = mechanism
        self._kinematics = Kinematics.of(mechanism, parameters)

    def joints(self, pose: Pose, here: Sequence[float] | None = None) -> tuple[float, ...]:
        """Joints of a pose as encoders read them, coming from `here`; raises `LimitViolation`.

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
