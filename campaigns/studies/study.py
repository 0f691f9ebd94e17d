"""What goes into a study: shots, robots, noise; and what comes out of each of its campaigns."""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.estimate import chi_square_test, variance_scale
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import points_covariance, predict_distances
from campaigns.estimation.least_squares import Solution, solve
from campaigns.estimation.observability import covariance, observability, unobservable_combinations
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residuals import (
    DistanceResiduals,
    PointResiduals,
    PositionModel,
    Residuals,
)
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.robust import Loss
from campaigns.estimation.tracker_noise import (
    TrackerUncertainty,
    distance_variance_mm2,
    point_covariance_mm2,
)
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import FILE_UNIT, Geometry, indices
from campaigns.mechanisms.par4 import NoSolution
from campaigns.version import VERSION


@dataclass(frozen=True, slots=True, eq=False)
class PairedShots:
    """Joints (N, 4) of a plan's shots, and which rows are pairs, (M, 2)."""

    joints_rad: Array
    pairs: Index


@dataclass(frozen=True, slots=True, eq=False)
class StudySetup:
    """What all campaigns of a study share."""

    nominal: Geometry
    free: tuple[str, ...]
    estimator: Estimator
    fitted: PairedShots
    unseen: PairedShots
    tracker_from_base: Transform
    uncertainty: TrackerUncertainty
    seed: int

    @property
    def dof(self) -> int:
        """Numbers measured less numbers sought; of points three a shot, and a frame's six more."""
        if self.estimator is Estimator.POINTS:
            return 3 * len(self.fitted.joints_rad) - len(self.free) - 6
        return len(self.fitted.pairs) - len(self.free)

    def digest(self, truth: str) -> str:
        """Twelve characters that differ between studies; `truth` says how robots are drawn."""
        parts = [self.nominal.vector(), self.tracker_from_base.rotation]
        parts += [self.tracker_from_base.translation_mm]
        for shots in (self.fitted, self.unseen):
            parts += [shots.joints_rad, shots.pairs.astype(np.float64)]
        settings = (truth, self.free, self.estimator.value, self.uncertainty, self.seed)
        text = repr((*settings, VERSION))  # another version may find other numbers
        hashed = hashlib.sha256(text.encode("utf-8"))
        for part in parts:
            hashed.update(np.ascontiguousarray(part).tobytes())
        return hashed.hexdigest()[:12]


@dataclass(frozen=True, slots=True, eq=False)
class StudyTask:
    """Some campaigns of a study, and the true parameters of each as rows, mm and rad."""

    setup: StudySetup
    numbers: tuple[int, ...]
    truths: Array


@dataclass(frozen=True, slots=True, eq=False)
class CampaignEstimate:
    """What one campaign found of the free parameters, in file units (mm, deg): it is to be read."""

    errors: Array
    """Identified minus true, (F,)."""
    std: Array
    """As the estimator states it, (F,)."""
    bound: Array
    """The least standard deviation that its data allow (Cramér and Rao), at the truth, (F,)."""
    unseen_mean_mm: float
    """Of the errors of distances never fitted, against the true robot; NaN without such pairs."""
    unseen_max_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class CampaignOutcome:
    """An estimate, or why there is none."""

    number: int
    estimate: CampaignEstimate | None
    failure: str


@dataclass(frozen=True, slots=True, eq=False)
class _NominalPoses:
    """Where the forward models begin to search, (N, 4) each."""

    fitted: Array
    unseen: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Robot:
    """A true robot: its shots as they are, how they scatter, and how well they can tell of it."""

    vector: Array
    """Its parameters, mm and rad."""
    points_mm: Array
    """Of the fitted shots, in the tracker's frame, (N, 3)."""
    scatter_mm: Array
    """Square root of each point's covariance, (N, 3, 3)."""
    bound: Array
    """Least standard deviations (Cramér and Rao), (F,), mm and rad."""
    unseen: Array
    """Poses of the unseen shots, (K, 4)."""


def run_task(task: StudyTask) -> tuple[CampaignOutcome, ...]:
    """Simulate and identify; a campaign that cannot be identified is an outcome too."""
    near = _nominal_poses(task.setup)
    robot_of = cache(partial(_robot, task.setup, near))  # a scenario without tolerances has one
    return tuple(
        _outcome(task.setup, near, number, partial(robot_of, tuple(truth)))
        for number, truth in zip(task.numbers, task.truths.tolist(), strict=True)
    )


def indistinguishable(setup: StudySetup) -> list[tuple[str, ...]]:
    """Free parameters that move together without any effect on what the nominal robot's shots tell.

    Raises `NoSolution` when the nominal robot cannot take them.
    """
    near = _nominal_poses(setup)
    exact_mm = setup.tracker_from_base.apply(near.fitted[:, :3])
    problem = _problem(setup, near, exact_mm)
    seen = observability(problem.jacobian(problem.start()))
    return unobservable_combinations(seen, setup.free)


