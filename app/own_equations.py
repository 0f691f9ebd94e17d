"""Equations of a mechanism of one's own, for the simulated cell, which has no parts of it.

The simulated robot then moves by the same equations as the estimator's: a campaign on it tests
plan, files and σ, and an error in the equations stays hidden.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.kinematics.implicit import ImplicitMechanism
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics


@dataclass(frozen=True, slots=True)
class OwnEquations:
    """A robot's model with poses (6,): x, y, z in mm and a rotation vector in rad."""

    model: Kinematics
    columns: Index
    """Places in (6,) of the model's own task coordinates."""
    is_one_body: bool
    """Whether the platform turns as a whole; parts of an articulated one keep their orientation."""

    @classmethod
    def of(cls, mechanism: Mechanism, values: Mapping[str, float]) -> Self:
        """Make the equations of parameters by name, mm and deg."""
        turns = [5] if len(mechanism.task) == 4 else range(3, len(mechanism.task))
        is_one_body = isinstance(mechanism, ImplicitMechanism)
        return cls(Kinematics.of(mechanism, values), np.array([0, 1, 2, *turns]), is_one_body)

    def pose(self, joints: Array, near: Array) -> Array:
        """Return the pose (6,) of joints (n,), close to another one; NaN without an assembly."""
        pose = np.zeros(6)
        pose[self.columns] = self.model.forward(joints[None], near[None, self.columns]).values[0]
        if not self.is_one_body:
            pose[3:] *= 0.0  # and NaN stays NaN
        return pose

    def joints(self, pose: Array) -> Array:
        """Return the joints (n,) of a pose (6,); NaN out of reach."""
        return np.asarray(self.model.inverse(pose[None, self.columns]).values[0])
