"""What the measurements say against the model, as residuals with analytic derivatives.

Every builder answers the same three questions (`start`, `residual`, `jacobian`), so that one solver
serves all of them.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.point_sets import directions, distances_mm
from campaigns.estimation.rigid_transforms import Transform, fit_transform, small_rotation
from campaigns.mechanisms.forward import forward_at
from campaigns.mechanisms.geometry import BACKLASHES, GEOMETRY_NAMES, OFFSETS, Geometry
from campaigns.mechanisms.par4 import Arms, assembled_jacobian

CLOSE_ENOUGH_MM = 1e-3
"""A Newton step below it is a pose's last: nanometres are left, and nothing at a fit's end, whose
steps are far shorter."""
LEFT_BEHIND = -0.5
"""What part of the backlash an arm is from its encoder, in the direction of approach."""


class Residuals(Protocol):
    """A least-squares problem; x is in mm and rad."""

    @property
    def rows(self) -> int:
        """How many residuals there are, M."""
        ...

    def start(self) -> Array:
        """Where to begin, (P,)."""
        ...

    def residual(self, x: Array) -> Array:
        """(M,); raises `NoSolution` where the model has no answer."""
        ...

    def jacobian(self, x: Array) -> Array:
        """(M, P)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class _Assembled:
    """The robot at every shot with the parameters x."""

    x: Array
    arms: Arms
    poses: Array
    """(N, 4)"""


@dataclass(frozen=True, slots=True, eq=False)
class _Expansion:
    """Poses to first order in the parameters."""

    about: _Assembled
    by_x: Array
    """(N, 4, F)"""

    def at(self, x: Array) -> Array:
        return np.asarray(self.about.poses + self.by_x @ (x - self.about.x))


class PositionModel:
    """Positions of the controlled point as functions of the free parameters, at fixed encoders.

    `approach` (N, 4) says how each joint came: +1 from smaller angles, -1 from larger ones, 0 for
    all that nobody knows of. An arm stays behind its encoder by half of its gear's backlash, which
    is nominally 0.

    Keeps its last answer, which residual and Jacobian share, and its last Jacobian, which predicts
    the next answer so well that the forward model has little left to do.
    """

    def __init__(
        self,
        nominal: Geometry,
        free: Index,
        joints_rad: Array,
        start: Array | None = None,
        *,
        approach: Array | None = None,
    ) -> None:
        self._vector = np.concatenate([nominal.vector(), np.zeros(len(BACKLASHES))])
        self._free = free
        self._joints = joints_rad
        self._approach = np.zeros_like(joints_rad) if approach is None else approach
        self._start = start
        self._last: _Assembled | None = None
        self._expansion: _Expansion | None = None

    @property
    def nominal(self) -> Array:
        """The free parameters' nominal values, (F,)."""
        return self._vector[self._free]

    def geometry(self, x: Array) -> Geometry:
        """The whole geometry with the free parameters replaced."""
        return Geometry.from_vector(self._replaced(x)[: len(GEOMETRY_NAMES)])

    def backlash_rad(self, x: Array) -> Array:
        """Each gear's lost motion from one side to the other, (4,)."""
        return self._replaced(x)[BACKLASHES]

    def poses(self, x: Array) -> Array:
        """(N, 4), mm and rad; raises `NoSolution`."""
        return self._assembled_at(x).poses

    def positions_mm(self, x: Array) -> Array:
        """(N, 3); raises `NoSolution`."""
        return self.poses(x)[:, :3]

    def jacobian(self, x: Array) -> Array:
        """∂(X, Y, Z)/∂x, (N, 3, F); raises `NoSolution`."""
        there = self._assembled_at(x)
        if self._expansion is None or self._expansion.about is not there:
            by_all = assembled_jacobian(there.arms, there.poses)
            if self._free.max() >= len(GEOMETRY_NAMES):
                by_backlash = by_all[:, :, OFFSETS] * LEFT_BEHIND * self._approach[:, None]
                by_all = np.concatenate([by_all, by_backlash], axis=-1)
            # shot by shot in memory, as it is read from here on
            by_free = np.ascontiguousarray(by_all[:, :, self._free])
            self._expansion = _Expansion(there, by_free)
        return self._expansion.by_x[:, :3]

    def arm_joints_rad(self, x: Array) -> Array:
        """Where the arms are: encoder angles less what the gears have lost, (N, 4)."""
        return arm_joints_rad(self._joints, self._approach, self.backlash_rad(x))

    def _assembled_at(self, x: Array) -> _Assembled:
        """The last answer, if it was for this x; raises `NoSolution`."""
        if self._last is None or not np.array_equal(x, self._last.x):
            arms = Arms.at(self.geometry(x), self.arm_joints_rad(x))
            poses = forward_at(arms, self._near(x), CLOSE_ENOUGH_MM).require()
            self._last = _Assembled(np.array(x), arms, poses)
        return self._last

    def _near(self, x: Array) -> Array | None:
        """The best that is known of the answer before it is worked out, (N, 4)."""
        if self._expansion is not None:
            return self._expansion.at(x)
        return self._start if self._last is None else self._last.poses

    def _replaced(self, x: Array) -> Array:
        """All parameters of the model in the order of `MODEL_NAMES`, (37,)."""
        vector = self._vector.copy()
        vector[self._free] = x
        return vector


