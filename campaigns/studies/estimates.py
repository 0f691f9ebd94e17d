"""Estimates of campaigns in which nothing goes wrong, beside the Cramér-Rao bound at the truth."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError
from campaigns.estimation.estimate import Estimate
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import predict_distances, predict_points
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.tracker_noise import distance_variance_mm2, point_covariance_mm2
from campaigns.identification.fit import fit_shots
from campaigns.identification.observations import Inputs
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics, KinematicSolution, NoSolution
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies import study


@dataclass(frozen=True, slots=True, eq=False)
class TrueRobot:
    """A true robot: its shots as they are, how they scatter, and how well they can tell of it."""

    true: Kinematics
    points_mm: Array
    """Points in the tracker's frame, (N, 3)."""
    scatter_mm: Array
    """Square root of each point's covariance, (N, 3, 3)."""
    bound: Array
    """Cramér-Rao bound of the standard deviations, (F,), mm and rad."""
    poses: Array
    """(N, t)"""

    def measured_mm(self, rng: np.random.Generator) -> Array:
        """Points with noise in the tracker's frame, (N, 3)."""
        draws = rng.standard_normal(self.points_mm.shape)
        return np.asarray(self.points_mm + np.einsum("nij,nj->ni", self.scatter_mm, draws))


def estimated(task: study.StudyTask) -> tuple[study.CampaignRow, ...]:
    """Rows with an estimate each."""
    at_nominal = task.setup.nominal.forward(task.setup.shots.joints)
    near = at_nominal.values_or_raise()
    robot_of = cache(partial(true_robot, task.setup, near))  # without tolerances there is one
    return tuple(
        _row(task.setup, number, partial(robot_of, tuple(truth)), at_nominal)
        for number, truth in zip(task.numbers, task.truths.tolist(), strict=True)
    )


def true_robot(setup: study.StudySetup, near: Array, values: tuple[float, ...]) -> TrueRobot:
    """Raises `NoSolution`, and `LinAlgError` when its shots do not fix the parameters."""
    true = Kinematics(setup.nominal.mechanism, np.array(values))
    poses = true.forward(setup.shots.joints, near).values_or_raise()
    points_mm = setup.tracker_from_base.apply(poses[:, :3])
    covariance_mm2 = point_covariance_mm2(points_mm, setup.options.instrument)
    scatter_mm = np.asarray(np.linalg.cholesky(covariance_mm2), dtype=np.float64)
    return TrueRobot(true, points_mm, scatter_mm, _bound(setup, true, poses, points_mm), poses)


def _bound(setup: study.StudySetup, true: Kinematics, poses: Array, points_mm: Array) -> Array:
    """Cramér-Rao bound of standard deviations, (F,), mm and rad.

    Of what the estimator is given, at the truth: Fisher's information of the coordinates, or of
    the distances.
    """
    joints, pairs = setup.shots.joints, setup.shots.whole_pairs(ShotSet.IDENTIFICATION).rows
    in_base_axes_mm = points_mm @ setup.tracker_from_base.rotation
    noise_mm2 = point_covariance_mm2(in_base_axes_mm, setup.options.instrument)
    if setup.estimator is Estimator.POINTS:
        rows = study.fitted_rows(setup.shots)
        found, _ = predict_points(true, setup.free, joints[rows], poses[rows], noise_mm2[rows])
        return np.sqrt(np.diag(found)[: len(setup.free)])
    variance_mm2 = distance_variance_mm2(in_base_axes_mm, noise_mm2, *pairs.T)
    found, _ = predict_distances(true, setup.free, joints, poses, pairs, variance_mm2)
    return np.sqrt(np.diag(found))


def _row(
    setup: study.StudySetup,
    number: int,
    robot: Callable[[], TrueRobot],
    at_nominal: KinematicSolution,
) -> study.CampaignRow:
    rng = np.random.default_rng([setup.seed, number])
    try:
        drawn = robot()
        found = fitted(setup, drawn.measured_mm(rng), at_nominal)
        if not found.fit.converged:
            return study.CampaignRow(number, failure=found.fit.message)
        if found.covariance is None or found.seen.rank < len(setup.free):
            return study.CampaignRow(number, failure=f"rank {found.seen.rank} of {len(setup.free)}")
        return study.CampaignRow(number, estimate=estimate_of(setup, drawn, found))
    except (NoSolution, CampaignError, np.linalg.LinAlgError) as error:
        return study.CampaignRow(number, failure=str(error))


def fitted(setup: study.StudySetup, points_mm: Array, at_nominal: KinematicSolution) -> Estimate:
    """Estimate as identification makes it of the same shots."""
    shots = replace(setup.shots, points_in_tracker_mm=points_mm)
    selection = ParameterSelection(setup.free)
    return fit_shots(Inputs(setup.nominal, shots, selection, setup.options, at_nominal)).found


def estimate_of(
    setup: study.StudySetup, robot: TrueRobot, found: Estimate
) -> study.CampaignEstimate:
    """Estimate beside the truth; raises `NoSolution`."""
    assert found.covariance is not None, "looked at before"
    space, count = setup.nominal.mechanism.parameters, len(setup.free)
    places, unit = space.places(setup.free), space.units(setup.free)
    identified = setup.nominal.p.copy()
    identified[places] = found.x[:count]
    errors = (identified - robot.true.p)[places]
    std = np.sqrt(np.diag(found.covariance)[:count])
    unseen_mm = _unseen_errors_mm(setup, robot, Kinematics(setup.nominal.mechanism, identified))
    return study.CampaignEstimate(
        errors=tuple((errors / unit).tolist()),
        std=tuple((std / unit).tolist()),
        bound=tuple((robot.bound / unit).tolist()),
        unseen_mean_mm=float(unseen_mm.mean()) if unseen_mm.size else None,
        unseen_max_mm=float(unseen_mm.max()) if unseen_mm.size else None,
    )


def _unseen_errors_mm(setup: study.StudySetup, robot: TrueRobot, identified: Kinematics) -> Array:
    """Sizes of the errors of distances, (M,); raises `NoSolution`."""
    rows = setup.shots.whole_pairs(ShotSet.VALIDATION).rows.T.ravel()
    found = identified.forward(setup.shots.joints[rows], robot.poses[rows]).values_or_raise()
    ends = np.arange(len(rows)).reshape(2, -1)
    exact_mm, found_mm = (distances_mm(p[:, :3], *ends) for p in (robot.poses[rows], found))
    return np.abs(found_mm - exact_mm)
