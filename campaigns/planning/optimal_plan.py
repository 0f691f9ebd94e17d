"""Optimal plans: the identification shots that tell most, of thousands of candidates."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design import pose_sampling, sample_size
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import Criterion, CriterionName, make_criterion
from campaigns.design.exchange import (
    EXCHANGE_REGULARISATION,
    Unobservable,
    choose_beside,
    covariance_of,
    exchanged_starts,
)
from campaigns.design.refinement import known_places, refine
from campaigns.design.tours import BALANCED_SHARE, balance_approaches, neighbouring_pairs
from campaigns.errors import PlanInvalid
from campaigns.estimation import information, tracker_noise
from campaigns.estimation.estimators import Estimator
from campaigns.planning import plans
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.predicted_uncertainty import not_identifiable
from campaigns.robots.robot import RobotFile
from campaigns.shots.shot_sets import ShotSet

CANDIDATES = 4000
WORKSPACE_SAMPLE = 1000
"""Number of poses, drawn for each plan, at which positions are to be known best."""
MOST_SHOTS = 1000
GOAL_ROUNDS = 4
"""Rounds for a goal by distances, whose common variance is known when they are chosen."""
CURVE_REACH = 2
"""The curve goes on to so many times the plan's shots, and to twice that of the fewest."""
NEARLY_THE_SAME = 0.15
"""Part of the plan's own number of shots by which other numbers stay off it."""
ROUNDS, ROUNDS_AFTER, ROUNDS_LAST = 10, 6, 20
"""Of refinement: of each start, of the best one after shots were replaced, and of what is kept."""
REPLACED, REPLACED_AMONG = 3, 600
"""Measurements that are replaced at once, for so many candidates drawn anew each time."""
REPLACEMENTS = 2
"""So many for each start beyond the first: small designs end in local optima more often."""
MEASUREMENTS_MOVED = 1800
"""In the last rounds at most: more of them tell little more of a large design."""
PAIRINGS = 6
"""Number of pairings of the candidate poses: so many pairs have as many rows as the shots."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimalRequest:
    """Request for an optimal plan: what it holds, and what its shots shall be best for."""

    plan: plans.PlanRequest
    uncertainty: tracker_noise.TrackerUncertainty
    free: tuple[str, ...]
    """Names of the parameters that will be identified."""
    estimator: Estimator = Estimator.POINTS
    criterion: CriterionName = "I"
    until_mm: float | None = None
    """σ that no length shall exceed, with as few shots as that takes; `plan` says the most."""
    candidates: int = CANDIDATES


@dataclass(frozen=True, slots=True, eq=False)
class CandidateSet:
    """Candidate poses (N, t) of a region, and measurements made of them."""

    region: pose_sampling.FeasibleRegion
    request: OptimalRequest
    poses: Array
    ends: Index
    """Rows of the poses of each measurement: one for a shot, two for a pair, (M, 1 or 2)."""
    candidates: Candidates
    workspace: Array
    """Jacobian of the positions that are judged, (K, 3, P)."""
    variance_mm2: Array | None = None
    """Variance of each distance, (M,)."""
    common_mm2: float | None = None
    """Variance that the candidates take all distances to have."""

    def variance_ratio(self, rows: Index) -> float:
        """σ of chosen measurements by their own pooled variance, over that by the common one."""
        if self.variance_mm2 is None or self.common_mm2 is None:
            return 1.0
        chosen = tracker_noise.pooled_variance_mm2(self.variance_mm2[rows])
        return math.sqrt(chosen / self.common_mm2)

    @property
    def poses_each(self) -> int:
        """Number of poses that a measurement takes."""
        return int(self.ends.shape[1])

    @property
    def step(self) -> int:
        """Measurements of two shots: plans hold whole pairs."""
        return 2 // self.poses_each

    @property
    def criterion(self) -> Criterion:
        """Criterion that is asked for, of these candidates."""
        return make_criterion(self.request.criterion, self.candidates, self.workspace)

    @property
    def value(self) -> float:
        """Value of the criterion if all of it is measured."""
        found = covariance_of(self.candidates, self.candidates.jacobians, EXCHANGE_REGULARISATION)
        return self.criterion.value(found)

    def refined(
        self, options: "CandidateSet", rounds: int, rng: np.random.Generator
    ) -> "CandidateSet":
        """All of it, exchanged for candidates and moved to where it tells more than any of them."""

        def seen(poses: Array) -> Array:
            jacobians, _ = _measured(self.region, self.request, poses, self.common_mm2)
            return jacobians / self.candidates.scale

        start, others = self.poses[self.ends], options.poses[options.ends]
        known = options.candidates, others, self.criterion
        return self._at(refine(start, self.region, seen, *known, rounds, rng))

    def replaced(self, options: "CandidateSet", rng: np.random.Generator) -> "CandidateSet":
        """All of it but a few, drawn at random, for which others are chosen beside the rest."""
        kept = self.only(rng.permutation(len(self.candidates))[REPLACED:])
        held, others = kept.poses[kept.ends], options.poses[options.ends]
        some = rng.permutation(len(others))[:REPLACED_AMONG]
        some = some[~known_places(others[some], held)]
        few = replace(options.candidates, jacobians=options.candidates.jacobians[some])
        known = covariance_of(few, kept.candidates.jacobians, EXCHANGE_REGULARISATION)
        known = known / np.outer(few.scale, few.scale)
        added = choose_beside(few, options.criterion, known, REPLACED)
        return self._at(np.concatenate([held, others[some[added]]]))

    def only(self, rows: Index) -> "CandidateSet":
        """Chosen measurements (N,) alone, where they are."""
        return self._at(self.poses[self.ends[rows]])

    def together_with(self, other: "CandidateSet") -> "CandidateSet":
        """All of it and of another, by the same unknowns, the other's behind."""
        both = np.concatenate([self.candidates.jacobians, other.candidates.jacobians])
        own, more = self.variance_mm2, other.variance_mm2
        return replace(
            self,
            poses=np.vstack([self.poses, other.poses]),
            ends=np.vstack([self.ends, len(self.poses) + other.ends]),
            candidates=replace(self.candidates, jacobians=both),
            variance_mm2=None if own is None or more is None else np.concatenate([own, more]),
        )

    def _at(self, poses: Array) -> "CandidateSet":
        """Measurements at poses (N, 1 or 2, t), by the same unknowns."""
        jacobians, variance = _measured(self.region, self.request, poses, self.common_mm2)
        return replace(
            self,
            poses=poses.reshape(-1, poses.shape[-1]),
            ends=np.arange(poses[..., 0].size).reshape(poses.shape[:2]),
            candidates=replace(self.candidates, jacobians=jacobians / self.candidates.scale),
            variance_mm2=variance,
        )

    @property
    def worst_length_mm(self) -> float:
        """σ of the length that is known worst if all of it is measured."""
        rows = np.arange(len(self.candidates))
        found = sample_size.evaluate(self.candidates, rows)
        return found.worst_length_mm * self.variance_ratio(rows)


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
    there = region.kinematics.inverse(workspace).values_or_raise()
    judged_at = information.point_jacobian(region.kinematics, request.free, there, workspace)
    space, by_points = region.kinematics.mechanism.parameters, request.estimator == Estimator.POINTS
    ends = np.arange(len(poses))[:, None] if by_points else _many_pairs(poses, rng)
    seen, variance = _measured(region, request, poses[ends])
    is_length = ~space.is_angle[space.places(request.free)]
    found = Candidates.from_jacobians(seen, request.free, is_length)
    if variance is None:
        return CandidateSet(region, request, poses, ends, found, judged_at)
    judged_at = information.marginalise_frame(judged_at)
    common = tracker_noise.pooled_variance_mm2(variance)
    return CandidateSet(region, request, poses, ends, found, judged_at, variance, common)


