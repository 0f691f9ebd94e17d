"""Optimal plans: the identification shots that tell most, of thousands of candidates."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design import pose_sampling, sample_size
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import Criterion
from campaigns.design.exchange import Unobservable, optimal_design
from campaigns.design.tours import BALANCED_SHARE, balance_approaches, neighbouring_pairs
from campaigns.errors import PlanInvalid
from campaigns.estimation import information, tracker_noise
from campaigns.planning import plans
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.predicted_uncertainty import not_identifiable
from campaigns.robots.robot import RobotFile
from campaigns.shots.shot_sets import ShotSet

CANDIDATES = 4000
WORKSPACE_SAMPLE = 1000
"""Number of poses, drawn for each plan, at which positions are to be known best."""
MOST_SHOTS = 1000
STEP = 2
"""Shots of a pair: plans hold whole pairs."""
CURVE_REACH = 2
"""The curve goes on to so many times the plan's shots, and to twice that of the fewest."""
NEARLY_THE_SAME = 0.15
"""Part of the plan's own number of shots by which other numbers stay off it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimalRequest:
    """Request for an optimal plan: what it holds, and what its shots shall be best for."""

    plan: plans.PlanRequest
    uncertainty: tracker_noise.TrackerUncertainty
    free: tuple[str, ...]
    """Names of the parameters that will be identified."""
    until_mm: float | None = None
    """σ that no length shall exceed, with as few shots as that takes; `plan` says the most."""
    candidates: int = CANDIDATES


@dataclass(frozen=True, slots=True, eq=False)
class CandidateSet:
    """Candidate poses (N, t) of a region, the shots taken there, and the design's criterion."""

    region: pose_sampling.FeasibleRegion
    request: OptimalRequest
    poses: Array
    shots: Candidates
    criterion: Criterion


def draw_candidates(
    region: pose_sampling.FeasibleRegion, request: OptimalRequest, rng: np.random.Generator
) -> CandidateSet:
    """Candidates from all over the workspace and from its boundary, where most is to be learnt.

    Raises `WorkspaceTooSmall`.
    """
    near_boundary = request.candidates // 2
    inner = pose_sampling.interior_poses(region, request.candidates - near_boundary, rng)
    poses = np.vstack([inner, pose_sampling.boundary_poses(region, near_boundary, rng)])
    workspace = pose_sampling.workspace_poses(
        region.kinematics, region.limits, region.centre, WORKSPACE_SAMPLE, rng, region.space
    )
    space = region.kinematics.mechanism.parameters
    is_length = ~space.is_angle[space.places(request.free)]
    noise = tracker_noise.point_covariance_mm2(
        poses[:, :3] - region.view_from_mm, request.uncertainty
    )
    seen = information.whitened(_jacobian(region, request.free, poses), noise)
    shots = Candidates.from_jacobians(seen, request.free, is_length)
    criterion = Criterion.of(shots, _jacobian(region, request.free, workspace))
    return CandidateSet(region, request, poses, shots, criterion)


def _jacobian(region: pose_sampling.FeasibleRegion, free: tuple[str, ...], poses: Array) -> Array:
    joints = region.kinematics.inverse(poses).values_or_raise()
    return information.point_jacobian(region.kinematics, free, joints, poses)


def make_optimal_plan(
    robot: RobotFile, view: plans.View, request: OptimalRequest, rng: np.random.Generator
) -> tuple[tuple[PlannedShot, ...], tuple[tuple[int, information.Uncertainty], ...]]:
    """Identification shots by optimal design; validation pairs and drift shots as in every plan.

    Then other numbers of shots and what they would give, this plan's own among them.
    Raises `PlanInvalid` when too little of the workspace can be measured, the goal is out of reach,
    there are too few shots, or the free parameters cannot be told apart.
    """
    wanted = request.plan
    others = plans.make_plan(robot, view, replace(wanted, identification_shots=0), rng)
    unseen = [shot for shot in others if shot.purpose is ShotSet.VALIDATION]
    region = plans.requested_region(robot, view, wanted)
    try:
        options = draw_candidates(region, request, rng)
        _check_shots(options)
        chosen = choose_shots(options, rng)
        curve = tuple(_curve(options, chosen, rng))
    except pose_sampling.WorkspaceTooSmall as error:
        raise plans.too_small(error, region, "candidates") from error
    except Unobservable as error:
        raise not_identifiable(error) from error
    return _ordered(region, options.poses[chosen], unseen, wanted), curve


