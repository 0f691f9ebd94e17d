"""Platforms of parallel robots: where the forearms' lower ends are, seen from the controlled point.

They depend on the platform's turn alone: B_i = X + b_i(θ).
"""

from typing import Protocol

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.mechanism import Axis, ParameterField

POSITION = (Axis("x", "prismatic"), Axis("y", "prismatic"), Axis("z", "prismatic"))
TURN = Axis("theta", "revolute")


class Platform(Protocol):
    """Kind of platform: task axes, fields in files, and the forearms' lower ends."""

    @property
    def arms(self) -> int:
        """Number of forearms that hold it."""
        ...

    @property
    def task(self) -> tuple[Axis, ...]:
        """Task axes: x, y, z of the controlled point first."""
        ...

    @property
    def fields(self) -> tuple[ParameterField, ...]:
        """Parameters, in the order of its values."""
        ...

    def joints_mm(self, values: Array, poses: Array) -> Array:
        """B_i in the base frame, (N, n, 3), at poses (N, t)."""
        ...

    def by_turn(self, values: Array, poses: Array, forearms_mm: Array) -> Array:
        """∂F_i of the closures by the turn, (n, N), from forearms (3, n, N)."""
        ...

    def by_fields(self, values: Array, poses: Array, forearms_mm: Array) -> Array:
        """∂F_i by each field, (f, n, N)."""
        ...


class TranslatingPlatform:
    """Delta's platform, which keeps its direction: all forearms end in one contracted point."""

    arms = 3
    task = POSITION
    fields: tuple[ParameterField, ...] = ()

    def joints_mm(self, values: Array, poses: Array) -> Array:  # noqa: ARG002 - it has no fields
        """X for every arm."""
        return np.repeat(poses[..., None, :3], self.arms, axis=-2)

    def by_turn(self, values: Array, poses: Array, forearms_mm: Array) -> Array:
        """Never asked: there is no turn."""
        raise NotImplementedError

    def by_fields(self, values: Array, poses: Array, forearms_mm: Array) -> Array:  # noqa: ARG002
        """Derivatives by no fields: there are none."""
        return np.empty((0, *forearms_mm.shape[1:]))


class HingedPlate:
    """Par4's articulated plate (paper eq. 9): half 1 carries arms 0, 1 and the controlled point.

    Half 2 carries arms 2 and 3, h away in the direction (-sin θ, cos θ, 0).
    """

    arms = 4
    task = (*POSITION, TURN)
    fields: tuple[ParameterField, ...] = (
        ParameterField("plate_mm", "the distance between the halves of the plate, mm", "length"),
    )

    def joints_mm(self, values: Array, poses: Array) -> Array:
        """B'_i in the base frame, (N, 4, 3)."""
        joints = np.repeat(poses[..., None, :3], self.arms, axis=-2)
        joints[..., 2:, 0] -= values[0] * np.sin(poses[..., 3, None])
        joints[..., 2:, 1] += values[0] * np.cos(poses[..., 3, None])
        return joints

    def by_turn(self, values: Array, poses: Array, forearms_mm: Array) -> Array:
        """∂F_i/∂θ, (4, N): nothing for half 1."""
        by_turn = np.zeros(forearms_mm.shape[1:])
        x, y, _ = forearms_mm[:, 2:]
        sin, cos = np.sin(poses[:, 3]), np.cos(poses[:, 3])
        by_turn[2:] = -2.0 * values[0] * (cos * x + sin * y)
        return by_turn

    def by_fields(self, values: Array, poses: Array, forearms_mm: Array) -> Array:  # noqa: ARG002
        """∂F_i/∂h, (1, 4, N)."""
        by_plate = np.zeros((1, *forearms_mm.shape[1:]))
        x, y, _ = forearms_mm[:, 2:]
        by_plate[0, 2:] = 2.0 * (np.cos(poses[:, 3]) * y - np.sin(poses[:, 3]) * x)
        return by_plate
