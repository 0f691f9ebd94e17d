"""Scatter of the robot from visit to visit: from the identification, or from repeated visits.

An identification estimates it from all its shots, as scatter of the point and of the joints.
Without one the repeated visits of a validation give it, for all directions alike. Without either it
is unknown: limits are then judged by the instrument alone, and comparisons by the largest scatter
that a robot may have.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.error_sources import by_first_joint
from campaigns.fit.rigid_transforms import away_from_mean
from campaigns.kinematics.model import Kinematics
from campaigns.shots.shots import Shots


@dataclass(frozen=True, slots=True, eq=False)
class RobotScatter:
    """Scatter of the robot's point from visit to visit, 1 σ."""

    source: Literal["identification", "repeated visits", "unknown"] = "unknown"
    point_mm: float = 0.0
    """Of each coordinate."""
    joint: float = 0.0
    """Of the first joint, rad or mm; others scatter in parts of their tolerance as it does."""
    dof: float = math.inf
    """Degrees of freedom of the estimate."""
    kinematics: Kinematics | None = None
    """Robot that turns scatter of joints into scatter of points; None without any of joints."""

    @classmethod
    def identified(
        cls, point_mm: float, joint: float, shots: int, kinematics: Kinematics
    ) -> "RobotScatter":
        """Return the scatter that an identification of so many shots estimated.

        `joint` is that of the first one, in deg or mm as in files.
        """
        # One degree of freedom for each shot: of its three coordinates two are left to the
        # unknowns, more than a fit with priors uses up.
        joint = kinematics.mechanism.joints[0].from_file(joint)
        return cls("identification", point_mm, joint, float(max(shots, 1)), kinematics)

    @classmethod
    def of_visits(cls, visits_mm: Sequence[Array]) -> "RobotScatter":
        """Return the scatter of repeated visits to one or more poses, points (n, 3) of each.

        Poses of one visit show nothing. The instrument's noise is part of it.
        """
        degrees = 3.0 * sum(len(points) - 1 for points in visits_mm)
        if not degrees:
            return cls()
        squares = sum(float(np.sum(away_from_mean(points) ** 2)) for points in visits_mm)
        return cls("repeated visits", math.sqrt(squares / degrees), dof=degrees)

    @property
    def is_known(self) -> bool:
        """Whether the scatter was estimated."""
        return self.source != "unknown"

    @property
    def says(self) -> str:
        """What U contains, in words."""
        if not self.is_known:
            return (
                "U is of the instrument alone: the robot's scatter is unknown; repeated visits or "
                "an identification show it"
            )
        return (
            f"U contains the instrument and the robot's scatter, {self.point_mm:.2g} mm per axis, "
            f"from the {self.source}"
        )

    def covariance_mm2(self, shots: Shots) -> Array:
        """Return the covariance (N, 3, 3) of the points of shots in the base frame."""
        covariance = np.tile(self.point_mm**2 * np.eye(3), (len(shots), 1, 1))
        if self.kinematics is None or self.joint == 0.0 or not len(shots):
            return covariance
        by_joint = self.kinematics.mechanism.point_rows(
            shots.commanded, self.kinematics.joint_jacobian(shots.joints, shots.commanded)
        )
        by_joint = by_first_joint(self.kinematics.mechanism.joints, by_joint)
        return np.asarray(covariance + self.joint**2 * by_joint @ by_joint.swapaxes(1, 2))