def _measured(
    region: pose_sampling.FeasibleRegion,
    request: OptimalRequest,
    poses: Array,
    common_mm2: float | None = None,
) -> tuple[Array, Array | None]:
    """Whitened Jacobians (M, k, P) of measurements at poses (M, 1 or 2, t), by mm and rad.

    And the variances of distances, (M,), which are whitened by a common one: the pooled one, unless
    another is given.
    """
    kinematics, each = region.kinematics, poses.shape[1]
    flat = poses.reshape(-1, poses.shape[-1])
    joints = kinematics.inverse(flat).values_or_raise()
    noise = tracker_noise.point_covariance_mm2(
        flat[:, :3] - region.view_from_mm, request.uncertainty
    )
    if each == 1:
        at = information.point_jacobian(kinematics, request.free, joints, flat)
        return information.whitened(at, noise), None
    pairs = np.arange(len(flat)).reshape(-1, each)
    variance = tracker_noise.distance_variance_mm2(flat[:, :3], noise, pairs[:, 0], pairs[:, 1])
    apart = information.distance_jacobian(kinematics, request.free, joints, flat, pairs)
    std = math.sqrt(common_mm2 or tracker_noise.pooled_variance_mm2(variance))
    return apart[:, None, :] / std, variance


def _many_pairs(poses: Array, rng: np.random.Generator) -> Index:
    """Different pairs of rows of poses, (M, 2)."""
    pairs = np.vstack([pose_sampling.random_pairs(poses, rng) for _ in range(PAIRINGS)])
    return np.unique(np.sort(pairs, axis=1), axis=0)


