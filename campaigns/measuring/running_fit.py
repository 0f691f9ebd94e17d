"""Running fit: robot and frame by the shots so far, which predict the next one."""

from dataclasses import replace

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.point_sets import distances_mm
from campaigns.fit.posterior import Posterior, Prior, fit
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.kinematics.mechanism import NoSolution

FEWEST_SHOTS = 5
"""Shots that place the frame, with enough to spare to doubt one of them."""
SPREAD_FOR_A_FRAME_MM = 50.0
"""Least extent of the points across their main direction: less places no frame."""
WINDOW = 100
"""Shots of a fit, spread over all: so many predict as well as more, in bounded time."""
GROWTH = 0.1
"""Share by which the shots have grown when they are fitted again."""


def next_size(shots: int, growth: float = GROWTH) -> int:
    """Return the number of shots at which work on all of them is due again; a few: after each."""
    return shots + max(1, int(growth * shots))


FIRM = Prior(factors={"points": 0.04, "joints": 0.04})
"""Scatter at a fifth of its tolerance: the first shots, one of them wrong, cannot tell it."""


class RunningFit:
    """Fit of the accepted shots, repeated whenever they have grown by a share."""

    def __init__(self, model: ErrorModel, instrument: TrackerUncertainty) -> None:
        self._model, self._instrument = model, instrument
        self._joints: list[Array] = []
        self._points: list[Array] = []
        self._posterior: Posterior | None = None
        self._due = FEWEST_SHOTS

    @property
    def shots(self) -> int:
        """Number of shots that it rests on."""
        return len(self._joints)

    def add(self, joints: Array, point_mm: Array) -> None:
        """Add an accepted shot: joints (n,) and its point (3,) in the tracker's frame."""
        self._joints.append(joints)
        self._points.append(point_mm)
        if self.shots >= self._due:
            self._fit()

    def restart(self, joints: Array, points_mm: Array) -> None:
        """Forget all shots, and take others at once: joints (N, n), points (N, 3)."""
        self._joints, self._points = list(joints), list(points_mm)
        self._posterior, self._due = None, FEWEST_SHOTS
        if self.shots >= FEWEST_SHOTS:
            self._fit()

    def predict(self, joints: Array) -> tuple[Array, float] | None:
        """Return the point (3,) expected at joints (n,), and its 1 σ in mm; None if unknown."""
        posterior = self._posterior
        if posterior is None:
            return None
        robot = self._model.kinematics(posterior.x)
        solution = robot.forward(joints[None])
        if not solution.found[0]:
            return None
        frame = posterior.at.frames[0]
        near = frame.apply(solution.values[:, :3])
        observation = self._observations(joints[None], near)
        observation = replace(observation, near=solution.values)
        at = self._model.linearise(observation, posterior.x, (frame,), solution.values)
        covariance = posterior.covariance_without_changes
        spread = at.jacobian[0] @ covariance @ at.jacobian[0].T
        return near[0] + at.residual[0], float(np.sqrt(np.trace(spread)))

    def distance_misfit_mm(self, joints: Array, point_mm: Array) -> float:
        """Return the largest error of a measured distance to an earlier shot.

        Infinite where the joints have no assembly.
        """
        robot = self._model.nominal
        if self._posterior is not None:
            robot = self._model.kinematics(self._posterior.x)
        try:
            positions = robot.forward(np.array([*self._joints, joints])).values_or_raise()[:, :3]
        except NoSolution:
            return np.inf
        points = np.array([*self._points, point_mm])
        first = np.arange(self.shots)
        last = np.full(self.shots, self.shots)
        modelled, measured = (distances_mm(own, first, last) for own in (positions, points))
        return float(np.abs(modelled - measured).max(initial=0.0))

    def _fit(self) -> None:
        """Fit the shots of the window, once their points place a frame."""
        self._due = next_size(self.shots)
        places = np.unique(np.linspace(0, self.shots - 1, WINDOW).astype(int))
        points = np.array(self._points)[places]
        extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[1]
        if extent / np.sqrt(len(points)) < SPREAD_FOR_A_FRAME_MM:
            return
        try:
            observations = self._observations(np.array(self._joints)[places], points)
            self._posterior = fit(self._model, observations, FIRM)
        except (ValueError, np.linalg.LinAlgError):  # no frame yet: distances alone are compared
            return

    def _observations(self, joints: Array, points: Array) -> Observations:
        observations = Observations.unmeasured(joints, self._model.nominal.forward(joints).values)
        noise = {"stated": point_covariance_mm2(points, self._instrument)}
        return replace(observations, points=points, noise=noise)
