"""Residuals of measured shots against the kinematic model, with analytic derivatives.

Every kind of residual has the same three methods (`start`, `residual`, `jacobian`), so that one
solver serves all of them.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.point_sets import directions, distances_mm
from campaigns.estimation.rigid_transforms import Transform, fit_transform, small_rotation
from campaigns.estimation.tracker_noise import inverse_roots
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.configuration import Configuration
from campaigns.mechanisms.mechanism import Kinematics

FRAME_COLUMNS = 6
"""Three small angles and a translation, which stand after the free parameters."""
CLOSE_ENOUGH_MM = 1e-3
"""A Newton step below it is a pose's last: nanometres are left, and nothing at a fit's end, whose
steps are far shorter."""


Assembled: TypeAlias = tuple[Array, Configuration, Array]
"""The parameters x, the robot at every shot with them, and its poses, (N, t)."""


class PositionModel:
    """Positions of the controlled point as functions of the free parameters, at fixed encoders.

    `free` are places in the mechanism's `parameters.of_robot`. `approach` (N, n) says how each
    joint came: +1 from smaller values, -1 from larger ones, 0 for all that nobody knows of.

    Keeps its last answer, which residual and Jacobian share, and its last Jacobian, which predicts
    the next answer so well that the forward model has little left to do.
    """

    def __init__(
        self,
        nominal: Kinematics,
        free: Index,
        joints: Array,
        start: Array | None = None,
        *,
        approach: Array | None = None,
    ) -> None:
        self._mechanism = nominal.mechanism
        self._space = nominal.mechanism.parameters
        self._vector = np.zeros(len(self._space.of_robot))
        self._vector[: len(nominal.p)] = nominal.p
        self.free = free
        self._extensions = self._space.places(self._space.extensions)
        self._is_extended = bool(np.isin(free, self._extensions).any())
        self._has_azimuths = bool(np.isin(free, self._mechanism.azimuths).any())
        self._joints = joints
        self._approach = approach
        self._start = start
        self._last: Assembled | None = None
        self._whole: tuple[Assembled, Array] | None = None
        self._expansion: tuple[Assembled, Array, Array] | None = None
        """Poses to first order: about which, by x (N, t, F), by all of `parameters.geometry`."""

    @property
    def mechanism(self) -> ClosedChain:
        """Mechanism whose model it is."""
        return self._mechanism

    @property
    def nominal(self) -> Array:
        """The free parameters' nominal values, (F,)."""
        return self._vector[self.free]

    @property
    def fine_parameters(self) -> Mask:
        """Free parameters that tilt a plate which is level at the nominal ones, (F,)."""
        level = not self._vector[self._extensions].any()
        return np.asarray(np.isin(self.free, self._extensions) & level)

    def kinematics(self, x: Array) -> Kinematics:
        """Kinematic model with the free parameters replaced."""
        return Kinematics(self._mechanism, self._replaced(x))

    def poses(self, x: Array) -> Array:
        """(N, t), mm and rad; raises `NoSolution`."""
        return self._assembled_at(x)[2]

    def positions_mm(self, x: Array) -> Array:
        """(N, 3); raises `NoSolution`."""
        return self.poses(x)[:, :3]

    def jacobian(self, x: Array) -> Array:
        """∂(X, Y, Z)/∂x, (N, 3, F); raises `NoSolution`."""
        return self._expanded(x)[0][:, :3]

    def by_geometry(self, x: Array, places: Index) -> Array:
        """∂(X, Y, Z)/∂(the geometry's parameters at these places), free or not, (N, 3, K)."""
        _, by_all = self._expanded(x)
        left_out = [] if self._is_extended else [self._extensions]
        left_out += [] if self._has_azimuths else [self._mechanism.azimuths]
        if any(np.isin(places, each).any() for each in left_out):
            by_all = self._with_all(x)
        return by_all[:, :3][:, :, places]

    def _with_all(self, x: Array) -> Array:
        """∂poses/∂(every parameter of the geometry), (N, t, G), also where few ask for it."""
        there = self._assembled_at(x)
        if self._whole is None or self._whole[0] is not there:
            _, configuration, poses = there
            self._whole = there, configuration.jacobian(poses)
        return self._whole[1]

    def by_joints(self, x: Array) -> Array:
        """∂(X, Y, Z)/∂joints, (N, 3, n): an arm turns as by its encoder's offset."""
        return self.by_geometry(x, self._space.offsets)

    def _expanded(self, x: Array) -> tuple[Array, Array]:
        """∂poses/∂x, (N, t, F), and by every parameter of `parameters.geometry`, (N, t, G)."""
        there = self._assembled_at(x)
        if self._expansion is None or self._expansion[0] is not there:
            _, configuration, poses = there
            geometry = configuration.jacobian(
                poses, extended=self._is_extended, azimuths=self._has_azimuths
            )
            by_all = geometry
            if self.free.size and self.free.max() >= by_all.shape[-1]:
                by_offset = by_all[:, :, self._space.offsets]
                own = self._mechanism.transmission.columns(by_offset, self._joint_terms)
                by_all = np.concatenate([by_all, own], axis=-1)
            # shot by shot in memory, as it is read from here on
            by_free = np.ascontiguousarray(by_all[:, :, self.free])
            self._expansion = there, by_free, geometry
        return self._expansion[1:]

    def arm_joints(self, x: Array) -> Array:
        """Joints of the arms: encoder values as the transmission changes them, (N, n)."""
        lost = self._replaced(x)[len(self._space.geometry) :]
        if not lost.any():
            return self._joints
        values = lost.reshape(-1, self._joints.shape[1])
        return np.asarray(self._joints + np.einsum("fn,fkn->kn", values, self._joint_terms))

    @cached_property
    def _joint_terms(self) -> Array:
        """Change of joints by each field of the transmission, (f, N, n)."""
        return self._mechanism.transmission.terms(self._joints, self._approach)

    def _assembled_at(self, x: Array) -> Assembled:
        """The last answer, if it was for this x; raises `NoSolution`."""
        if self._last is None or not np.array_equal(x, self._last[0]):
            geometry = self._replaced(x)[: len(self._space.geometry)]
            configuration = self._mechanism.configuration(geometry, self.arm_joints(x))
            about = None if self._expansion is None else self._expansion[0][1].tilt_elimination
            poses = configuration.assemble(self._near(x), CLOSE_ENOUGH_MM, about).values_or_raise()
            self._last = np.array(x), configuration, poses
        return self._last

    def _near(self, x: Array) -> Array | None:
        """The best that is known of the answer before it is worked out, (N, t)."""
        if self._expansion is not None:
            (about, _, poses), by_x, _ = self._expansion
            return np.asarray(poses + by_x @ (x - about))
        return self._start if self._last is None else self._last[2]

    def _replaced(self, x: Array) -> Array:
        """All parameters in the order of the mechanism's `parameters.of_robot`."""
        vector = self._vector.copy()
        vector[self.free] = x
        return vector


