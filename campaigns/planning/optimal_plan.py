"""Optimal plans: of thousands of candidate poses, choose those that determine positions best.

What comes in: the robot, the tracker's place, and the error model that `identify` will fit. How a
shot counts is known before it is taken: its whitened derivatives by all unknowns follow from its
pose alone, and so does the covariance of the parameters after any set of shots.

1. Candidates: poses drawn at random, half all over the workspace, half near its boundary, where
   the paper takes all of its shots.
2. Criterion: the mean variance of positions over the whole workspace (I-optimality), not the
   parameters' own variances: single parameters may stay poorly determined where that moves no
   position.
3. Choice: greedy, then exchange (`campaigns.fit.design`); with a goal, until the goal is met.
4. Order: chosen poses are paired and put into one tour with validation pairs and drift shots.

Out comes a plan of the same kind as by the paper's recipe (`plans`): only its poses differ.
"""

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
"""Candidate poses, unless twice the number of shots is more."""
MOST_SHOTS = 1000
"""Largest number of shots of a plan with a goal."""
MOST_EXCHANGED = 300
"""Largest number of shots that are exchanged: larger sets gain little by exchange."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OptimalRequest:
    """Request for an optimal plan."""

    plan: plans.PlanRequest
    model: ErrorModel
    uncertainty: TrackerUncertainty
    until_mm: float | None = None
    """Mean 1 σ of positions to reach, at most with the shots of `plan`; None: take all of them."""


def make_optimal_plan(
    robot: RobotFile, view: plans.View, request: OptimalRequest, rng: np.random.Generator
) -> tuple[PlannedShot, ...]:
    """Choose identification shots by optimal design; other shots are as in every plan.

    Raise `PlanInvalid` if too little of the workspace can be measured, the goal is out of reach, or
    there are too few candidates.
    """
    plan_request = request.plan
    # 1. Validation pairs come from the ordinary plan: they shall be spread evenly, not optimal.
    without_fit = replace(plan_request, identification_shots=0)
    ordinary = plans.make_plan(robot, view, without_fit, rng)
    validation = plans.poses_of([s for s in ordinary if s.purpose is ShotSet.VALIDATION])
    # 2. Draw candidates, and linearise the positions by which a choice is judged.
    region = plans.region_of(robot, view, plan_request.centre, plan_request.space)
    try:
        poses = candidates(region, max(CANDIDATES, 2 * plan_request.identification_shots), rng)
    except pose_sampling.WorkspaceTooSmall as error:
        raise plans.too_small(error, region, "candidates") from error
    planner = RobotModel(robot.kinematics, robot.limits, region.centre, plan_request.space)
    judged = judged_positions(request.model, planner, poses)
    # 3. Choose among the candidates.
    chosen = poses[choose_shots(region, request, poses, judged)]
    # 4. Pair chosen poses that are near in joints; validation poses are in pairs already.
    kinematics = robot.kinematics
    turns = kinematics.comparable(kinematics.inverse(chosen).values_or_raise())
    start = kinematics.comparable(kinematics.inverse(region.centre[None]).values_or_raise()[0])
    chosen_pairs = neighbouring_pairs(turns, chosen[:, :3], start)
    validation_pairs = len(chosen) + np.arange(len(validation)).reshape(-1, 2)
    # 5. One tour of all pairs, so that slow effects meet both kinds equally.
    all_poses = np.vstack([chosen, validation.reshape(-1, len(region.centre))])
    pairs = np.vstack([chosen_pairs, validation_pairs])
    return plans.ordered_shots(region, all_poses, pairs, len(chosen), plan_request.drift_shots)


def candidates(region: FeasibleRegion, count: int, rng: np.random.Generator) -> Array:
    """Draw candidate poses (M, t), half of them near the boundary of the workspace."""
    near_boundary = count // 2
    inner = pose_sampling.interior_poses(region, count - near_boundary, rng)
    return np.vstack([inner, pose_sampling.boundary_poses(region, near_boundary, rng)])


def choose_shots(
    region: FeasibleRegion, request: OptimalRequest, poses: Array, judged: Array
) -> Index:
    """Choose an even number of candidate poses (M, t); return their rows.

    `judged` (N, 3, P) are the derivatives of the positions whose uncertainty is minimised. Raise
    `PlanInvalid` for a goal that is out of reach.
    """
    # The greedy choice decides how many shots there are; exchange keeps their number and lowers
    # the uncertainty a little further, so a goal that was met stays met.
    design = _design(region, request, poses, judged)
    most_shots, goal = request.plan.identification_shots, request.until_mm
    design.add_until(most_shots, goal)
    if len(design.chosen) <= MOST_EXCHANGED:
        design.exchange()
    if goal is not None:
        if design.position_std_mm > goal:
            raise PlanInvalid(
                f"goal {goal:g} mm is out of reach: {most_shots} shots, the most allowed, leave "
                f"positions ±{design.position_std_mm:.4f} mm",
                remedy=f"ask for {1.05 * design.position_std_mm:.2g} or more, allow more --shots, "
                "or place the tracker nearer",
            )
        # Shots are measured in pairs: users give even numbers, but a goal may end at an odd one.
        if len(design.chosen) % 2:
            design.add_best()
    return np.array(design.chosen, dtype=np.intp)


def _design(
    region: FeasibleRegion, request: OptimalRequest, poses: Array, judged: Array
) -> ShotDesign:
    """Return the empty design with candidates (M, t) and judged positions (N, 3, P)."""
    model, tracker_mm = request.model, region.view_from_mm
    joints = region.kinematics.inverse(poses).values_or_raise()
    # no approach direction: it depends on the order of shots, which is chosen later
    approach = np.zeros_like(joints)
    linearised = linearised_plan(model, joints, poses, approach, tracker_mm)
    # whitening: with the Cholesky factor L of a point's covariance, L⁻¹ J has noise of unit σ
    covariance = point_covariance_mm2(poses[:, :3] - tracker_mm, request.uncertainty)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), linearised.jacobian)
    # the six unknowns of the tracker's frame move no position in the base frame: zero columns
    judged_rows = np.pad(judged, ((0, 0), (0, 0), (0, 6)))
    return ShotDesign(whitened, prior_precision(model), judged_rows)