def arm_joints_rad(encoders_rad: Array, approach: Array, backlash_rad: Array) -> Array:
    """Where the arms are when their encoders came by `approach`, each (N, 4); backlash (4,)."""
    return np.asarray(encoders_rad + LEFT_BEHIND * approach * backlash_rad)


@dataclass(frozen=True, slots=True, eq=False)
class DistanceResiduals:
    """Nominal minus measured distances of pairs (paper eq. 19), in mm; no frame is involved."""

    model: PositionModel
    first: Index
    second: Index
    measured_mm: Array

    @property
    def rows(self) -> int:
        """One a pair."""
        return len(self.measured_mm)

    def start(self) -> Array:
        """The nominal parameters."""
        return self.model.nominal

    def residual(self, x: Array) -> Array:
        """One row a pair, (M,)."""
        positions = self.model.positions_mm(x)
        return distances_mm(positions, self.first, self.second) - self.measured_mm

    def jacobian(self, x: Array) -> Array:
        """One row a pair, (M, F)."""
        direction = directions(self.model.positions_mm(x), self.first, self.second)
        jacobian = self.model.jacobian(x)
        apart = jacobian[self.second] - jacobian[self.first]
        return np.asarray(np.einsum("mk,mkf->mf", direction, apart))


@dataclass(frozen=True, slots=True, eq=False)
class PointResiduals:
    """Whitened coordinates of every shot, the tracker's frame being six more unknowns (eqs. 22-25).

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
        """With the frame guessed from the nominal model.

        Raises `NoSolution`, `ValueError` for points that fix no frame and `LinAlgError` for an
        indefinite covariance.
        """
        guess = fit_transform(model.positions_mm(model.nominal), points_mm)
        whitening = np.linalg.inv(np.linalg.cholesky(covariance_mm2))
        return cls(model, points_mm, whitening, guess)

    @property
    def rows(self) -> int:
        """Three a shot."""
        return self.points_in_tracker_mm.size

    def start(self) -> Array:
        """Nominal parameters and the guessed frame."""
        return np.concatenate([self.model.nominal, np.zeros(6)])

    def tracker_from_base(self, x: Array) -> Transform:
        """The frame that x stands for."""
        turn, _ = small_rotation(x[-6:-3])
        return Transform(self.guess.rotation @ turn, self.guess.translation_mm + x[-3:])

    def residual(self, x: Array) -> Array:
        """Three rows a shot, (3 N,)."""
        modelled = self.tracker_from_base(x).apply(self.model.positions_mm(x[:-6]))
        misfit = modelled - self.points_in_tracker_mm
        return np.asarray(np.einsum("nij,nj->ni", self.whitening, misfit).ravel())

    def jacobian(self, x: Array) -> Array:
        """Three rows a shot, (3 N, F + 6)."""
        positions, count = self.model.positions_mm(x[:-6]), len(x) - 6
        turn, turn_by_angle = small_rotation(x[-6:-3])
        turned = (self.guess.rotation @ turn_by_angle) @ positions.T
        whitened_from_base = self.whitening @ (self.guess.rotation @ turn)
        jacobian = np.empty((len(positions), 3, len(x)))
        jacobian[:, :, :count] = whitened_from_base @ self.model.jacobian(x[:-6])
        jacobian[:, :, count:-3] = self.whitening @ turned.transpose(2, 1, 0)
        jacobian[:, :, -3:] = self.whitening
        return jacobian.reshape(-1, len(x))


@dataclass(frozen=True, slots=True, eq=False)
class WithPriors:
    """Residuals with Gaussian knowledge about some of the parameters added as rows."""

    data: Residuals
    places: Index
    """Which parameters are known, (K,)."""
    mean: Array
    std: Array

    @property
    def rows(self) -> int:
        """The data's, and one a prior."""
        return self.data.rows + len(self.places)

    def start(self) -> Array:
        """The data's."""
        return self.data.start()

    def residual(self, x: Array) -> Array:
        """The data's rows, then one a prior, (M + K,)."""
        return np.concatenate([self.data.residual(x), (x[self.places] - self.mean) / self.std])

    def jacobian(self, x: Array) -> Array:
        """The data's rows, then one a prior, (M + K, P)."""
        rows = np.zeros((len(self.places), len(x)))
        rows[np.arange(len(self.places)), self.places] = 1.0 / self.std
        return np.vstack([self.data.jacobian(x), rows])


FRAME_COLUMNS = 6
"""Three small angles and a translation, which stand after the free parameters."""
