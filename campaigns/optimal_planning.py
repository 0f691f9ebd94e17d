"""Plans a campaign by what its shots will tell: the best few of thousands of candidates."""

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.errors import PlanInvalid
from campaigns.numerics.approaches import balanced_order, neighbouring_pairs, shares_from_below
from campaigns.numerics.candidates import (
    Candidates,
    pair_candidates,
    point_rows,
    shot_candidates,
    without_frame,
)
from campaigns.numerics.criteria import CriterionName, make_criterion
from campaigns.numerics.design import Unobservable, WrongCount, optimal_design
from campaigns.numerics.enough import CurvePoint, GoalOutOfReach, smallest_design
from campaigns.numerics.geometry import FREE_BY_DEFAULT, Array, Geometry, Index
from campaigns.numerics.instrument import (
    TrackerUncertainty,
    distance_variance_mm2,
    point_covariance_mm2,
)
from campaigns.numerics.par4 import inverse
from campaigns.numerics.placement import (
    Region,
    WorkspaceTooSmall,
    boundary_poses,
    inner_poses,
    pair_up,
)
from campaigns.plan_file import PlannedShot
from campaigns.planning import (
    PlanRequest,
    View,
    joints_of,
    make_plan,
    numbered_shots,
    numeric_geometry,
    numeric_limits,
    poses_of,
    region_of,
    with_reserve,
)
from campaigns.robot import RobotFile
from campaigns.shot_sets import ShotSet

Estimator = Literal["points", "distances"]

CANDIDATES = 4000
PAIRINGS = 6
"""How often the candidate poses are paired anew: so many pairs have as many rows as the shots."""
WORKSPACE_SAMPLE = 1000
MOST_SHOTS = 1000
ANY_DIRECTION_RAD = np.pi


@dataclass(frozen=True, slots=True)
class OptimalRequest:
    """What the shots shall be best for."""

    plan: PlanRequest
    uncertainty: TrackerUncertainty
    estimator: Estimator = "points"
    criterion: CriterionName = "I"
    free: tuple[str, ...] = FREE_BY_DEFAULT
    until_mm: float | None = None
    """σ that no length shall exceed, with as few shots as that takes, whatever `plan` says."""
    candidates: int = CANDIDATES


