"""Region of validity: where σ of positions is at most a few times that at the shots of a result.

A fit is good where the robot was measured and may be wrong far from there. How far is far
depends on the mechanism, not on millimetres: near a singularity a step of 50 mm changes much,
elsewhere little. So the measure is the fit's own σ. A pose of the workspace counts as measured if
its σ is at most three times the largest σ at the shots; the others are extrapolated, and their
share is reported. The region is described by the extent of each coordinate, which is simpler than
its true shape and may hold extrapolated poses in its corners.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.kinematics.axes import Axis

FARTHER_OFF = 3.0
"""Factor on the largest σ at the shots, up to which σ of a position counts as measured."""


@dataclass(frozen=True, slots=True)
class Region:
    """Share of the workspace that is extrapolated, and the extent of the region of validity."""

    beyond: float
    """Share of the workspace's poses outside the region."""
    ends: dict[str, tuple[float, float]]
    """Lowest and highest value of each axis, by its column in files; empty for an empty region."""
    says: str
    """The region in words."""

    @classmethod
    def of(cls, poses: Array, std_mm: Array, at_shots_mm: Array, task: Sequence[Axis]) -> "Region":
        """Return the region of poses (N, t) by σ of their positions (N,) and at the shots (M,)."""
        inside = std_mm <= FARTHER_OFF * at_shots_mm.max()
        ends, words = dict[str, tuple[float, float]](), list[str]()
        for axis, values in zip(task, poses[inside].T, strict=True):
            if inside.any() and not axis.is_fixed:
                low, high = float(values.min()), float(values.max())
                ends[axis.column] = axis.to_file(low), axis.to_file(high)
                words.append(f"{axis.name} {axis.to_file(low):.0f} to {axis.text(high, '.0f')}")
        share = float(np.mean(inside))
        says = f"valid for {100.0 * share:.0f} % of the workspace: {', '.join(words)}"
        return cls(1.0 - share, ends, says)