def make_optimal_plan(
    robot: RobotFile, view: plans.View, request: OptimalRequest, rng: np.random.Generator
) -> tuple[tuple[PlannedShot, ...], tuple[tuple[int, information.Uncertainty], ...]]:
    """Identification shots by optimal design; validation pairs and drift shots as in every plan.

    Then other numbers of shots and what they would give, this plan's own among them.
    Raises `PlanInvalid` when too little of the workspace can be measured, the goal is out of reach,
    there are too few candidates or shots, or the free parameters cannot be told apart.
    """
    wanted = request.plan
    others = plans.make_plan(robot, view, replace(wanted, identification_shots=0), rng)
    unseen = [shot for shot in others if shot.purpose is ShotSet.VALIDATION]
    region = plans.requested_region(robot, view, wanted)
    try:
        options = draw_candidates(region, request, rng)
        _check_shots(options, request)
        chosen = choose_measurements(options, request, rng)
        curve = tuple(_curve(options, chosen, rng))
    except pose_sampling.WorkspaceTooSmall as error:
        raise plans.too_small(error, region, "candidates") from error
    except Unobservable as error:
        raise not_identifiable(error) from error
    return _ordered(chosen, unseen, wanted), curve


def _check_shots(options: CandidateSet, request: OptimalRequest) -> None:
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
            remedy="ask for more shots, or fix parameters with --fix",
        )


def _fewest_shots(options: CandidateSet) -> int:
    """An even number; raises `Unobservable`."""
    return sample_size.minimum_count(options.candidates, options.step) * options.poses_each


