"""Candidate measurements: shots and pairs that could be taken, by their whitened Jacobians."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.information import distance_jacobian, point_jacobian, whitened
from campaigns.mechanisms.mechanism import Kinematics


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """Whitened Jacobians of M candidate measurements by P unknowns, the first F the parameters."""

    jacobians: Array
    """∂(whitened measurement)/∂(scaled unknowns), (M, k, P); columns of root mean square 1."""
    scale: Array
    """Scaled unknown over unknown in mm or rad, (P,)."""
    names: tuple[str, ...]
    """Names of the parameters, (F,); the unknowns after them are nuisance."""
    is_length: Mask
    """Which of them are in mm, (F,)."""
    mean_information: Array
    """JᵀJ of an average candidate in scaled unknowns, (P, P)."""

    @classmethod
    def from_jacobians(
        cls, jacobians: Array, names: tuple[str, ...], is_length: Mask
    ) -> "Candidates":
        """Candidates from whitened Jacobians (M, k, P) by unknowns in mm and rad."""
        size = np.sqrt(np.mean(jacobians**2, axis=(0, 1)))
        scale = np.where(size > 0.0, size, 1.0)
        scaled = jacobians / scale
        jacobian = scaled.reshape(-1, len(scale))
        return cls(scaled, scale, names, is_length, jacobian.T @ jacobian / len(jacobians))

    def __len__(self) -> int:
        return len(self.jacobians)

    @property
    def parameters(self) -> int:
        """F."""
        return len(self.names)

    def jacobian(self, chosen: Index) -> Array:
        """Jacobian of the chosen ones together, by unknowns in mm and rad, (N k, P)."""
        return np.asarray((self.jacobians[chosen] * self.scale).reshape(-1, len(self.scale)))

    def information(self, chosen: Index) -> Array:
        """JᵀJ of the chosen ones in scaled unknowns, (P, P)."""
        jacobian = self.jacobians[chosen].reshape(-1, len(self.scale))
        return np.asarray(jacobian.T @ jacobian)


def shot_candidates(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    covariance_mm2: Array,
) -> Candidates:
    """Shots with covariances (N, 3, 3) in the base frame's axes; the tracker's frame is unknown."""
    jacobians = whitened(point_jacobian(kinematics, free, joints, poses), covariance_mm2)
    return Candidates.from_jacobians(jacobians, free, _lengths(kinematics, free))


def pair_candidates(
    kinematics: Kinematics,
    free: tuple[str, ...],
    joints: Array,
    poses: Array,
    pairs: Index,
    variance_mm2: Array,
) -> Candidates:
    """Distances between rows of poses, pairs (M, 2) with variances (M,); no frame is involved."""
    jacobians = distance_jacobian(kinematics, free, joints, poses, pairs)
    in_std = jacobians / np.sqrt(variance_mm2)[:, None]
    return Candidates.from_jacobians(in_std[:, None, :], free, _lengths(kinematics, free))


def _lengths(kinematics: Kinematics, names: tuple[str, ...]) -> Mask:
    space = kinematics.mechanism.parameters
    return ~space.is_angle[space.places(names)]
