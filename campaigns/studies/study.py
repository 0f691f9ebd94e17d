"""Monte Carlo study: simulated campaigns of one plan, each identified as `identify` does it."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError
from campaigns.estimation.estimate import Estimate
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import predict_distances, predict_points
from campaigns.estimation.observability import observability, unobservable_combinations
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import distance_variance_mm2, point_covariance_mm2
from campaigns.identification.fit import fit_shots
from campaigns.identification.observations import observations
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics, KinematicSolution, NoSolution
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, poses_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.version import VERSION


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StudySetup:
    """Setup that all campaigns of a study share.

    `shots` are those of the plan, fitted and unseen; where their points are each campaign draws.
    """

    nominal: Kinematics
    shots: Shots
    free: tuple[str, ...]
    options: IdentificationOptions
    """Options of the fits; their instrument is what the simulated tracker states, and has."""
    tracker_from_base: Transform
    seed: int

    @property
    def fitted(self) -> Shots:
        """Shots that are identified from."""
        return self.shots.of_set(ShotSet.IDENTIFICATION)

    @property
    def estimator(self) -> Estimator:
        """Estimator of the fits."""
        return self.options.estimator

    @property
    def dof(self) -> int:
        """Numbers measured less numbers sought; of points three a shot, and a frame's six more."""
        if self.estimator is Estimator.POINTS:
            return 3 * len(self.fitted) - len(self.free) - FRAME_COLUMNS
        return len(self.shots.whole_pairs(ShotSet.IDENTIFICATION).rows) - len(self.free)

    def digest(self, truth: str) -> str:
        """Twelve characters that differ between studies; `truth` says how robots are drawn."""
        shots, frame = self.shots, self.tracker_from_base
        pairs = [-1 if pair is None else pair for pair in shots.pairs]
        parts = [self.nominal.p, frame.rotation, frame.translation_mm, shots.joints]
        parts.append(np.array(pairs, dtype=np.float64))
        sets = [purpose.value for purpose in shots.purposes]
        how = self.options
        words = (how.estimator.value, how.outliers.value, how.weights.value)
        asked = (*words, how.loss, how.instrument)
        settings = (truth, self.nominal.mechanism.name, sets, self.free, *asked, self.seed)
        text = repr((*settings, VERSION))  # another version may find other numbers
        hashed = hashlib.sha256(text.encode("utf-8"))
        for part in parts:
            hashed.update(np.ascontiguousarray(part).tobytes())
        return hashed.hexdigest()[:12]


def planned_shots(shots: Sequence[PlannedShot]) -> Shots:
    """Shots of plans before anything is measured: their points are not numbers yet.

    Pairs are numbered anew, for those of two plans may have the same numbers.
    """
    joints, count = joints_of(shots), len(shots)
    places: dict[tuple[ShotSet, int], int] = {}
    return Shots(
        numbers=tuple(range(count)),
        purposes=tuple(shot.purpose for shot in shots),
        pairs=tuple(
            None if shot.pair is None else places.setdefault((shot.purpose, shot.pair), len(places))
            for shot in shots
        ),
        joints=joints,
        points_in_tracker_mm=np.full((count, 3), np.nan),
        stated_covariance_mm2=np.full((count, 3, 3), np.nan),
        approach=np.zeros_like(joints),
        commanded=poses_of(shots),
        measured_utc=("",) * count,
        temperature_degC=np.full(count, np.nan),
    )


@dataclass(frozen=True, slots=True, eq=False)
class StudyTask:
    """Campaigns of a study, some of them, and the true parameter vectors of each, (C, G)."""

    setup: StudySetup
    numbers: tuple[int, ...]
    truths: Array


@dataclass(frozen=True, slots=True, eq=False)
class CampaignEstimate:
    """Estimate of one campaign's free parameters, in file units (mm, deg): it is to be read."""

    errors: Array
    """Identified minus true, (F,)."""
    std: Array
    """Standard deviations as the estimator states them, (F,)."""
    bound: Array
    """The least standard deviation that its data allow (Cramér and Rao), at the truth, (F,)."""
    unseen_mean_mm: float
    """Mean error of distances never fitted, against the true robot; NaN without such pairs."""
    unseen_max_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class CampaignOutcome:
    """Estimate, or why there is none."""

    number: int
    estimate: CampaignEstimate | None
    failure: str


@dataclass(frozen=True, slots=True, eq=False)
class _Robot:
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


def run_task(task: StudyTask) -> tuple[CampaignOutcome, ...]:
    """Outcomes of simulated campaigns; one that cannot be identified is an outcome too."""
    at_nominal = task.setup.nominal.forward(task.setup.shots.joints)
    near = at_nominal.values_or_raise()
    robot_of = cache(partial(_robot, task.setup, near))  # a scenario without tolerances has one
    return tuple(
        _outcome(task.setup, number, partial(robot_of, tuple(truth)), at_nominal)
        for number, truth in zip(task.numbers, task.truths.tolist(), strict=True)
    )