def stated_std(estimator: Estimator, fit: Solution) -> Array:
    """Standard deviations as identification states them of the same shots, (P,), mm and rad.

    From the tracker's stated noise for points, as long as χ² believes it; else from the scatter.
    """
    seen = chi_square_test(float(fit.residual @ fit.residual), len(fit.residual) - len(fit.x), None)
    trusted = estimator is Estimator.POINTS
    scale = variance_scale(seen.ratio, seen, Loss(), trusted=trusted)
    assert scale is not None, "a set-up leaves degrees of freedom"
    return np.asarray(scale * np.sqrt(np.diag(covariance(fit.jacobian))))


def _nominal_poses(setup: StudySetup) -> _NominalPoses:
    return _NominalPoses(
        *(
            forward(setup.nominal, shots.joints_rad).require()
            for shots in (setup.fitted, setup.unseen)
        )
    )


def _robot(setup: StudySetup, near: _NominalPoses, values: tuple[float, ...]) -> _Robot:
    """Raises `NoSolution`, and `LinAlgError` when its shots do not fix the parameters."""
    vector = np.array(values)
    true = Geometry.from_vector(vector)
    poses = forward(true, setup.fitted.joints_rad, near.fitted).require()
    points_mm = setup.tracker_from_base.apply(poses[:, :3])
    covariance_mm2 = point_covariance_mm2(points_mm, setup.uncertainty)
    scatter_mm = np.asarray(np.linalg.cholesky(covariance_mm2), dtype=np.float64)
    unseen = forward(true, setup.unseen.joints_rad, near.unseen).require()
    return _Robot(vector, points_mm, scatter_mm, _bound(setup, true, poses, points_mm), unseen)


def _bound(setup: StudySetup, true: Geometry, poses: Array, points_mm: Array) -> Array:
    """Cramér-Rao bound of standard deviations, (F,), mm and rad.

    Of what the estimator is given, at the truth: Fisher's information of the coordinates, or of
    the distances.
    """
    joints_rad, pairs = setup.fitted.joints_rad, setup.fitted.pairs
    in_base_axes_mm = points_mm @ setup.tracker_from_base.rotation
    noise_mm2 = point_covariance_mm2(in_base_axes_mm, setup.uncertainty)
    if setup.estimator is Estimator.POINTS:
        least = points_covariance(true, setup.free, joints_rad, poses, noise_mm2)
        return np.asarray(np.sqrt(np.diag(least)[: len(setup.free)]))
    variance_mm2 = distance_variance_mm2(in_base_axes_mm, noise_mm2, *pairs.T)
    return predict_distances(true, setup.free, joints_rad, poses, pairs, variance_mm2).std


def _outcome(
    setup: StudySetup, near: _NominalPoses, number: int, robot: Callable[[], _Robot]
) -> CampaignOutcome:
    rng = np.random.default_rng([setup.seed, number])
    try:
        true = robot()
        fit = solve(_problem(setup, near, _measured(true, rng)))
        if not fit.converged:
            return CampaignOutcome(number, None, fit.message)
        return CampaignOutcome(number, _estimate(setup, true, fit), "")
    except (NoSolution, np.linalg.LinAlgError) as error:
        return CampaignOutcome(number, None, str(error))


def _measured(true: _Robot, rng: np.random.Generator) -> Array:
    """Points with noise in the tracker's frame, (N, 3)."""
    draws = rng.standard_normal(true.points_mm.shape)
    return np.asarray(true.points_mm + np.einsum("nij,nj->ni", true.scatter_mm, draws))


def _problem(setup: StudySetup, near: _NominalPoses, points_mm: Array) -> Residuals:
    """What identification solves, from the nominal robot on."""
    free = indices(setup.free)
    model = PositionModel(setup.nominal, free, setup.fitted.joints_rad, near.fitted)
    if setup.estimator is Estimator.POINTS:
        stated = point_covariance_mm2(points_mm, setup.uncertainty)
        return PointResiduals.from_points(model, points_mm, stated)
    first, second = setup.fitted.pairs.T
    return DistanceResiduals(model, first, second, distances_mm(points_mm, first, second))


def _estimate(setup: StudySetup, true: _Robot, fit: Solution) -> CampaignEstimate:
    free = indices(setup.free)
    identified = setup.nominal.vector()
    identified[free] = fit.x[: len(free)]
    errors = (identified - true.vector)[free]
    std = stated_std(setup.estimator, fit)[: len(free)]
    unseen_mm = _unseen_errors_mm(setup.unseen, true, Geometry.from_vector(identified))
    mean, most = (float("nan"),) * 2
    if unseen_mm.size:
        mean, most = float(unseen_mm.mean()), float(unseen_mm.max())
    unit = FILE_UNIT[free]
    return CampaignEstimate(errors / unit, std / unit, true.bound / unit, mean, most)


def _unseen_errors_mm(unseen: PairedShots, true: _Robot, identified: Geometry) -> Array:
    """Sizes of the errors of distances, (M,); raises `NoSolution`."""
    first, second = unseen.pairs.T
    found = forward(identified, unseen.joints_rad, true.unseen).require()
    exact_mm, found_mm = (distances_mm(p[:, :3], first, second) for p in (true.unseen, found))
    return np.abs(found_mm - exact_mm)
