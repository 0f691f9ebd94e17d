"""What can be chosen from for an optimal plan: thousands of candidates, as shots or as pairs."""

import math
from dataclasses import dataclass

import numpy as np

from campaigns.estimators import Estimator
from campaigns.numerics.candidates import (
    Candidates,
    pair_candidates,
    shot_candidates,
    without_frame,
)
from campaigns.numerics.criteria import Criterion, CriterionName, make_criterion
from campaigns.numerics.geometry import FREE_BY_DEFAULT, Array, Index
from campaigns.numerics.instrument import (
    TrackerUncertainty,
    common_variance_mm2,
    distance_variance_mm2,
    point_covariance_mm2,
)
from campaigns.numerics.par4 import inverse
from campaigns.numerics.placement import (
    Region,
    boundary_poses,
    inner_poses,
    pair_up,
    workspace_poses,
)
from campaigns.planning.foresight import WORKSPACE_SAMPLE, rows_at
from campaigns.planning.plans import PlanRequest

CANDIDATES = 4000
PAIRINGS = 6
"""How often the candidate poses are paired anew: so many pairs have as many rows as the shots."""


@dataclass(frozen=True, slots=True)
class OptimalRequest:
    """What the shots shall be best for."""

    plan: PlanRequest
    uncertainty: TrackerUncertainty
    estimator: Estimator = Estimator.POINTS
    criterion: CriterionName = "I"
    free: tuple[str, ...] = FREE_BY_DEFAULT
    until_mm: float | None = None
    """σ that no length shall exceed, with as few shots as that takes; `plan` says the most."""
    candidates: int = CANDIDATES


@dataclass(frozen=True, slots=True, eq=False)
class Options:
    """What can be chosen from: poses and joints (N, 4), and measurements made of them."""

    poses: Array
    joints_rad: Array
    ends: Index
    """Rows of the poses of each measurement: one for a shot, two for a pair, (M, 1 or 2)."""
    candidates: Candidates
    workspace_rows: Array
    variance_mm2: Array | None = None
    """Of each distance, (M,); the candidates take them all as the common one."""

    def underrated(self, rows: Index) -> float:
        """How much larger the σ of chosen measurements are than by the common variance of all."""
        if self.variance_mm2 is None:
            return 1.0
        chosen = common_variance_mm2(self.variance_mm2[rows])
        return math.sqrt(chosen / common_variance_mm2(self.variance_mm2))

    @property
    def poses_each(self) -> int:
        """How many poses a measurement takes."""
        return int(self.ends.shape[1])

    @property
    def step(self) -> int:
        """Measurements of two shots: plans hold whole pairs."""
        return 2 // self.poses_each

    def criterion(self, name: CriterionName) -> Criterion:
        """Of that name, for these candidates."""
        return make_criterion(name, self.candidates, self.workspace_rows)


def draw_options(region: Region, request: OptimalRequest, rng: np.random.Generator) -> Options:
    """Candidates from all over the workspace and from its boundary, where most is to be learnt.

    Raises `WorkspaceTooSmall`.
    """
    near_boundary = request.candidates // 2
    inner = inner_poses(region, request.candidates - near_boundary, rng)
    poses = np.vstack([inner, boundary_poses(region, near_boundary, rng)])
    joints = inverse(region.geometry, poses).require()
    workspace = workspace_poses(
        region.geometry, region.limits, region.centre, WORKSPACE_SAMPLE, rng
    )
    judged_at = rows_at(region.geometry, request.free, workspace)
    noise = point_covariance_mm2(poses[:, :3] - region.view_from_mm, request.uncertainty)
    if request.estimator == Estimator.POINTS:
        shots = shot_candidates(region.geometry, request.free, joints, poses, noise)
        return Options(poses, joints, np.arange(len(poses))[:, None], shots, judged_at)
    pairs = _many_pairs(poses, rng)
    variance = distance_variance_mm2(poses[:, :3], noise, pairs[:, 0], pairs[:, 1])
    alike = np.full(len(pairs), common_variance_mm2(variance))
    distances = pair_candidates(region.geometry, request.free, joints, poses, pairs, alike)
    return Options(poses, joints, pairs, distances, without_frame(judged_at), variance)


def _many_pairs(poses: Array, rng: np.random.Generator) -> Index:
    """Different pairs of rows of poses, (M, 2)."""
    pairs = np.vstack([pair_up(poses, rng) for _ in range(PAIRINGS)])
    return np.unique(np.sort(pairs, axis=1), axis=0)