class LastAnswer:
    """Last value of a function of the unknowns, read-only.

    A solver, and whoever judges where it ended, ask for the same residual and Jacobian in turn.
    """

    def __init__(self) -> None:
        self._x: Array | None = None
        self._value = np.empty(0)

    def at(self, x: Array, work: Callable[[Array], Array]) -> Array:
        """Value at the unknowns x, worked out unless it is the last one."""
        if self._x is None or not np.array_equal(x, self._x):
            value = work(x)
            value.flags.writeable = False
            self._x, self._value = np.array(x), value
        return self._value


@dataclass(frozen=True, slots=True, eq=False)
class DistanceResiduals:
    """Whitened nominal minus measured distances of pairs (paper eq. 19); no frame is involved."""

    model: PositionModel
    first: Index
    second: Index
    measured_mm: Array
    whitening: Array
    """Inverse standard deviations of the distances, (M,)."""
    _residual: LastAnswer = field(default_factory=LastAnswer, init=False)
    _jacobian: LastAnswer = field(default_factory=LastAnswer, init=False)

    @classmethod
    def in_mm(
        cls, model: PositionModel, first: Index, second: Index, measured_mm: Array
    ) -> "DistanceResiduals":
        """Residuals in mm: of unit standard deviation."""
        return cls(model, first, second, measured_mm, np.ones(len(measured_mm)))

    @property
    def rows(self) -> int:
        """One a pair."""
        return len(self.measured_mm)

    def start(self) -> Array:
        """The nominal parameters."""
        return self.model.nominal

    def fine_unknowns(self) -> Mask:
        """Parameters that tilt a level plate, (F,)."""
        return self.model.fine_parameters

    def errors_mm(self, x: Array) -> Array:
        """Nominal minus measured distances, (M,)."""
        positions = self.model.positions_mm(x)
        return distances_mm(positions, self.first, self.second) - self.measured_mm

    def residual(self, x: Array) -> Array:
        """One row a pair, (M,)."""
        return self._residual.at(x, lambda at: self.whitening * self.errors_mm(at))

    def jacobian(self, x: Array) -> Array:
        """One row a pair, (M, F)."""
        return self._jacobian.at(x, self._differentiated)

    def _differentiated(self, x: Array) -> Array:
        direction = directions(self.model.positions_mm(x), self.first, self.second)
        jacobian = self.model.jacobian(x)
        apart = jacobian[self.second] - jacobian[self.first]
        by_x = np.einsum("mk,mkf->mf", direction, apart)
        return np.asarray(self.whitening[:, None] * by_x)


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
    sessions: Index | None = None
    """Which session each shot is of, from 0, (N,); None: all of one."""
    motions: tuple[Transform, ...] = ()
    """Guessed motions of the tracker's frame from session 0 to each later one."""
    nuisance: Array | None = None
    """Columns (N, 3, k) of instrument unknowns, which stand behind the robot's parameters."""
    _modelled: LastAnswer = field(default_factory=LastAnswer, init=False)
    _residual: LastAnswer = field(default_factory=LastAnswer, init=False)
    _jacobian: LastAnswer = field(default_factory=LastAnswer, init=False)

    @classmethod
    def from_points(
        cls,
        model: PositionModel,
        points_mm: Array,
        covariance_mm2: Array,
        sessions: Index | None = None,
    ) -> "PointResiduals":
        """With frames guessed from the nominal model, one for each session.

        Raises `NoSolution`, `ValueError` for points that fix no frame and `LinAlgError` for an
        indefinite covariance.
        """
        whitening = inverse_roots(covariance_mm2)
        positions = model.positions_mm(model.nominal)
        if sessions is None:
            return cls(model, points_mm, whitening, fit_transform(positions, points_mm))
        guess = fit_transform(positions[sessions == 0], points_mm[sessions == 0])
        motions = tuple(
            fit_transform(guess.apply(positions[sessions == each]), points_mm[sessions == each])
            for each in range(1, int(sessions.max()) + 1)
        )
        return cls(model, points_mm, whitening, guess, sessions, motions)

    @property
    def rows(self) -> int:
        """Three a shot."""
        return self.points_in_tracker_mm.size

    @property
    def frames(self) -> int:
        """Number of unknowns behind the parameters."""
        return self._nuisances + FRAME_COLUMNS * (1 + len(self.motions))

    @property
    def _nuisances(self) -> int:
        return 0 if self.nuisance is None else self.nuisance.shape[2]

    def start(self) -> Array:
        """Nominal parameters and the guessed frames."""
        return np.concatenate([self.model.nominal, np.zeros(self.frames)])

    def fine_unknowns(self) -> Mask:
        """Parameters that tilt a level plate, (F + 6 for each frame,)."""
        return np.concatenate([self.model.fine_parameters, np.zeros(self.frames, dtype=bool)])

    def parameters(self, x: Array) -> Array:
        """Free parameters of the unknowns x, (F,)."""
        return x[: len(x) - self.frames]

    def tracker_from_base(self, x: Array) -> Transform:
        """The frame that x stands for; of sessions that of the first."""
        turn, _ = small_rotation(x[-6:-3])
        return Transform(self.guess.rotation @ turn, self.guess.translation_mm + x[-3:])

    def session_frames(self, x: Array) -> tuple[Transform, ...]:
        """Frames from base to tracker that x stands for, one a session."""
        first = self.tracker_from_base(x)
        return first, *(motion.after(first) for _, _, motion, _ in self._moved(x))

    def rotations(self, x: Array) -> Array:
        """Rotation from base to tracker at every shot, (N, 3, 3)."""
        found = np.tile(self.tracker_from_base(x).rotation, (len(self.points_in_tracker_mm), 1, 1))
        for rows, _, motion, _ in self._moved(x):
            found[rows] = motion.rotation @ found[rows]
        return found

    def modelled_mm(self, x: Array) -> Array:
        """Points of the model in the tracker's frame, (N, 3)."""
        return self._modelled.at(x, self._in_tracker_mm)

    def _in_tracker_mm(self, x: Array) -> Array:
        modelled = self.tracker_from_base(x).apply(self.model.positions_mm(self.parameters(x)))
        for rows, _, motion, _ in self._moved(x):
            modelled[rows] = motion.apply(modelled[rows])
        if self.nuisance is not None:
            first = len(x) - self.frames
            modelled += self.nuisance @ x[first : first + self._nuisances]
        return modelled

    def with_covariance(self, covariance_mm2: Array) -> "PointResiduals":
        """The same points with other covariances (N, 3, 3); raises `LinAlgError`."""
        return replace(self, whitening=inverse_roots(covariance_mm2))

    def residual(self, x: Array) -> Array:
        """Three rows a shot, (3 N,)."""
        return self._residual.at(x, self._whitened_misfits)

    def _whitened_misfits(self, x: Array) -> Array:
        misfit = self.modelled_mm(x) - self.points_in_tracker_mm
        return np.asarray(np.einsum("nij,nj->ni", self.whitening, misfit)).ravel()

    def jacobian(self, x: Array) -> Array:
        """Three rows a shot, (3 N, F + 6 for each frame)."""
        return self._jacobian.at(x, self._differentiated)

    def _differentiated(self, x: Array) -> Array:
        p, first = self.parameters(x), self.tracker_from_base(x)
        positions, count = self.model.positions_mm(p), len(p)
        _, turn_by_angle = small_rotation(x[-6:-3])
        turned = (self.guess.rotation @ turn_by_angle) @ positions.T
        from_frame = self.whitening
        if self.motions:
            from_frame = from_frame.copy()
            for rows, _, motion, _ in self._moved(x):
                from_frame[rows] = from_frame[rows] @ motion.rotation
        jacobian = np.zeros((len(positions), 3, len(x)))
        jacobian[:, :, :count] = (from_frame @ first.rotation) @ self.model.jacobian(p)
        jacobian[:, :, -6:-3] = from_frame @ turned.transpose(2, 1, 0)
        jacobian[:, :, -3:] = from_frame
        for rows, columns, _, by_angle in self._moved(x):
            before = first.apply(positions[rows])
            by_turn = (by_angle @ before.T).transpose(2, 1, 0)
            whitening = self.whitening[rows]
            jacobian[rows, :, columns : columns + 3] = whitening @ by_turn
            jacobian[rows, :, columns + 3 : columns + 6] = whitening
        if self.nuisance is not None:
            jacobian[:, :, count : count + self._nuisances] = self.whitening @ self.nuisance
        return jacobian.reshape(-1, len(x))

    def _moved(self, x: Array) -> Iterator[tuple[Index, int, Transform, Array]]:
        """Rows of each later session, its columns, its motion, and that by the three angles."""
        if self.sessions is None:
            return
        first = len(x) - self.frames + self._nuisances
        for place, guess in enumerate(self.motions):
            columns = first + FRAME_COLUMNS * place
            turn, by_angle = small_rotation(x[columns : columns + 3])
            shift = x[columns + 3 : columns + FRAME_COLUMNS]
            motion = Transform(guess.rotation @ turn, guess.translation_mm + shift)
            rows = np.flatnonzero(self.sessions == place + 1)
            yield rows, columns, motion, guess.rotation @ by_angle
