"""Running fit: parameters and frame by the shots so far, to predict the next one."""

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation.least_squares import LeastSquaresProblem, Priors, solve
from campaigns.estimation.point_sets import SHOTS_FOR_A_FRAME
from campaigns.estimation.residuals import FRAME_COLUMNS, PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import Transform, fit_transform
from campaigns.mechanisms.mechanism import Kinematics, NoSolution

PRIOR_LENGTH_MM = 5.0
PRIOR_ANGLE_RAD = np.radians(3.0)
"""Broad knowledge about nominal values, so that the first shots already give an answer."""
MEASURING_STD_MM = 0.05
SPREAD_FOR_A_FRAME_MM = 50.0
"""Least root mean square extent of the points across their main direction: less fixes no frame."""
GROWTH = 0.02
"""Share by which the shots have grown when they are fitted again."""


def next_size(shots: int, growth: float = GROWTH) -> int:
    """Return the number of shots at which a fit of all is due again; of a few: after each.

    So the cost of the fits for each shot does not grow with the number of shots.
    """
    return shots + max(1, int(growth * shots))


class RunningFit:
    """Parameters and the tracker's frame from the shots so far, fitted when they are asked for."""

    def __init__(self, nominal: Kinematics, free: tuple[str, ...]) -> None:
        space = nominal.mechanism.parameters
        self._nominal, self._free = nominal, space.places(free)
        self._nominal_values = nominal.p[self._free]
        std = np.where(space.is_angle[self._free], PRIOR_ANGLE_RAD, PRIOR_LENGTH_MM)
        self._priors = Priors(np.arange(len(free)), self._nominal_values, std)
        self.restart((), ())

    def predict(self, joints: Array) -> tuple[Array, float] | None:
        """Predict the reflector's place in the tracker's frame (3,), mm, and its σ from joints.

        None while the frame is unknown, and for joints (n,) without an assembly.
        """
        self._fit_if_due()
        if self._known is None:
            return None
        parameters, frame, covariance_root = self._known
        point = PointResiduals(self._model([joints]), np.zeros((1, 3)), np.eye(3)[None], frame)
        x = np.concatenate([parameters, np.zeros(FRAME_COLUMNS)])
        try:
            place, jacobian = point.residual(x), point.jacobian(x)
        except NoSolution:
            return None
        return place, float(np.linalg.norm(jacobian @ covariance_root))

    def max_distance_innovation_mm(self, joints: Array, point_mm: Array) -> float:
        """Largest difference of a measured distance to an earlier shot from the modelled one.

        Infinite where the joints have no assembly.
        """
        self._fit_if_due()
        try:
            positions = self._model([*self._joints, joints]).positions_mm(self._parameters())
        except NoSolution:
            return np.inf
        modelled = np.linalg.norm(positions[:-1] - positions[-1], axis=1)
        measured = np.linalg.norm(np.reshape(self._points, (-1, 3)) - point_mm, axis=1)
        return float(np.abs(modelled - measured).max(initial=0.0))

    def add(self, joints: Array, point_mm: Array) -> None:
        """Take an accepted shot."""
        self._joints.append(joints)
        self._points.append(point_mm)

    def restart(self, joints: Array | tuple[()], points_mm: Array | tuple[()]) -> None:
        """Forget all, and take accepted shots at once: joints (N, n), points (N, 3)."""
        self._joints, self._points = list(joints), list(points_mm)
        self._due = SHOTS_FOR_A_FRAME
        self._known: tuple[Array, Transform, Array] | None = None
        """Parameters (F,), frame, and a root of the covariance of both, (F + 6, F + 6)."""

    def _parameters(self) -> Array:
        return self._nominal_values if self._known is None else self._known[0]

    def _model(self, joints: list[Array]) -> PositionModel:
        return PositionModel(self._nominal, self._free, np.array(joints))

    def _fit_if_due(self) -> None:
        """Fit all shots from the last answer, once they have grown and their points fix a frame."""
        if len(self._joints) < self._due:
            return
        self._due = next_size(len(self._joints))
        model, points = self._model(self._joints), np.array(self._points)
        try:
            positions = model.positions_mm(self._parameters())
            if _spread_mm(positions) < SPREAD_FOR_A_FRAME_MM:
                return
            whitening = np.broadcast_to(np.eye(3) / MEASURING_STD_MM, (len(points), 3, 3))
            data = PointResiduals(model, points, whitening, fit_transform(positions, points))
            start = np.concatenate([self._parameters(), np.zeros(FRAME_COLUMNS)])
            fit = solve(LeastSquaresProblem(data, 3, self._priors), start=start)
        except NoSolution:
            return
        root = np.linalg.inv(np.linalg.qr(fit.jacobian, mode="r"))
        self._known = fit.x[:-FRAME_COLUMNS], data.tracker_from_base(fit.x), root


def _spread_mm(points: Array) -> float:
    """Root mean square extent in the second of the three main directions."""
    extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return float(extents[1] / np.sqrt(len(points)))
