"""What is fitted: measurements in blocks, which may be weighed, and priors, which never are.

A block is what belongs together: the three whitened coordinates of a shot, or one distance.
"""

from dataclasses import dataclass, replace

import numpy as np

from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.residuals import Residuals, WithPriors


@dataclass(frozen=True, slots=True, eq=False)
class Priors:
    """Gaussian knowledge about some of the unknowns, in mm and rad."""

    places: Index
    """Which unknowns, (K,)."""
    mean: Array
    std: Array

    @classmethod
    def none(cls) -> "Priors":
        """Nothing is known beforehand."""
        return cls(np.empty(0, dtype=np.intp), np.empty(0), np.empty(0))

    def __len__(self) -> int:
        return len(self.places)

    def jacobian(self, unknowns: int) -> Array:
        """∂(whitened prior residual)/∂x, (K, P)."""
        rows = np.zeros((len(self), unknowns))
        rows[np.arange(len(self)), self.places] = 1.0 / self.std
        return rows


@dataclass(frozen=True, slots=True, eq=False)
class Weighted:
    """A least-squares problem with a weight on every block."""

    data: Residuals
    block: int
    weights: Array
    """(blocks,), at least zero."""

    @property
    def rows(self) -> int:
        """The data's."""
        return self.data.rows

    def start(self) -> Array:
        """The data's."""
        return self.data.start()

    def residual(self, x: Array) -> Array:
        """(M,)."""
        return self._root() * self.data.residual(x)

    def jacobian(self, x: Array) -> Array:
        """(M, P)."""
        return self._root()[:, None] * self.data.jacobian(x)

    def _root(self) -> Array:
        return np.repeat(np.sqrt(self.weights), self.block)


@dataclass(frozen=True, slots=True, eq=False)
class Subspace:
    """Where a fit may go: x = origin + directions @ y."""

    origin: Array
    """(P,)"""
    directions: Array
    """(P, R)"""

    def x(self, y: Array) -> Array:
        """The unknowns (P,) of a place (R,) in it."""
        return np.asarray(self.origin + self.directions @ y)


@dataclass(frozen=True, slots=True, eq=False)
class Within:
    """A problem whose unknowns are the places in a subspace."""

    whole: Residuals
    subspace: Subspace

    @property
    def rows(self) -> int:
        """The whole problem's."""
        return self.whole.rows

    def start(self) -> Array:
        """The origin, (R,)."""
        return np.zeros(self.subspace.directions.shape[1])

    def residual(self, y: Array) -> Array:
        """The whole problem's, (M,)."""
        return self.whole.residual(self.subspace.x(y))

    def jacobian(self, y: Array) -> Array:
        """(M, R)."""
        return np.asarray(self.whole.jacobian(self.subspace.x(y)) @ self.subspace.directions)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """Whitened measurements in blocks of equal size, and what is known without them."""

    data: Residuals
    block: int
    priors: Priors
    unit: float = 1.0
    """Standard deviation of the whitened residuals against which the priors weigh."""
    subspace: Subspace | None = None
    """None: every unknown is free."""

    @property
    def blocks(self) -> int:
        """How many there are."""
        return self.data.rows // self.block

    def weighted(self, weights: Array) -> Residuals:
        """What a solver takes; `weights` (blocks,) are of the measurements alone."""
        data = Weighted(self.data, self.block, weights / self.unit**2)
        priors = self.priors
        known = WithPriors(data, priors.places, priors.mean, priors.std) if len(priors) else data
        return known if self.subspace is None else Within(known, self.subspace)

    def x(self, solved: Array) -> Array:
        """The unknowns (P,) of what a solver found."""
        return solved if self.subspace is None else self.subspace.x(solved)

    def sizes(self, solved: Array) -> Array:
        """Length of each block's whitened residual where a solver is, (blocks,)."""
        return block_sizes(self.data.residual(self.x(solved)), self.block)

    def against(self, unit: float) -> "Problem":
        """The same with priors weighed against residuals of another standard deviation."""
        return replace(self, unit=unit)

    def inside(self, subspace: Subspace | None) -> "Problem":
        """The same, free to move in a subspace only."""
        return replace(self, subspace=subspace)


def block_sizes(residual: Array, block: int) -> Array:
    """Length of each block's residual, (blocks,)."""
    return np.asarray(np.linalg.norm(residual.reshape(-1, block), axis=1))
