"""Plans a campaign by what its shots will tell: the best few of thousands of candidates."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from campaigns.errors import PlanInvalid
from campaigns.estimators import Estimator
from campaigns.numerics.approaches import balanced_order, neighbouring_pairs
from campaigns.numerics.design import Unobservable, optimal_design
from campaigns.numerics.enough import (
    GoalOutOfReach,
    curve_counts,
    design_curve,
    fewest_of,
    smallest_design,
)
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.par4 import inverse
from campaigns.numerics.placement import (
    Region,
    WorkspaceTooSmall,
)
from campaigns.numerics.statistics import covariance
from campaigns.planning.foresight import (
    Expected,
    cannot_be_told_apart,
)
from campaigns.planning.options import CANDIDATES, OptimalRequest, Options, draw_options
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import (
    View,
    make_plan,
    numbered_shots,
    poses_of,
    region_of,
    with_reserve,
)
from campaigns.robots.arrays import numeric_geometry, numeric_limits
from campaigns.robots.robot import RobotFile
from campaigns.shot_sets import ShotSet

MOST_SHOTS = 1000
GOAL_ROUNDS = 4
"""For a goal by distances, whose common variance is known when they are chosen."""
CURVE_REACH = 2
"""The curve goes on to so many times the plan's shots, and to twice that of the fewest."""
NEARLY_THE_SAME = 0.15
"""Other numbers of shots stay off the plan's own by more than this part of it."""


@dataclass(frozen=True, slots=True, eq=False)
class OptimalPlan:
    """The plan, and what its making showed."""

    shots: tuple[PlannedShot, ...]
    curve: tuple[Expected, ...]
    """What other numbers of shots would tell, this plan's own among them."""


@dataclass(frozen=True, slots=True, eq=False)
class _Choice:
    """Poses to identify from, (N, 4), and the pairs of them."""

    poses: Array
    pairs: Index
    curve: tuple[Expected, ...]


def make_optimal_plan(
    robot: RobotFile, view: View, request: OptimalRequest, rng: np.random.Generator
) -> OptimalPlan:
    """Identification shots by optimal design; validation pairs and drift shots as in every plan.

    Raises `PlanInvalid` when too little of the workspace can be measured, the goal is out of reach,
    there are too few candidates or shots, or the free parameters cannot be told apart.
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
    except Unobservable as error:
        raise cannot_be_told_apart(error) from error
    return OptimalPlan(_ordered(region, choice, unseen, request.plan.drift_shots), choice.curve)


def _choose(region: Region, request: OptimalRequest, rng: np.random.Generator) -> _Choice:
    """Raises `PlanInvalid`, `WorkspaceTooSmall` and `Unobservable`."""
    options = draw_options(region, request, rng)
    _check_shots(options, request)
    chosen = chosen_of(options, request, rng)
    curve = tuple(_curve(options, request, chosen, rng))
    rows = options.ends[chosen].ravel()
    poses, joints = options.poses[rows], options.joints_rad[rows]
    if request.estimator == Estimator.DISTANCES:
        return _Choice(poses, np.arange(len(rows)).reshape(-1, 2), curve)
    return _Choice(poses, neighbouring_pairs(joints, poses[:, :3], _start_rad(region)), curve)


def _check_shots(options: Options, request: OptimalRequest) -> None:
    """Raise `PlanInvalid` for more shots than candidates, and for fewer than the unknowns need."""
    shots, fewest = request.plan.identification_shots, _fewest_shots(options)
    if shots > request.candidates and request.until_mm is None:
        raise PlanInvalid(
            f"{shots} shots are to be chosen, but there are only {request.candidates} candidates",
            remedy=f"give more candidates, as --candidates {CANDIDATES}, or ask for fewer shots",
        )
    if shots < fewest:
        raise PlanInvalid(
            f"{shots} shots cannot tell {len(request.free)} parameters apart by "
            f"{request.estimator}, {fewest} or more are needed",
            remedy="ask for more shots, or hold parameters with --fix",
        )


def _fewest_shots(options: Options) -> int:
    """An even number; raises `Unobservable`."""
    return fewest_of(options.candidates, options.step) * options.poses_each


def chosen_of(options: Options, request: OptimalRequest, rng: np.random.Generator) -> Index:
    """Rows of the chosen measurements, (N,).

    Raises `PlanInvalid` for a goal that is out of reach, `WrongCount` and `Unobservable`.
    """
    criterion = options.criterion(request.criterion)
    count = request.plan.identification_shots // options.poses_each
    if request.until_mm is None:
        return optimal_design(options.candidates, criterion, count, rng).chosen
    most = min(count, len(options.candidates) // options.step * options.step)
    goal_mm = request.until_mm
    try:
        for _ in range(GOAL_ROUNDS):
            design = smallest_design(
                options.candidates, criterion, goal_mm, most, options.step, rng
            ).least
            found_mm = design.worst_length_mm * options.underrated(design.chosen)
            if found_mm <= request.until_mm:
                break
            goal_mm *= request.until_mm / found_mm
    except GoalOutOfReach as error:
        raise _out_of_reach(error, request.until_mm, options.poses_each) from error
    return design.chosen


def _out_of_reach(error: GoalOutOfReach, goal_mm: float, poses_each: int) -> PlanInvalid:
    best_mm = error.best.worst_length_mm
    return PlanInvalid(
        f"goal σ={goal_mm:g} mm is out of reach: {error.best.count * poses_each} shots, the most "
        f"allowed, leave ±{best_mm:.4f} mm for the worst length",
        remedy=f"ask for σ={_next_up(best_mm):g} or more, allow more --shots or --candidates, "
        "or place the tracker nearer",
    )


def _curve(
    options: Options, request: OptimalRequest, chosen: Index, rng: np.random.Generator
) -> Iterator[Expected]:
    """What other numbers of measurements would tell, and the chosen ones among them."""
    fewest = fewest_of(options.candidates, options.step)
    reach = min(CURVE_REACH * max(len(chosen), 2 * fewest), len(options.candidates))
    counts = [
        count
        for count in curve_counts(fewest, reach, options.step)
        if abs(count - len(chosen)) > NEARLY_THE_SAME * len(chosen)
    ]
    criterion = options.criterion(request.criterion)
    others = [p.chosen for p in design_curve(options.candidates, criterion, counts, rng)]
    for rows in sorted([*others, chosen], key=len):
        matrix = covariance(options.candidates.jacobian(rows))[: len(request.free)]
        shots = len(rows) * options.poses_each
        parameters = matrix[:, : len(request.free)] * options.underrated(rows) ** 2
        yield Expected(shots, request.free, parameters)


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
