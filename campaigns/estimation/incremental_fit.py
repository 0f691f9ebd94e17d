"""Incremental Gauss-Newton: parameters and frame while measuring, to predict the next shot."""

from dataclasses import replace

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation.least_squares import LeastSquaresProblem, Priors
from campaigns.estimation.point_sets import SHOTS_FOR_A_FRAME
from campaigns.estimation.residuals import FRAME_COLUMNS, PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import Transform, fit_transform
from campaigns.estimation.variance_components import LinearizedShots
from campaigns.mechanisms.mechanism import Kinematics, NoSolution

PRIOR_LENGTH_MM = 5.0
PRIOR_ANGLE_RAD = np.radians(3.0)
"""Broad knowledge about nominal values, so that the first shots already give an answer."""
MEASURING_STD_MM = 0.05
SPREAD_FOR_A_FRAME_MM = 50.0
"""Least root mean square extent of the points across their main direction: less fixes no frame."""
STEP_GROWTH = 0.02
"""Share by which the shots have grown when a step over all of them is worth making anew."""
ONE_BY_ONE = 50
"""First shots of many, from whose answer a few steps over all of them do."""
STEPS_OVER_MANY = 2


def next_size(shots: int, growth: float = STEP_GROWTH) -> int:
    """Number of shots at which what takes all of them is due again; a few: after each.

    So its share of each shot's cost does not grow with their number.
    """
    return shots + max(1, int(growth * shots))