@dataclass(frozen=True, slots=True, eq=False)
class OptimalPlan:
    """The plan, and what its making showed."""

    shots: tuple[PlannedShot, ...]
    from_below: tuple[float, ...]
    """Share of identification shots to which each joint comes from a smaller angle, (4,)."""
    curve: tuple[CurvePoint, ...]
    """What other numbers of shots, or of pairs, would tell; empty when the number was asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class Options:
    """What can be chosen from: poses and joints (N, 4), and measurements made of them."""

    poses: Array
    joints_rad: Array
    ends: Index
    """Rows of the poses of each measurement: one for a shot, two for a pair, (M, 1 or 2)."""
    candidates: Candidates
    workspace_rows: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Choice:
    """Poses to identify from, (N, 4), and the pairs of them."""

    poses: Array
    pairs: Index
    curve: tuple[CurvePoint, ...]


def make_optimal_plan(
    robot: RobotFile, view: View, request: OptimalRequest, rng: np.random.Generator
) -> OptimalPlan:
    """Identification shots by optimal design; validation pairs and drift shots as in every plan.

    Raises `PlanInvalid` when too little of the workspace can be measured, the goal is out of reach,
    there are too few candidates or the free parameters cannot be told apart.
    """
    others = make_plan(robot, view, replace(request.plan, identification_shots=0), rng)
    unseen = [shot for shot in others if shot.purpose is ShotSet.VALIDATION]
    limits = with_reserve(numeric_limits(robot))
    region = region_of(numeric_geometry(robot), limits, view, request.plan.centre)
    try:
        choice = _choose(region, request, rng)
    except WorkspaceTooSmall as error:
        raise PlanInvalid(
            f"too small a part of the workspace can be measured: {error}",
            remedy="check the robot's limits and the tracker's place, or ask for fewer candidates",
        ) from error
    shots = _ordered(region, choice, unseen, request.plan.drift_shots)
    return OptimalPlan(shots, approach_shares(shots), choice.curve)


def approach_shares(shots: tuple[PlannedShot, ...]) -> tuple[float, ...]:
    """Share of identification shots to which each joint comes from a smaller angle, (4,).

    Ways are taken as straight; the first shot is reached from its own joints.
    """
    joints = joints_of(shots)
    counted = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots])
    return tuple(shares_from_below(joints, joints[0], counted).tolist())


def _choose(region: Region, request: OptimalRequest, rng: np.random.Generator) -> _Choice:
    options = draw_options(region, request, rng)
    try:
        chosen, curve = chosen_of(options, request, rng)
    except GoalOutOfReach as error:
        raise PlanInvalid(
            str(error),
            remedy=f"ask for σ={_next_up(error.best_mm):g} or more, or place the tracker nearer",
        ) from error
    except WrongCount as error:
        raise PlanInvalid(str(error), remedy="ask for another number of shots") from error
    except Unobservable as error:
        raise PlanInvalid(str(error), remedy="hold one of them, with --fix") from error
    rows = options.ends[chosen].ravel()
    poses, joints = options.poses[rows], options.joints_rad[rows]
    if request.estimator == "distances":
        return _Choice(poses, np.arange(len(rows)).reshape(-1, 2), curve)
    return _Choice(poses, neighbouring_pairs(joints, poses[:, :3], _start_rad(region)), curve)


def chosen_of(
    options: Options, request: OptimalRequest, rng: np.random.Generator
) -> tuple[Index, tuple[CurvePoint, ...]]:
    """Rows of the chosen measurements, and what other numbers of them were tried.

    Raises `GoalOutOfReach`, `WrongCount` and `Unobservable`.
    """
    candidates, poses_each = options.candidates, options.ends.shape[1]
    criterion = make_criterion(request.criterion, candidates, options.workspace_rows)
    if request.until_mm is None:
        count = request.plan.identification_shots // poses_each
        return optimal_design(candidates, criterion, count, rng).chosen, ()
    step = 2 // poses_each
    most = min(MOST_SHOTS // poses_each, len(candidates) // step * step)
    enough = smallest_design(candidates, criterion, request.until_mm, most, step, rng)
    return enough.least.design.chosen, enough.curve


def draw_options(region: Region, request: OptimalRequest, rng: np.random.Generator) -> Options:
    """Candidates from all over the workspace and from its boundary, where most is to be learnt.

    Raises `WorkspaceTooSmall`.
    """
    near_boundary = request.candidates // 2
    inner = inner_poses(region, request.candidates - near_boundary, rng)
    poses = np.vstack([inner, boundary_poses(region, near_boundary, rng)])
    joints = inverse(region.geometry, poses).require()
    everywhere = replace(region, acceptance_rad=ANY_DIRECTION_RAD)
    workspace = inner_poses(everywhere, WORKSPACE_SAMPLE, rng)
    seen = _point_rows(region.geometry, request.free, workspace)
    noise = point_covariance_mm2(poses[:, :3] - region.view_from_mm, request.uncertainty)
    if request.estimator == "points":
        shots = shot_candidates(region.geometry, request.free, joints, poses, noise)
        return Options(poses, joints, np.arange(len(poses))[:, None], shots, seen)
    pairs = _many_pairs(poses, rng)
    variance = distance_variance_mm2(poses[:, :3], noise, pairs[:, 0], pairs[:, 1])
    distances = pair_candidates(region.geometry, request.free, joints, poses, pairs, variance)
    return Options(poses, joints, pairs, distances, without_frame(seen))


def _point_rows(geometry: Geometry, free: tuple[str, ...], poses: Array) -> Array:
    return point_rows(geometry, free, inverse(geometry, poses).require(), poses)


def _many_pairs(poses: Array, rng: np.random.Generator) -> Index:
    """Different pairs of rows of poses, (M, 2)."""
    pairs = np.vstack([pair_up(poses, rng) for _ in range(PAIRINGS)])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def _next_up(length_mm: float) -> float:
    """Rounded up to two figures, so that it can be reached."""
    digit = 10.0 ** (math.floor(math.log10(length_mm)) - 1)
    return math.ceil(length_mm / digit) * digit


def _start_rad(region: Region) -> Array:
    return np.asarray(inverse(region.geometry, region.centre[None]).require()[0])


def _ordered(
    region: Region, choice: _Choice, unseen: list[PlannedShot], drift_shots: int
) -> tuple[PlannedShot, ...]:
    """All pairs in one tour, so that slow effects meet them alike, and the drift shots in it."""
    fitted, start = len(choice.poses), _start_rad(region)
    poses = np.vstack([choice.poses, poses_of(unseen).reshape(-1, 4)])
    joints = inverse(region.geometry, poses).require()
    pairs = np.vstack([choice.pairs, np.arange(fitted, len(poses)).reshape(-1, 2)])
    tour = balanced_order(joints, pairs, start, np.arange(len(poses)) < fitted)
    return numbered_shots(tour, poses, joints, fitted, (region.centre, start), drift_shots)
