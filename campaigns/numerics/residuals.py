"""What the measurements say against the model, as residuals with analytic derivatives.

Every builder answers the same three questions (`start`, `residual`, `jacobian`), so that one solver
serves all of them.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from campaigns.numerics.forward import forward
from campaigns.numerics.frames import Transform, fit_transform, small_rotation
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.par4 import NoAssembly, parameter_jacobian

Index = NDArray[np.intp]


class Residuals(Protocol):
    """A least-squares problem; x is in mm and rad."""

    def start(self) -> Array:
        """Where to begin, (P,)."""
        ...

    def residual(self, x: Array) -> Array:
        """(M,); raises `NoAssembly` where the model has no answer."""
        ...

    def jacobian(self, x: Array) -> Array:
        """(M, P)."""
        ...


class PositionModel:
    """Positions of the controlled point as functions of the free parameters, at fixed joints.

    Keeps the last solution: it is the next one's start, and residual and Jacobian share it.
    """

    def __init__(
        self, nominal: Geometry, free: Index, joints_rad: Array, start: Array | None = None
    ) -> None:
        self._vector = nominal.vector()
        self._free = free
        self._joints = joints_rad
        self._poses = start
        self._at: Array | None = None

    @property
    def nominal(self) -> Array:
        """The free parameters' nominal values, (F,)."""
        return self._vector[self._free]

    def geometry(self, x: Array) -> Geometry:
        """The whole parameter set with the free ones replaced."""
        vector = self._vector.copy()
        vector[self._free] = x
        return Geometry.from_vector(vector)

    def positions_mm(self, x: Array) -> Array:
        """(N, 3); raises `NoAssembly`."""
        return self._solved(x)[:, :3]

    def jacobian(self, x: Array) -> Array:
        """∂(X, Y, Z)/∂x, (N, 3, F)."""
        poses = self._solved(x)
        return parameter_jacobian(self.geometry(x), self._joints, poses)[:, :3, self._free]

    def _solved(self, x: Array) -> Array:
        if self._poses is None or self._at is None or not np.array_equal(x, self._at):
            self._poses = forward(self.geometry(x), self._joints, self._poses).require()
            self._at = np.array(x)
        return self._poses


@dataclass(frozen=True, slots=True, eq=False)
class DistanceResiduals:
    """Nominal minus measured distances of pairs (paper eq. 19), in mm; no frame is involved."""

    model: PositionModel
    first: Index
    second: Index
    measured_mm: Array

    def start(self) -> Array:
        """The nominal parameters."""
        return self.model.nominal

    def residual(self, x: Array) -> Array:
        """(pairs,)"""
        positions = self.model.positions_mm(x)
        return np.asarray(
            np.linalg.norm(positions[self.second] - positions[self.first], axis=1)
            - self.measured_mm
        )

    def jacobian(self, x: Array) -> Array:
        """(pairs, F)"""
        positions = self.model.positions_mm(x)
        between = positions[self.second] - positions[self.first]
        direction = between / np.linalg.norm(between, axis=1, keepdims=True)
        jacobian = self.model.jacobian(x)
        return np.asarray(
            np.einsum("mk,mkf->mf", direction, jacobian[self.second] - jacobian[self.first])
        )


@dataclass(frozen=True, slots=True, eq=False)
class PointResiduals:
    """Whitened coordinates of every shot, with the tracker's frame as six more unknowns (paper eqs. 22-25).

    x holds the free parameters, then three small angles and a translation that correct `guess`.
    """

    model: PositionModel
    points_in_tracker_mm: Array
    whitening: Array
    """W with W C Wᵀ = 1 for each shot's covariance C, (N, 3, 3)."""
    guess: Transform

    @classmethod
    def from_points(
        cls, model: PositionModel, points_mm: Array, covariance_mm2: Array
    ) -> "PointResiduals":
        """With the frame guessed from the nominal model; raises `LinAlgError` for an indefinite covariance."""
        guess = fit_transform(model.positions_mm(model.nominal), points_mm)
        whitening = np.linalg.inv(np.linalg.cholesky(covariance_mm2))
        return cls(model, points_mm, whitening, guess)

    def start(self) -> Array:
        """Nominal parameters and the guessed frame."""
        return np.concatenate([self.model.nominal, np.zeros(6)])

    def tracker_from_base(self, x: Array) -> Transform:
        """The frame that x stands for."""
        turn, _ = small_rotation(x[-6:-3])
        return Transform(self.guess.rotation @ turn, self.guess.translation_mm + x[-3:])

    def residual(self, x: Array) -> Array:
        """(3 N,)"""
        misfit = (
            self.tracker_from_base(x).apply(self.model.positions_mm(x[:-6]))
            - self.points_in_tracker_mm
        )
        return np.asarray(np.einsum("nij,nj->ni", self.whitening, misfit).ravel())

    def jacobian(self, x: Array) -> Array:
        """(3 N, F + 6)"""
        positions, count = self.model.positions_mm(x[:-6]), len(x) - 6
        turn, turn_by_angle = small_rotation(x[-6:-3])
        jacobian = np.empty((len(positions), 3, len(x)))
        jacobian[:, :, :count] = (self.guess.rotation @ turn) @ self.model.jacobian(x[:-6])
        jacobian[:, :, count:-3] = np.einsum(
            "ij,ajk,nk->nia", self.guess.rotation, turn_by_angle, positions
        )
        jacobian[:, :, -3:] = np.eye(3)
        return np.asarray((self.whitening @ jacobian).reshape(-1, len(x)))


@dataclass(frozen=True, slots=True, eq=False)
class WithPriors:
    """Residuals with Gaussian knowledge about the first parameters' nominal values added as rows."""

    data: Residuals
    places: Index
    mean: Array
    std: Array

    def start(self) -> Array:
        """The data's."""
        return self.data.start()

    def residual(self, x: Array) -> Array:
        """(M + priors,)"""
        return np.concatenate([self.data.residual(x), (x[self.places] - self.mean) / self.std])

    def jacobian(self, x: Array) -> Array:
        """(M + priors, P)"""
        rows = np.zeros((len(self.places), len(x)))
        rows[np.arange(len(self.places)), self.places] = 1.0 / self.std
        return np.vstack([self.data.jacobian(x), rows])


__all__ = [
    "DistanceResiduals",
    "NoAssembly",
    "PointResiduals",
    "PositionModel",
    "Residuals",
    "WithPriors",
]