class IncrementalGaussNewton:
    """Parameters and the tracker's frame from the shots so far, by Gauss-Newton steps.

    One after each shot; of many shots, one whenever they have grown by a share.
    """

    def __init__(self, nominal: Kinematics, free: tuple[str, ...]) -> None:
        space = nominal.mechanism.parameters
        self._nominal = nominal
        self._names = free
        self._free = space.places(free)
        self._nominal_values = nominal.p[self._free]
        std = np.where(space.is_angle[self._free], PRIOR_ANGLE_RAD, PRIOR_LENGTH_MM)
        self._priors = Priors(np.arange(len(free)), self._nominal_values, std)
        self._joints: list[Array] = []
        self._points: list[Array] = []
        self._poses: Array | None = None
        self._near_newer: list[Array] = []
        """Poses (t,) near those of shots since the last step: what was predicted, or the last."""
        self._due = SHOTS_FOR_A_FRAME
        self._foreseen: tuple[Array, Array] | None = None
        self._known: tuple[Array, Transform, Array] | None = None
        """Parameters (F,), frame, and a root of the covariance of both, (F + 6, F + 6)."""
        self._linearized: LinearizedShots | None = None
        self._from_nominal = np.zeros(len(free))

    def linearized(self, free: tuple[str, ...]) -> LinearizedShots | None:
        """The first shots about the last answer but one, in the tracker's frame; None before it.

        The unknowns are some of the parameters, the others being held at their nominal values, and
        the frame. Nothing of the priors is in it. Shots after one without an assembly are missing.
        """
        if self._linearized is None or free == self._names:
            return self._linearized
        shots, count = self._linearized, len(self._names)
        kept = [self._names.index(name) for name in free]
        held = [place for place in range(count) if place not in kept]
        back_mm = shots.jacobian[:, :, held] @ self._from_nominal[held]
        jacobian = shots.jacobian[:, :, [*kept, *range(count, count + FRAME_COLUMNS)]]
        return replace(shots, residual_mm=shots.residual_mm - back_mm, jacobian=jacobian)

    @property
    def shots(self) -> int:
        """Number of shots it rests on."""
        return len(self._joints)

    def predict(self, joints: Array) -> tuple[Array, float] | None:
        """The reflector's place at joints (n,) in the tracker's frame, (3,), and its σ, mm.

        None while the frame is unknown.
        """
        if self._known is None:
            return None
        parameters, frame, covariance_root = self._known
        model = self._model([joints])
        point = PointResiduals(model, np.zeros((1, 3)), np.eye(3)[None], frame)
        x = np.concatenate([parameters, np.zeros(6)])
        try:
            place, jacobian = point.residual(x), point.jacobian(x)
        except NoSolution:
            return None
        self._foreseen = joints, model.poses(parameters)[0]
        return place, float(np.linalg.norm(jacobian @ covariance_root))

    def max_distance_innovation_mm(self, joints: Array, point_mm: Array) -> float:
        """Largest difference of a measured distance to an earlier shot from the modelled one.

        Infinite where the joints have no assembly.
        """
        try:
            positions = self._model([*self._joints, joints]).positions_mm(self._parameters())
        except NoSolution:
            return np.inf
        modelled = np.linalg.norm(positions[:-1] - positions[-1], axis=1)
        measured = np.linalg.norm(np.reshape(self._points, (-1, 3)) - point_mm, axis=1)
        return float(np.abs(modelled - measured).max(initial=0.0))

    def add(self, joints: Array, point_mm: Array) -> None:
        """Update with an accepted shot."""
        self._joints.append(joints)
        self._points.append(point_mm)
        if self._poses is not None:
            self._near_newer.append(self._near_one(joints))
        if self.shots >= self._due:
            self._update()

    def restart(self, joints: Array, points_mm: Array) -> None:
        """Forget all, and take accepted shots at once: joints (N, n), points (N, 3)."""
        self._joints, self._points, self._poses, self._near_newer = [], [], None, []
        self._known, self._linearized, self._due = None, None, SHOTS_FOR_A_FRAME
        for each, point_mm in zip(joints[:ONE_BY_ONE], points_mm, strict=False):
            self.add(each, point_mm)
        if len(joints) > ONE_BY_ONE:
            self._joints, self._points, self._poses = list(joints), list(points_mm), None
            for _ in range(STEPS_OVER_MANY):
                self._update()

    def _parameters(self) -> Array:
        return self._nominal_values if self._known is None else self._known[0]

    def _model(self, joints: list[Array], near: Array | None = None) -> PositionModel:
        return PositionModel(self._nominal, self._free, np.array(joints), near)

    def _near(self) -> Array | None:
        """Poses near those of the shots: where they were last; of newer ones what was predicted."""
        return None if self._poses is None else np.vstack([self._poses, *self._near_newer])

    def _near_one(self, joints: Array) -> Array:
        assert self._poses is not None, "there is a fit"
        if self._foreseen is not None and np.array_equal(joints, self._foreseen[0]):
            return self._foreseen[1]
        return np.asarray(self._poses[-1])

    def _update(self) -> None:
        """One Gauss-Newton step from the last answer, once the points fix a frame."""
        self._due = next_size(self.shots)
        model, points = self._model(self._joints, self._near()), np.array(self._points)
        try:
            self._poses, self._near_newer = model.poses(self._parameters()), []
        except NoSolution:
            return
        positions = self._poses[:, :3]
        if _spread_mm(positions) < SPREAD_FOR_A_FRAME_MM:
            return
        whitening = np.broadcast_to(np.eye(3) / MEASURING_STD_MM, (len(points), 3, 3))
        data = PointResiduals(model, points, whitening, fit_transform(positions, points))
        problem = LeastSquaresProblem(data, 3, self._priors)
        x = np.concatenate([self._parameters(), np.zeros(6)])
        # the residual as a last column comes out multiplied by Qᵀ, so that Q itself is not needed
        rows = np.column_stack([problem.jacobian(x), problem.residual(x)])
        self._linearized = _linearized(rows[: 3 * len(points)])
        self._from_nominal = x[:-6] - self._nominal_values
        triangle = np.asarray(np.linalg.qr(rows, mode="r"))
        root = np.linalg.inv(triangle[:-1, :-1])
        x = x - root @ triangle[:-1, -1]
        self._known = x[:-6], data.tracker_from_base(x), root


def _linearized(whitened: Array) -> LinearizedShots:
    """From rows with the residual as their last column, (3 N, F + 7)."""
    rows = MEASURING_STD_MM * whitened.reshape(-1, 3, whitened.shape[-1])
    stated = np.broadcast_to(MEASURING_STD_MM**2 * np.eye(3), (len(rows), 3, 3))
    return LinearizedShots(rows[:, :, -1], rows[:, :, :-1], stated, np.empty((len(rows), 3, 0)))


def _spread_mm(points: Array) -> float:
    """Root mean square extent in the second of the three main directions."""
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(extents[1] / np.sqrt(len(points)))
