"""Optimal plans: of thousands of candidate poses, those after which positions are known best."""

from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design import pose_sampling
from campaigns.design.pose_sampling import FeasibleRegion
from campaigns.design.tours import neighbouring_pairs
from campaigns.errors import PlanInvalid
from campaigns.fit.design import ShotDesign
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.planning import plans
from campaigns.planning.forecast import judged_positions, linearised_plan, prior_precision
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.robots.robot import RobotFile
from campaigns.shots.shot_sets import ShotSet

CANDIDATES = 2000
MOST_SHOTS = 1000
"""Shots of a plan with a goal, at most."""
MOST_EXCHANGED = 300
"""Shots up to which they are exchanged: more of them gain little by it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimalRequest:
    """Request for an optimal plan."""

    plan: plans.PlanRequest
    model: ErrorModel
    uncertainty: TrackerUncertainty
    until_mm: float | None = None
    """Mean 1 σ of positions to reach, with as few shots as that takes; `plan` says the most."""


def make_optimal_plan(
    robot: RobotFile, view: plans.View, request: OptimalRequest, rng: np.random.Generator
) -> tuple[PlannedShot, ...]:
    """Choose identification shots by optimal design; others are as in every plan.

    1. Place validation pairs. 2. Draw candidates, half of them near the boundary. 3. Choose the
    shots after which positions all over the workspace are known best. 4. Pair neighbours, and put
    all pairs into one tour. Raise `PlanInvalid` if too little of the workspace can be measured, the
    goal is out of reach, or there are too few candidates.
    """
    wanted = request.plan
    others = plans.make_plan(robot, view, replace(wanted, identification_shots=0), rng)
    unseen = plans.poses_of([shot for shot in others if shot.purpose is ShotSet.VALIDATION])
    region = plans.region_of(robot, view, wanted.centre, wanted.space)
    try:
        poses = candidates(region, max(CANDIDATES, 2 * wanted.identification_shots), rng)
    except pose_sampling.WorkspaceTooSmall as error:
        raise plans.too_small(error, region, "candidates") from error
    planner = RobotModel(robot.kinematics, robot.limits, region.centre, wanted.space)
    judged = judged_positions(request.model, planner, poses)
    chosen = poses[choose_shots(region, request, poses, judged)]
    kinematics = robot.kinematics
    turns = kinematics.comparable(kinematics.inverse(chosen).values_or_raise())
    start = kinematics.comparable(kinematics.inverse(region.centre[None]).values_or_raise()[0])
    pairs = np.vstack(
        [
            neighbouring_pairs(turns, chosen[:, :3], start),
            np.arange(len(chosen), len(chosen) + len(unseen)).reshape(-1, 2),
        ]
    )
    both = np.vstack([chosen, unseen.reshape(-1, len(region.centre))])
    return plans.ordered_shots(region, both, pairs, len(chosen), wanted.drift_shots)


def candidates(region: FeasibleRegion, count: int, rng: np.random.Generator) -> Array:
    """Draw candidate poses (M, t), half of them near the boundary of the workspace."""
    near_boundary = count // 2
    inner = pose_sampling.interior_poses(region, count - near_boundary, rng)
    return np.vstack([inner, pose_sampling.boundary_poses(region, near_boundary, rng)])


def choose_shots(
    region: FeasibleRegion, request: OptimalRequest, poses: Array, judged: Array
) -> Index:
    """Choose an even number of candidate poses (M, t) for the positions that are judged.

    Raise `PlanInvalid` for a goal that is out of reach.
    """
    design = _design(region, request, poses, judged)
    most, goal = request.plan.identification_shots, request.until_mm
    design.add_until(most, goal)
    if len(design.chosen) <= MOST_EXCHANGED:
        design.exchange()
    if goal is not None:
        if design.position_std_mm > goal:
            raise PlanInvalid(
                f"goal {goal:g} mm is out of reach: {most} shots, the most allowed, leave "
                f"positions ±{design.position_std_mm:.4f} mm",
                remedy=f"ask for {1.05 * design.position_std_mm:.2g} or more, allow more --shots, "
                "or place the tracker nearer",
            )
        if len(design.chosen) % 2:
            design.add_best()
    return np.array(design.chosen, dtype=np.intp)


def _design(
    region: FeasibleRegion, request: OptimalRequest, poses: Array, judged: Array
) -> ShotDesign:
    model, tracker_mm = request.model, region.view_from_mm
    joints = region.kinematics.inverse(poses).values_or_raise()
    at = linearised_plan(model, joints, poses, np.zeros_like(joints), tracker_mm)
    covariance = point_covariance_mm2(poses[:, :3] - tracker_mm, request.uncertainty)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), at.jacobian)
    rows = judged.reshape(-1, judged.shape[2])
    return ShotDesign(whitened, prior_precision(model), np.pad(rows, ((0, 0), (0, 6))))