def _check_shots(options: CandidateSet) -> None:
    """Raise `PlanInvalid` for more shots than candidates, and for fewer than the unknowns need."""
    request = options.request
    shots, fewest = request.plan.identification_shots, _fewest_shots(options)
    if shots > request.candidates and request.until_mm is None:
        raise PlanInvalid(
            f"{shots} shots are to be chosen, but there are only {request.candidates} candidates",
            remedy="ask for fewer shots",
        )
    if shots < fewest:
        raise PlanInvalid(
            f"{shots} shots cannot tell {len(request.free)} parameters apart, "
            f"{fewest} or more are needed",
            remedy="ask for more shots, or fix parameters with --fix",
        )


def _fewest_shots(options: CandidateSet) -> int:
    """An even number; raises `Unobservable`."""
    return sample_size.minimum_count(options.shots, STEP)


def choose_shots(options: CandidateSet, rng: np.random.Generator) -> Index:
    """Rows (N,) of the best candidates, or of as few as meet a goal.

    Raises `PlanInvalid` for a goal that is out of reach, `ValueError` and `Unobservable`.
    """
    request, known = options.request, (options.shots, options.criterion)
    count = request.plan.identification_shots
    if request.until_mm is None:
        return optimal_design(*known, count, rng).chosen
    most = min(count, len(options.poses) // STEP * STEP)
    try:
        return sample_size.minimal_design(*known, request.until_mm, most, STEP, rng).chosen
    except sample_size.GoalOutOfReach as error:
        best_mm = error.best.worst_length_mm
        raise PlanInvalid(
            f"goal σ={request.until_mm:g} mm is out of reach: {error.best.count} shots, the most "
            f"allowed, leave ±{best_mm:.4f} mm for the worst length",
            remedy=f"ask for σ={_next_up(best_mm):g} or more, allow more --shots, "
            "or place the tracker nearer",
        ) from error


def _curve(
    options: CandidateSet, chosen: Index, rng: np.random.Generator
) -> Iterator[tuple[int, information.Uncertainty]]:
    """What other numbers of shots would give, the chosen ones among them."""
    own, fewest = len(chosen), _fewest_shots(options)
    reach = min(CURVE_REACH * max(own, 2 * fewest), len(options.poses))
    counts = [
        count
        for count in sample_size.curve_counts(fewest, reach, STEP)
        if abs(count - own) > NEARLY_THE_SAME * own
    ]
    known = options.shots, options.criterion
    fewer = sample_size.design_curve(*known, [each for each in counts if each < own], rng)
    more = sample_size.design_curve(*known, [each for each in counts if each > own], rng, chosen)
    free = options.request.free
    units = options.region.kinematics.mechanism.parameters.units(free)
    for rows in (*(each.chosen for each in fewer), chosen, *(each.chosen for each in more)):
        matrix = information.covariance(options.shots.jacobian(rows))[: len(free), : len(free)]
        yield len(rows), information.Uncertainty.of(free, units, matrix, source="predicted")


def _next_up(length_mm: float) -> float:
    """Rounded up to two figures, so that it can be reached."""
    digit = 10.0 ** (math.floor(math.log10(length_mm)) - 1)
    return math.ceil(length_mm / digit) * digit


def _ordered(
    region: pose_sampling.FeasibleRegion,
    chosen: Array,
    unseen: list[PlannedShot],
    wanted: plans.PlanRequest,
) -> tuple[PlannedShot, ...]:
    """Shots of all pairs in one tour, so that slow effects meet them alike, drift shots in it."""
    kinematics, fitted = region.kinematics, len(chosen)
    start = kinematics.inverse(region.centre[None]).values_or_raise()[0]
    turned = kinematics.comparable(start)
    poses = np.vstack([chosen, plans.poses_of(unseen).reshape(-1, len(region.centre))])
    joints = kinematics.inverse(poses).values_or_raise()
    turns = kinematics.comparable(joints)
    near = neighbouring_pairs(turns[:fitted], poses[:fitted, :3], turned)
    pairs = np.vstack([near, np.arange(fitted, len(poses)).reshape(-1, 2)])
    within = plans.EVENLY if wanted.tells_backlash else BALANCED_SHARE
    tour = balance_approaches(turns, pairs, turned, np.arange(len(poses)) < fitted, within)
    drift = (region.centre, start)
    return plans.numbered_shots(tour, poses, joints, fitted, drift, wanted.drift_shots)