def choose_measurements(
    options: CandidateSet, request: OptimalRequest, rng: np.random.Generator
) -> CandidateSet:
    """The best measurements, refined beyond the candidates.

    Raises `PlanInvalid` for a goal that is out of reach, `ValueError` and `Unobservable`.
    """
    if request.until_mm is not None:
        rows = _fewest_measurements(options, request.until_mm, rng)
        return _fewest_refined(options, rows, request.until_mm, rng)
    count = request.plan.identification_shots // options.poses_each
    starts = exchanged_starts(options.candidates, options.criterion, count, rng)
    refined = [options.only(each.chosen).refined(options, ROUNDS, rng) for each in starts]
    best = min(refined, key=lambda each: each.value)
    for _ in range(REPLACEMENTS * (len(starts) - 1)):
        other = best.replaced(options, rng).refined(options, ROUNDS_AFTER, rng)
        best = min(best, other, key=lambda each: each.value)
    return best.refined(options, max(1, min(ROUNDS_LAST, MEASUREMENTS_MOVED // count)), rng)


def _fewest_refined(
    options: CandidateSet, rows: Index, until_mm: float, rng: np.random.Generator
) -> CandidateSet:
    """The fewest measurements that meet a goal once refined, no more than those that do as chosen.

    By halving: refined measurements tell more, so fewer of them may do.
    """
    best, count = options.only(rows), len(rows)
    too_few = max(sample_size.minimum_count(options.candidates, options.step), count // 2)
    too_few -= too_few % options.step + options.step
    tried = count
    while tried > too_few:
        if tried != len(rows):
            starts = exchanged_starts(options.candidates, options.criterion, tried, rng)
            rows = starts[0].chosen
        moved = options.only(rows).refined(options, ROUNDS, rng)
        # a criterion may fall while the worst length's σ rises
        if moved.worst_length_mm <= until_mm:
            best, count = moved, tried
        elif tried == count:
            return best
        else:
            too_few = tried
        tried = (too_few + count) // 2 // options.step * options.step
    return best


def _fewest_measurements(options: CandidateSet, until_mm: float, rng: np.random.Generator) -> Index:
    """Rows (N,) of as few measurements as meet a goal for the lengths; raises `PlanInvalid`."""
    count = options.request.plan.identification_shots // options.poses_each
    most = min(count, len(options.candidates) // options.step * options.step)
    goal_mm = until_mm
    try:
        for _ in range(GOAL_ROUNDS):
            design = sample_size.minimal_design(
                options.candidates, options.criterion, goal_mm, most, options.step, rng
            )
            found_mm = design.worst_length_mm * options.variance_ratio(design.chosen)
            if found_mm <= until_mm:
                break
            goal_mm *= until_mm / found_mm
    except sample_size.GoalOutOfReach as error:
        raise _out_of_reach(error, until_mm, options.poses_each) from error
    return design.chosen


def _out_of_reach(
    error: sample_size.GoalOutOfReach, goal_mm: float, poses_each: int
) -> PlanInvalid:
    best_mm = error.best.worst_length_mm
    return PlanInvalid(
        f"goal σ={goal_mm:g} mm is out of reach: {error.best.count * poses_each} shots, the most "
        f"allowed, leave ±{best_mm:.4f} mm for the worst length",
        remedy=f"ask for σ={_next_up(best_mm):g} or more, allow more --shots or --candidates, "
        "or place the tracker nearer",
    )


def _curve(
    options: CandidateSet, chosen: CandidateSet, rng: np.random.Generator
) -> Iterator[tuple[int, information.Uncertainty]]:
    """What other numbers of measurements would give, the chosen ones among them.

    Fewer ones are chosen among those too, more are added to them: all are refined alike.
    """
    own = len(chosen.candidates)
    fewest = sample_size.minimum_count(options.candidates, options.step)
    reach = min(CURVE_REACH * max(own, 2 * fewest), len(options.candidates))
    counts = [
        count
        for count in sample_size.curve_counts(fewest, reach, options.step)
        if abs(count - own) > NEARLY_THE_SAME * own
    ]
    together, here = options.together_with(chosen), len(options.candidates) + np.arange(own)
    known = together.candidates, options.criterion
    fewer = sample_size.design_curve(*known, [each for each in counts if each < own], rng)
    more = sample_size.design_curve(*known, [each for each in counts if each > own], rng, here)
    free = options.request.free
    units = options.region.kinematics.mechanism.parameters.units(free)
    for rows in (*(each.chosen for each in fewer), here, *(each.chosen for each in more)):
        jacobian = together.candidates.jacobian(rows)
        matrix = information.covariance(jacobian)[: len(free), : len(free)]
        shots, ratio = len(rows) * options.poses_each, together.variance_ratio(rows)
        found = information.Uncertainty.of(free, units, matrix * ratio**2, source="predicted")
        yield shots, found


def _next_up(length_mm: float) -> float:
    """Rounded up to two figures, so that it can be reached."""
    digit = 10.0 ** (math.floor(math.log10(length_mm)) - 1)
    return math.ceil(length_mm / digit) * digit


def _ordered(
    chosen: CandidateSet, unseen: list[PlannedShot], wanted: plans.PlanRequest
) -> tuple[PlannedShot, ...]:
    """Shots of all pairs in one tour, so that slow effects meet them alike, drift shots in it."""
    region, kinematics = chosen.region, chosen.region.kinematics
    start = kinematics.inverse(region.centre[None]).values_or_raise()[0]
    fitted, turned = len(chosen.poses), kinematics.comparable(start)
    poses = np.vstack([chosen.poses, plans.poses_of(unseen).reshape(-1, len(region.centre))])
    joints = kinematics.inverse(poses).values_or_raise()
    turns = kinematics.comparable(joints)
    pairs = np.arange(len(poses)).reshape(-1, 2)
    if chosen.poses_each == 1:
        near = neighbouring_pairs(turns[:fitted], poses[:fitted, :3], turned)
        pairs = np.vstack([near, pairs[fitted // 2 :]])
    within = plans.EVENLY if wanted.tells_backlash else BALANCED_SHARE
    tour = balance_approaches(turns, pairs, turned, np.arange(len(poses)) < fitted, within)
    drift = (region.centre, start)
    return plans.numbered_shots(tour, poses, joints, fitted, drift, wanted.drift_shots)
