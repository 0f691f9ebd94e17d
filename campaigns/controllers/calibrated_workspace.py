"""Calibrated workspace: where the shots of an identification were, and a margin about them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from campaigns.arrays import Array, Mask
from campaigns.errors import ShotsMissing
from campaigns.mechanisms.mechanism import Axis, Interval

MARGIN_MM = 25.0
TURN_MARGIN_DEG = 3.0
"""A parameter set is as good a little beyond its shots as among them, and less so further away."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedWorkspace:
    """Convex hull of measured positions, and the range of each turn, both widened by a margin."""

    planes: Array
    """Outward unit normals and offsets of the hull's faces, (F, 4): n·x + d <= 0 inside."""
    turns: tuple[tuple[int, Axis, Interval], ...]
    """Columns of poses that are turns, and the range measured of each, rad."""
    margin_mm: float = MARGIN_MM
    turn_margin_rad: float = float(np.radians(TURN_MARGIN_DEG))

    @classmethod
    def of(
        cls,
        poses: Array,
        task: Sequence[Axis],
        margin_mm: float = MARGIN_MM,
        turn_margin_deg: float = TURN_MARGIN_DEG,
    ) -> Self:
        """Workspace of measured poses (N, t); raises `ShotsMissing` when they span no volume."""
        try:
            hull = scipy.spatial.ConvexHull(poses[:, :3])
        except (scipy.spatial.QhullError, ValueError) as error:
            raise ShotsMissing(
                f"the positions of {len(poses)} identification shots span no volume",
                remedy="measure shots all over the workspace, and identify again",
            ) from error
        turns = tuple(
            (column, axis, (float(poses[:, column].min()), float(poses[:, column].max())))
            for column, axis in enumerate(task)
            if axis.is_revolute
        )
        turn_margin_rad = float(np.radians(turn_margin_deg))
        return cls(np.unique(hull.equations, axis=0), turns, margin_mm, turn_margin_rad)

    def beyond_mm(self, poses: Array) -> Array:
        """Distance (N,) from the hull's faces, negative inside; a lower bound beyond its edges."""
        reach = poses[:, :3] @ self.planes[:, :-1].T + self.planes[:, -1]
        return np.asarray(reach.max(axis=1))

    def beyond_turns_rad(self, poses: Array) -> Array:
        """How far each turn is outside of the range measured, negative inside, (N, turns)."""
        columns = [
            np.maximum(low - poses[:, column], poses[:, column] - high)
            for column, _, (low, high) in self.turns
        ]
        return np.stack(columns, axis=1) if columns else np.empty((len(poses), 0))

    def holds(self, poses: Array) -> Mask:
        """Mask (N,) of the poses in it."""
        turned = (self.beyond_turns_rad(poses) <= self.turn_margin_rad).all(axis=1)
        return np.asarray((self.beyond_mm(poses) <= self.margin_mm) & turned)

    def fault(self, pose: Array) -> str:
        """What puts a pose (t,) outside, with value and limit; empty: nothing."""
        beyond_mm = float(self.beyond_mm(pose[None])[0])
        if beyond_mm > self.margin_mm:
            return (
                f"{beyond_mm:.1f} mm outside of the calibrated workspace "
                f"(limit {self.margin_mm:g} mm)"
            )
        beyond = self.beyond_turns_rad(pose[None])[0]
        for (column, axis, measured), by_rad in zip(self.turns, beyond.tolist(), strict=True):
            if by_rad > self.turn_margin_rad:
                low, high = (axis.text(end, ".4g") for end in measured)
                return (
                    f"{axis.name} {axis.text(float(pose[column]), '.3f')} is "
                    f"{axis.text(by_rad, '.2f')} outside of what was calibrated, "
                    f"[{low}, {high}] (limit {axis.text(self.turn_margin_rad, 'g')})"
                )
        return ""
