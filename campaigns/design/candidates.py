"""Candidate measurements: shots and pairs that could be taken, by their whitened Jacobians."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask


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
