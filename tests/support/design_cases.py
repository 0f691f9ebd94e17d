"""Candidates that the tests of optimal plans share."""

from dataclasses import dataclass

import numpy as np
from par4_cases import NOMINAL, TRACKER_STD_MM, region
from par4_space import SPACE

from campaigns.arrays import Array
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import Criterion
from campaigns.design.pose_sampling import boundary_poses, interior_poses
from campaigns.estimation.information import point_jacobian, whitened

VARIANCE_MM2 = TRACKER_STD_MM**2


@dataclass(frozen=True)
class Case:
    poses: Array
    joints: Array
    candidates: Candidates
    workspace: Array
    workspace_rows: Array

    @property
    def criterion(self) -> Criterion:
        return Criterion.of(self.candidates, self.workspace_rows)


def rows_at(poses, free=SPACE.free_by_default):
    return point_jacobian(NOMINAL, free, NOMINAL.inverse(poses).values_or_raise(), poses)


def isotropic(count):
    return np.broadcast_to(VARIANCE_MM2 * np.eye(3), (count, 3, 3))


def drawn(count, seed):
    """Poses all over the workspace and near its boundary, and a sample of the workspace."""
    rng, place = np.random.default_rng(seed), region()
    half = count // 2
    poses = np.vstack([interior_poses(place, half, rng), boundary_poses(place, half, rng)])
    return poses, interior_poses(place, 500, rng)


def shots(count=600, seed=1, free=SPACE.free_by_default, noise=None):
    poses, workspace = drawn(count, seed)
    joints = NOMINAL.inverse(poses).values_or_raise()
    noise = isotropic(count) if noise is None else noise
    candidates = shot_candidates(free, joints, poses, noise)
    return Case(poses, joints, candidates, workspace, rows_at(workspace, free))


def shot_candidates(free, joints, poses, noise):
    seen = whitened(point_jacobian(NOMINAL, free, joints, poses), noise)
    return Candidates.from_jacobians(seen, free, ~SPACE.is_angle[SPACE.places(free)])


def anything(count, k, unknowns, seed, parameters=None):
    """Candidates that belong to no robot."""
    rows = np.random.default_rng(seed).standard_normal((count, k, unknowns))
    own = unknowns if parameters is None else parameters
    return Candidates.from_jacobians(
        rows, tuple(f"p{i}_mm" for i in range(own)), np.ones(own, dtype=bool)
    )
