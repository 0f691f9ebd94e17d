"""Shots and pairs that could be taken, each as the rows it would add to a whitened Jacobian."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.information import distance_jacobian, point_jacobian
from campaigns.mechanisms.geometry import Geometry


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """What each of M measurements would tell of P unknowns, of which the first F are parameters."""

    rows: Array
    """∂(whitened measurement)/∂(scaled unknowns), (M, k, P); columns of root mean square 1."""
    scale: Array
    """Scaled unknown over unknown in mm or rad, (P,)."""
    names: tuple[str, ...]
    """Of the parameters, (F,); the unknowns after them are nuisance."""
    mean_information: Array
    """JᵀJ of an average candidate in scaled unknowns, (P, P)."""

    @classmethod
    def from_rows(cls, rows: Array, names: tuple[str, ...]) -> "Candidates":
        """From whitened rows (M, k, P) by unknowns in mm and rad."""
        size = np.sqrt(np.mean(rows**2, axis=(0, 1)))
        scale = np.where(size > 0.0, size, 1.0)
        scaled = rows / scale
        jacobian = scaled.reshape(-1, len(scale))
        return cls(scaled, scale, names, jacobian.T @ jacobian / len(rows))

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def parameters(self) -> int:
        """F."""
        return len(self.names)

    def jacobian(self, chosen: Index) -> Array:
        """Of the chosen ones together, by unknowns in mm and rad, (N k, P)."""
        return np.asarray((self.rows[chosen] * self.scale).reshape(-1, len(self.scale)))

    def information(self, chosen: Index) -> Array:
        """JᵀJ of the chosen ones in scaled unknowns, (P, P)."""
        jacobian = self.rows[chosen].reshape(-1, len(self.scale))
        return np.asarray(jacobian.T @ jacobian)


def shot_candidates(
    geometry: Geometry,
    free: tuple[str, ...],
    joints_rad: Array,
    poses: Array,
    covariance_mm2: Array,
) -> Candidates:
    """Shots with covariances (N, 3, 3) in the base frame's axes; the tracker's frame is unknown."""
    whitening = np.linalg.inv(np.linalg.cholesky(covariance_mm2))
    rows = whitening @ point_jacobian(geometry, free, joints_rad, poses)
    return Candidates.from_rows(rows, free)


def pair_candidates(
    geometry: Geometry,
    free: tuple[str, ...],
    joints_rad: Array,
    poses: Array,
    pairs: Index,
    variance_mm2: Array,
) -> Candidates:
    """Distances between rows of poses, pairs (M, 2) with variances (M,); no frame is involved."""
    rows = distance_jacobian(geometry, free, joints_rad, poses, pairs)
    return Candidates.from_rows((rows / np.sqrt(variance_mm2)[:, None])[:, None, :], free)
