"""Estimates of campaigns in which nothing goes wrong, beside the Cramér-Rao bound at the truth."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import CampaignError
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import predict_distances, predict_points
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residual_stacks import (
    DistanceStack,
    PointStack,
    RobotStack,
    can_be_stacked,
    with_frames,
)
from campaigns.estimation.tracker_noise import (
    distance_variance_mm2,
    inverse_roots,
    point_covariance_mm2,
    roots,
)
from campaigns.identification.fit import fit_shots
from campaigns.identification.fit_stack import covariances, fit_stack
from campaigns.identification.observations import Inputs
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.configuration import CONVERGED_MM
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
    noise: study.Noise | None = None
    """What measures in the tracker's place."""

    def measured_mm(self, rng: np.random.Generator) -> Array:
        """Points with noise in the tracker's frame, (N, 3)."""
        if self.noise is not None:
            return self.points_mm + self.noise(self.points_mm, rng)
        draws = rng.standard_normal(self.points_mm.shape)
        return np.asarray(self.points_mm + np.einsum("nij,nj->ni", self.scatter_mm, draws))


def estimated(
    task: study.StudyTask, kernel: ModuleType | None = None
) -> tuple[study.CampaignRow, ...]:
    """Rows with an estimate each, or with why there is none; by compiled loops with a `kernel`."""
    setup = task.setup
    at_nominal = setup.nominal.forward(setup.shots.joints)
    found = true_robots(setup, at_nominal.values_or_raise(), task.truths, kernel)
    robots, points, rows = list[TrueRobot](), list[Array](), dict[int, study.CampaignRow]()
    for number, robot in zip(task.numbers, found, strict=True):
        if isinstance(robot, str):
            rows[number] = study.CampaignRow(number, failure=robot)
        else:
            points.append(robot.measured_mm(np.random.default_rng([setup.seed, number])))
            robots.append(robot)
    drawn = (number for number in task.numbers if number not in rows)
    for number, each in zip(
        drawn, estimates(setup, robots, points, at_nominal, kernel), strict=True
    ):
        if isinstance(each, str):
            rows[number] = study.CampaignRow(number, failure=each)
        else:
            rows[number] = study.CampaignRow(number, estimate=each)
    return tuple(rows[number] for number in task.numbers)


def true_robots(
    setup: study.StudySetup, near: Array, truths: Array, kernel: ModuleType | None = None
) -> Iterator[TrueRobot | str]:
    """True robots of parameters (C, P), all at once, or why one is none.

    `near` are poses (N, t) near theirs. By compiled loops with a `kernel`.
    """
    values = [row.tobytes() for row in truths]  # all alike without tolerances
    different = {each: place for place, each in enumerate(values)}
    known = _different_robots(setup, near, truths[[*different.values()]], kernel)
    robots = dict(zip(different, known, strict=True))
    yield from (robots[each] for each in values)


def _different_robots(
    setup: study.StudySetup, near: Array, p: Array, kernel: ModuleType | None
) -> Iterator[TrueRobot | str]:
    try:
        yield from [*_stacked(setup, near, p, kernel)]
    except (NoSolution, np.linalg.LinAlgError):
        if len(p) > 1:
            for one in p:
                yield from _different_robots(setup, near, one[None], kernel)
            return
        try:
            yield true_robot(setup, near, tuple(p[0].tolist()))
        except (NoSolution, CampaignError, np.linalg.LinAlgError) as error:
            yield str(error)


def _stacked(
    setup: study.StudySetup, near: Array, p: Array, kernel: ModuleType | None
) -> Iterator[TrueRobot]:
    """True robots; raises `NoSolution`, and `LinAlgError` where one has no bound."""
    mechanism, shots, every = setup.nominal.mechanism, setup.shots, np.arange(len(p))
    places, instrument = mechanism.parameters.places(setup.free), setup.options.instrument
    if not can_be_stacked(mechanism.parameters, p, places):
        raise NoSolution("only of perfect transmissions")
    start = np.tile(near.T, (len(p), 1, 1))
    robots = RobotStack(mechanism, p, places, shots.joints, start, CONVERGED_MM, kernel)
    positions, seen = robots.positions_mm(robots.start, every)
    if not seen.all():
        raise NoSolution("a robot cannot take a shot")
    points_mm = setup.tracker_from_base.apply(positions.swapaxes(1, 2))
    in_base_axes_mm = points_mm @ setup.tracker_from_base.rotation
    stated, noise_mm2 = (
        point_covariance_mm2(each, instrument) for each in (points_mm, in_base_axes_mm)
    )
    if setup.estimator is Estimator.POINTS:
        still = np.tile(np.eye(3), (len(p), 1, 1)), np.zeros((len(p), 3))
        by_component = np.ascontiguousarray(np.moveaxis(inverse_roots(noise_mm2), 1, -1))
        of_points = PointStack(robots, positions, by_component, still)
        jacobian = of_points.jacobian(with_frames(robots.start), every)
        rows = study.fitted_rows(shots)
        by_shot = jacobian.reshape(len(p), 3, len(shots), -1)[:, :, rows]
        jacobian = by_shot.reshape(len(p), 3 * len(rows), -1)
    else:
        first, second = shots.whole_pairs(ShotSet.IDENTIFICATION).rows.T
        variance = distance_variance_mm2(in_base_axes_mm, noise_mm2, first, second)
        of_pairs = DistanceStack(robots, first, second, variance, 1.0 / np.sqrt(variance))
        jacobian = of_pairs.jacobian(robots.start, every)
    of_all = covariances(kernel, jacobian)
    bound = np.sqrt(np.diagonal(of_all, axis1=1, axis2=2))[:, : len(places)]
    scatter_mm = roots(stated)
    for row in every.tolist():
        true, poses = Kinematics(mechanism, p[row]), robots.poses[row].T
        yield TrueRobot(true, points_mm[row], scatter_mm[row], bound[row], poses, setup.noise)