def indistinguishable(setup: StudySetup) -> list[tuple[str, ...]]:
    """Free parameters that move together without any effect on what the nominal robot's shots tell.

    Raises `NoSolution` when the nominal robot cannot take them.
    """
    poses = setup.nominal.forward(setup.shots.joints).values_or_raise()
    exact_mm = setup.tracker_from_base.apply(poses[:, :3])
    shots = replace(setup.shots, points_in_tracker_mm=exact_mm)
    selection = ParameterSelection(setup.free)
    problem = observations(setup.nominal, shots, selection, setup.options).problem
    seen = observability(problem.jacobian(problem.start()))
    return unobservable_combinations(seen, setup.free)


def _robot(setup: StudySetup, near: Array, values: tuple[float, ...]) -> _Robot:
    """Raises `NoSolution`, and `LinAlgError` when its shots do not fix the parameters."""
    true = Kinematics(setup.nominal.mechanism, np.array(values))
    poses = true.forward(setup.shots.joints, near).values_or_raise()
    points_mm = setup.tracker_from_base.apply(poses[:, :3])
    covariance_mm2 = point_covariance_mm2(points_mm, setup.options.instrument)
    scatter_mm = np.asarray(np.linalg.cholesky(covariance_mm2), dtype=np.float64)
    return _Robot(true, points_mm, scatter_mm, _bound(setup, true, poses, points_mm), poses)


def _bound(setup: StudySetup, true: Kinematics, poses: Array, points_mm: Array) -> Array:
    """Cramér-Rao bound of standard deviations, (F,), mm and rad.

    Of what the estimator is given, at the truth: Fisher's information of the coordinates, or of
    the distances.
    """
    joints, pairs = setup.shots.joints, setup.shots.whole_pairs(ShotSet.IDENTIFICATION).rows
    in_base_axes_mm = points_mm @ setup.tracker_from_base.rotation
    noise_mm2 = point_covariance_mm2(in_base_axes_mm, setup.options.instrument)
    if setup.estimator is Estimator.POINTS:
        sets = setup.shots.purposes
        rows = np.flatnonzero([purpose is ShotSet.IDENTIFICATION for purpose in sets])
        return predict_points(true, setup.free, joints[rows], poses[rows], noise_mm2[rows]).std
    variance_mm2 = distance_variance_mm2(in_base_axes_mm, noise_mm2, *pairs.T)
    return predict_distances(true, setup.free, joints, poses, pairs, variance_mm2).std


def _outcome(
    setup: StudySetup, number: int, robot: Callable[[], _Robot], at_nominal: KinematicSolution
) -> CampaignOutcome:
    rng = np.random.default_rng([setup.seed, number])
    try:
        drawn = robot()
        found = _identified(setup, _measured(drawn, rng), at_nominal)
        if not found.fit.converged:
            return CampaignOutcome(number, None, found.fit.message)
        if found.covariance is None or found.seen.rank < len(setup.free):
            return CampaignOutcome(number, None, f"rank {found.seen.rank} of {len(setup.free)}")
        return CampaignOutcome(number, _estimate(setup, drawn, found), "")
    except (NoSolution, CampaignError, np.linalg.LinAlgError) as error:
        return CampaignOutcome(number, None, str(error))


def _measured(robot: _Robot, rng: np.random.Generator) -> Array:
    """Points with noise in the tracker's frame, (N, 3)."""
    draws = rng.standard_normal(robot.points_mm.shape)
    return np.asarray(robot.points_mm + np.einsum("nij,nj->ni", robot.scatter_mm, draws))


def _identified(setup: StudySetup, points_mm: Array, at_nominal: KinematicSolution) -> Estimate:
    """Estimate as identification makes it of the same shots."""
    shots = replace(setup.shots, points_in_tracker_mm=points_mm)
    selection = ParameterSelection(setup.free)
    return fit_shots(setup.nominal, shots, selection, setup.options, at_nominal).found


def _estimate(setup: StudySetup, robot: _Robot, found: Estimate) -> CampaignEstimate:
    assert found.covariance is not None, "looked at before"
    space, count = setup.nominal.mechanism.parameters, len(setup.free)
    places, unit = space.places(setup.free), space.units(setup.free)
    identified = setup.nominal.p.copy()
    identified[places] = found.x[:count]
    errors = (identified - robot.true.p)[places]
    std = np.sqrt(np.diag(found.covariance)[:count])
    kinematics = Kinematics(setup.nominal.mechanism, identified)
    unseen_mm = _unseen_errors_mm(setup.shots, robot, kinematics)
    mean, most = (float("nan"),) * 2
    if unseen_mm.size:
        mean, most = float(unseen_mm.mean()), float(unseen_mm.max())
    return CampaignEstimate(errors / unit, std / unit, robot.bound / unit, mean, most)


def _unseen_errors_mm(shots: Shots, robot: _Robot, identified: Kinematics) -> Array:
    """Sizes of the errors of distances, (M,); raises `NoSolution`."""
    first, second = shots.whole_pairs(ShotSet.VALIDATION).rows.T
    rows = np.concatenate([first, second])
    found = identified.forward(shots.joints[rows], robot.poses[rows]).values_or_raise()
    ends = np.arange(len(rows)).reshape(2, -1)
    exact_mm, found_mm = (distances_mm(p[:, :3], *ends) for p in (robot.poses[rows], found))
    return np.abs(found_mm - exact_mm)
