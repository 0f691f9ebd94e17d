"""Further shots: the few that tell most beside what is known of a robot already."""

from collections.abc import Callable

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design import pose_sampling
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import CriterionName, make_criterion
from campaigns.design.exchange import choose_beside, exchange_in_turn
from campaigns.estimation import information, tracker_noise
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import too_small
from campaigns.robots.robot import pose_of
from campaigns.shots.shot_sets import ShotSet

CANDIDATES = 600
WORKSPACE_SAMPLE = 200
ExchangedBy = Callable[[Array, Array, Array], Callable[[Index], Array]]
FRAME_STD = np.array([0.1] * 3 + [100.0] * 3)
"""Of the tracker's frame before the first shot, rad and mm: nothing is known of it."""


def further_shots(
    region: pose_sampling.FeasibleRegion,
    free: tuple[str, ...],
    known: Array,
    instrument: tracker_noise.TrackerUncertainty,
    criterion: CriterionName,
    count: int,
    rng: np.random.Generator,
    exchanged_by: ExchangedBy | None = None,
) -> tuple[PlannedShot, ...]:
    """So many shots with a frame of their own beside a known covariance (F, F), mm and rad.

    By the region's kinematics. `exchanged_by` gives of candidates' joints, poses and covariances
    what exchanged shots shall make small. Raises `PlanInvalid` where too little can be measured.
    """
    half = CANDIDATES // 2
    try:
        inner = pose_sampling.interior_poses(region, half, rng)
        poses = np.vstack([inner, pose_sampling.boundary_poses(region, half, rng)])
        workspace = pose_sampling.workspace_poses(
            region.kinematics, region.limits, region.centre, WORKSPACE_SAMPLE, rng, region.space
        )
    except pose_sampling.WorkspaceTooSmall as error:
        raise too_small(error, region, "shots") from error

    def jacobian(at: Array) -> Array:
        joints = region.kinematics.inverse(at).values_or_raise()
        return information.point_jacobian(region.kinematics, free, joints, at)

    noise = tracker_noise.point_covariance_mm2(poses[:, :3] - region.view_from_mm, instrument)
    space, seen = (
        region.kinematics.mechanism.parameters,
        information.whitened(jacobian(poses), noise),
    )
    candidates = Candidates.from_jacobians(seen, free, ~space.is_angle[space.places(free)])
    of_all = np.diag(np.append(np.zeros(len(free)), FRAME_STD**2))
    of_all[:-FRAME_COLUMNS, :-FRAME_COLUMNS] = known
    judged = information.marginalise_frame(jacobian(workspace))
    at = np.concatenate([judged, np.zeros((len(judged), 3, FRAME_COLUMNS))], axis=2)
    chosen = choose_beside(candidates, make_criterion(criterion, candidates, at), of_all, count)
    joints = region.kinematics.inverse(poses).values_or_raise()
    if exchanged_by is not None:
        chosen = exchange_in_turn(exchanged_by(joints, poses, noise), chosen, len(poses))
    return tuple(
        PlannedShot(number, ShotSet.CHECK, None, pose_of(pose), tuple(own.tolist()))
        for number, (pose, own) in enumerate(zip(poses[chosen], joints[chosen], strict=True))
    )
