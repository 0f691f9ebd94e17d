"""Corrected targets: what to command a controller that keeps its nominal parameters.

With the identified model K and the controller's own K0 a wanted pose x has the joints
q = inverse(K, x); commanded x' = forward(K0, q) makes the controller set these very joints
(model.md, family).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from campaigns.arrays import Array
from campaigns.design.restricted_space import ROUNDING_MM, UNRESTRICTED, RestrictedSpace
from campaigns.errors import TargetsInvalid
from campaigns.identification.positions import std_of_positions
from campaigns.identification.result import ParameterCovariance
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.mechanism import Kinematics, KinematicSolution
from campaigns.kinematics.transmission import approach_along


@dataclass(frozen=True, slots=True, eq=False)
class TargetCorrection:
    """Correction of targets from an identified model to the controller's."""

    identified: Kinematics
    nominal: Kinematics
    limits: Limits
    space: RestrictedSpace = UNRESTRICTED
    uncertainty: ParameterCovariance | None = None
    """Of the identified parameters; None: nobody knows it."""
    measured: Array | None = None
    """Poses (M, t) of the shots, whose best fit is the frame."""

    def approach(self, wanted: Array) -> Array:
        """Sign of each joint's last motion at poses (N, t) reached one after another, (N, n).

        0 until a joint moves. Joints turn round at poses only.
        """
        return approach_along(self.identified.inverse(wanted).values)

    def commanded(self, wanted: Array, approach: Array | None = None) -> KinematicSolution:
        """Poses (N, t) to command for wanted ones, which joints reach by `approach` (N, n)."""
        joints = self.identified.inverse(wanted, approach)
        found = joints.found.copy()
        values = np.full_like(wanted, np.nan)
        poses = self.nominal.forward(joints.values[found], wanted[found])
        values[found] = poses.values
        found[found] = poses.found
        return KinematicSolution.where(found, values)

    def first_fault(self, wanted: Array) -> tuple[int, str] | None:
        """Row of the first of the poses (N, t) that cannot be taken, and why; None: there is none.

        The real robot's limits count, at the joints that it will have.
        """
        judged = self.identified.feasibility(self.limits, wanted)
        fine = judged.feasible & self.commanded(wanted).found
        fine &= (self.space.clearance_mm(wanted[:, :3]) >= -ROUNDING_MM).all(axis=1)
        if fine.all():
            return None
        row = int(np.argmin(fine))
        return row, self._reason(judged.describe(row), wanted[row])

    def require_possible(self, wanted: Array, place: Callable[[int], str]) -> None:
        """Raise `TargetsInvalid` for the first of the poses (N, t) that cannot be taken.

        `place` says where a row stands.
        """
        if fault := self.first_fault(wanted):
            row, reason = fault
            raise TargetsInvalid(f"{place(row)}: {reason}", remedy="change the pose")

    def _reason(self, violations: list[str], pose: Array) -> str:
        if violations:
            return violations[0]
        if fault := self.space.fault(pose[:3]):
            return fault
        return "the controller's own kinematics cannot be assembled there"

    def std_mm(self, wanted: Array) -> Array:
        """1 σ of the position at wanted poses (N, t), (N,); NaN where it is not known."""
        if self.uncertainty is None or self.measured is None:
            return np.full(len(wanted), np.nan)
        return std_of_positions(self.identified, self.uncertainty, wanted, self.measured)


@dataclass(frozen=True, slots=True)
class CorrectedFile:
    """Text of a corrected file, and what it took."""

    text: str
    targets: int
    correction_mm: tuple[float, float]
    """Mean and largest correction of a position."""
    std_mm: float | None
    """Largest 1 σ of a position among them; None: it is not known."""

    @classmethod
    def of(cls, text: str, size_mm: Array, std_mm: Array) -> Self:
        """From sizes (N,) of corrections, and σ at their poses, NaN where not known."""
        sizes = float(size_mm.mean()), float(size_mm.max())
        known = not np.isnan(std_mm).any()
        return cls(text, len(size_mm), sizes, float(std_mm.max()) if known else None)


def correction_mm(wanted: Array, commanded: Array) -> Array:
    """Distances (N,) of commanded positions from wanted ones."""
    return np.asarray(np.linalg.norm(commanded[:, :3] - wanted[:, :3], axis=1))
