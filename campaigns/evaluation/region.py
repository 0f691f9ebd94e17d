"""Region of validity: where σ of positions is at most a few times that at the shots of a result.

Beyond it σ of positions is that of an extrapolation.
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
    """Share of the workspace that is extrapolated, and the extent of the rest, in words too."""

    beyond: float
    ends: dict[str, tuple[float, float]]
    """Lowest and highest value of each axis, by its column in files; empty where nothing is in."""
    says: str

    @classmethod
    def of(cls, poses: Array, std_mm: Array, at_shots_mm: Array, task: Sequence[Axis]) -> "Region":
        """Return the region by poses (N, t), σ of their positions (N,) and of the shots' (M,)."""
        inside = std_mm <= FARTHER_OFF * at_shots_mm.max()
        ends, words = dict[str, tuple[float, float]](), list[str]()
        for axis, values in zip(task, poses[inside].T, strict=True):
            if inside.any():
                low, high = float(values.min()), float(values.max())
                ends[axis.column] = axis.to_file(low), axis.to_file(high)
                words.append(f"{axis.name} {axis.to_file(low):.0f} to {axis.text(high, '.0f')}")
        share = float(np.mean(inside))
        says = f"valid for {100.0 * share:.0f} % of the workspace: {', '.join(words)}"
        return cls(1.0 - share, ends, says)