def true_robot(setup: study.StudySetup, near: Array, values: tuple[float, ...]) -> TrueRobot:
    """Raises `NoSolution`, and `LinAlgError` when its shots do not fix the parameters."""
    true = Kinematics(setup.nominal.mechanism, np.array(values))
    poses = true.forward(setup.shots.joints, near).values_or_raise()
    points_mm = setup.tracker_from_base.apply(poses[:, :3])
    covariance_mm2 = point_covariance_mm2(points_mm, setup.options.instrument)
    bound = _bound(setup, true, poses, points_mm)
    return TrueRobot(true, points_mm, roots(covariance_mm2), bound, poses, setup.noise)


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


def estimates(
    setup: study.StudySetup,
    robots: Sequence[TrueRobot],
    points_mm: Sequence[Array],
    at_nominal: KinematicSolution,
    kernel: ModuleType | None = None,
) -> Iterator[study.CampaignEstimate | str]:
    """Estimates as identification makes them of points (N, 3) each, or why there is none.

    Plain fits are made all at once, the others one by one.
    """
    if not robots:
        return
    free, places = len(setup.free), setup.nominal.mechanism.parameters.places(setup.free)
    shots = replace(setup.shots, points_in_tracker_mm=points_mm[0])
    inputs = Inputs(setup.nominal, shots, ParameterSelection(setup.free), setup.options, at_nominal)
    stack = fit_stack(inputs, np.array(points_mm), kernel)
    rows = setup.shots.whole_pairs(ShotSet.VALIDATION).rows.T.ravel()
    near = np.array([robot.poses[rows].T for robot in robots])
    mechanism, p = setup.nominal.mechanism, np.tile(setup.nominal.p, (len(robots), 1))
    joints, about = setup.shots.joints[rows], stack.robots
    unseen = RobotStack(mechanism, p, places, joints, near, CONVERGED_MM, kernel, about)
    x = np.where(stack.plain[:, None], stack.x[:, :free], unseen.start)
    unseen_mm, seen = unseen.positions_mm(x, np.arange(len(robots)))
    plain = np.flatnonzero(stack.plain & seen)
    std = np.sqrt(np.diagonal(stack.covariance, axis1=1, axis2=2))[plain]
    own = [robots[row] for row in plain.tolist()]
    found = _beside_truth(setup, own, x[plain], std, unseen_mm[plain].swapaxes(1, 2), rows)
    by_row = dict(zip(plain.tolist(), found, strict=True))
    for row, (robot, points) in enumerate(zip(robots, points_mm, strict=True)):
        if row in by_row:
            yield by_row[row]
        else:
            shots = replace(setup.shots, points_in_tracker_mm=points)
            yield _one(setup, robot, replace(inputs, shots=shots), rows)


def _one(
    setup: study.StudySetup, robot: TrueRobot, inputs: Inputs, rows: Index
) -> study.CampaignEstimate | str:
    """The same of one campaign, with these unseen rows."""
    free, places = len(setup.free), setup.nominal.mechanism.parameters.places(setup.free)
    try:
        found = fit_shots(inputs).found
        if not found.fit.converged:
            return found.fit.message
        if found.covariance is None or found.seen.rank < free:
            return f"rank {found.seen.rank} of {free}"
        p = setup.nominal.p.copy()
        p[places] = found.x[:free]
        identified = Kinematics(setup.nominal.mechanism, p)
        unseen = identified.forward(setup.shots.joints[rows], robot.poses[rows]).values_or_raise()
        std = np.sqrt(np.diag(found.covariance)[:free])
        x, unseen_mm = found.x[None, :free], unseen[None, :, :3]
        return next(_beside_truth(setup, [robot], x, std[None], unseen_mm, rows))
    except (NoSolution, CampaignError, np.linalg.LinAlgError) as error:
        return str(error)


def _beside_truth(
    setup: study.StudySetup,
    robots: Sequence[TrueRobot],
    found: Array,
    std: Array,
    unseen_mm: Array,
    unseen: Index,
) -> Iterator[study.CampaignEstimate]:
    """Estimates (R, F), and positions (R, K, 3) of the unseen rows, beside the truth.

    All first ends of unseen pairs come first.
    """
    if not robots:
        return
    space = setup.nominal.mechanism.parameters
    places, unit = space.places(setup.free), space.units(setup.free)
    ends = np.arange(len(unseen)).reshape(2, -1)
    exact_mm = distances_mm(np.array([robot.poses[unseen, :3] for robot in robots]), *ends)
    off_mm = np.abs(distances_mm(unseen_mm, *ends) - exact_mm)
    errors = (found - np.array([robot.true.p[places] for robot in robots])) / unit
    bounds = np.array([robot.bound for robot in robots]) / unit
    columns = (errors, std / unit, bounds, off_mm)
    for error, own, bound, off in zip(*(each.tolist() for each in columns), strict=True):
        yield study.CampaignEstimate(
            errors=tuple(error),
            std=tuple(own),
            bound=tuple(bound),
            unseen_mean_mm=sum(off) / len(off) if off else None,
            unseen_max_mm=max(off) if off else None,
        )
