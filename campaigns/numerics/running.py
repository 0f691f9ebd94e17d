"""The fit while measuring: what is predicted for the next shot, and how far the last one was from it."""

import numpy as np

from campaigns.numerics.frames import Transform, fit_transform
from campaigns.numerics.geometry import IS_ANGLE, Array, Geometry, indices
from campaigns.numerics.par4 import NoAssembly
from campaigns.numerics.residuals import PointResiduals, PositionModel, WithPriors

PRIOR_LENGTH_MM = 5.0
PRIOR_ANGLE_RAD = np.radians(3.0)
"""Broad knowledge about nominal values, so that the first shots already give an answer."""
MEASURING_STD_MM = 0.05
SHOTS_FOR_A_FRAME = 4
SHOTS_FOR_THE_GEOMETRY = 20


class RunningFit:
    """Parameters and the tracker's frame from the shots so far, by one Gauss-Newton step a shot."""

    def __init__(self, nominal: Geometry, free: tuple[str, ...]) -> None:
        self._nominal = nominal
        self._free = indices(free)
        self._prior = np.where(IS_ANGLE[self._free], PRIOR_ANGLE_RAD, PRIOR_LENGTH_MM)
        self._joints: list[Array] = []
        self._points: list[Array] = []
        self._x: Array | None = None
        self._frame: Transform | None = None

    @property
    def shots(self) -> int:
        """How many shots it rests on."""
        return len(self._joints)

    @property
    def knows_the_frame(self) -> bool:
        """Whether a point in the tracker's frame can be predicted at all."""
        return self._frame is not None

    @property
    def knows_the_geometry(self) -> bool:
        """Whether residuals are those of a fitted robot, not of the nominal one."""
        return self.shots >= SHOTS_FOR_THE_GEOMETRY

    def predict_mm(self, joints_rad: Array) -> Array | None:
        """Where the reflector should be in the tracker's frame, (3,); None while that is unknown."""
        if self._frame is None:
            return None
        model = PositionModel(self._nominal, self._free, joints_rad[None])
        try:
            return self._frame.apply(model.positions_mm(self._parameters()))[0]
        except NoAssembly:
            return None

    def distance_fault_mm(self, joints_rad: Array, point_mm: Array) -> float:
        """Largest difference between measured and modelled distances to the shots so far; needs no frame."""
        if not self._joints:
            return 0.0
        model = PositionModel(self._nominal, self._free, np.vstack([*self._joints, joints_rad]))
        positions = model.positions_mm(self._parameters())
        modelled = np.linalg.norm(positions[:-1] - positions[-1], axis=1)
        measured = np.linalg.norm(np.array(self._points) - point_mm, axis=1)
        return float(np.abs(modelled - measured).max())

    def add(self, joints_rad: Array, point_mm: Array) -> None:
        """Take an accepted shot in."""
        self._joints.append(joints_rad)
        self._points.append(point_mm)
        if self.shots >= SHOTS_FOR_A_FRAME:
            self._update()

    def _parameters(self) -> Array:
        return self._nominal.vector()[self._free] if self._x is None else self._x

    def _update(self) -> None:
        """One Gauss-Newton step from the last answer; points on one line leave things as they are."""
        model = PositionModel(self._nominal, self._free, np.array(self._joints))
        points = np.array(self._points)
        try:
            guess = fit_transform(model.positions_mm(self._parameters()), points)
        except ValueError:
            return
        whitening = np.broadcast_to(np.eye(3) / MEASURING_STD_MM, (len(points), 3, 3))
        data = PointResiduals(model, points, whitening, guess)
        problem = WithPriors(data, np.arange(len(self._free)), model.nominal, self._prior)
        x = np.concatenate([self._parameters(), np.zeros(6)])
        step, *_ = np.linalg.lstsq(problem.jacobian(x), -problem.residual(x), rcond=None)
        self._x, self._frame = (x + step)[:-6], data.tracker_from_base(x + step)
