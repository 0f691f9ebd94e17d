"""Poses to joints and back with a parameter set: for a controller that cannot do it itself."""

from collections.abc import Mapping, Sequence

import numpy as np

from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import Geometry
from campaigns.mechanisms.par4 import KinematicSolution, inverse
from drivers.errors import LimitViolation
from drivers.values import Pose


class ActiveKinematics:
    """A parameter set at work: flat names, mm and deg."""

    def __init__(self, geometry: Mapping[str, float]) -> None:
        self._geometry = Geometry.from_flat(geometry)

    def joints_rad(self, pose: Pose) -> tuple[float, ...]:
        """Encoder angles of a pose; raises `LimitViolation`."""
        row = np.array([[pose.x_mm, pose.y_mm, pose.z_mm, pose.theta_rad]])
        where = f"({pose.x_mm:.3f}, {pose.y_mm:.3f}, {pose.z_mm:.3f}) mm"
        theta_deg = float(np.degrees(pose.theta_rad))
        return _only(inverse(self._geometry, row), f"pose {where}, theta {theta_deg:.3f}°")

    def pose(self, joints_rad: Sequence[float]) -> Pose:
        """Pose of encoder angles; raises `LimitViolation`."""
        listed = ", ".join(f"{angle:.4f}" for angle in np.degrees(joints_rad))
        found = forward(self._geometry, np.array([joints_rad], dtype=np.float64))
        return Pose(*_only(found, f"joints {listed} deg"))


def _only(solution: KinematicSolution, what: str) -> tuple[float, ...]:
    if not solution.found.all():
        raise LimitViolation(
            f"{what}: the mechanism cannot be assembled there",
            remedy="compare the plan's robot file with the parameters in use",
        )
    return tuple(solution.values[0].tolist())
