"""Samples of poses near the workspace's boundary or all over it, and pairs of poses.

Poses are drawn evenly from a box that holds the robot's reach, and kept where the robot can take
them, the tracker sees them, and the space allows them (rejection sampling). That is even over the
workspace whatever its shape, without an equation of its boundary. The density is even in x, y, z
and θ, not in joints.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.design.restricted_space import (
    UNRESTRICTED,
    Refusals,
    RestrictedSpace,
    count_refusals,
)
from campaigns.fit.rigid_transforms import distances_mm
from campaigns.kinematics.feasibility import Limits, search_extent
from campaigns.kinematics.model import Kinematics

BOUNDARY_STRETCH = 1.05
"""Factor of the distance from the centre at which a pose near the boundary can no longer be
taken."""
BATCH = 4000
BATCHES = 200
"""Batches tried for every 5 000 poses that are needed."""
SHORTEST_PAIR_MM = 100.0
WORKSPACE_POSES = 300
"""Number of poses that stand for the workspace where the uncertainty of positions is stated."""
WORKSPACE_SEED = 1
"""Seed of these poses: one sample for every plan, run and identification of a robot."""


class WorkspaceTooSmall(ValueError):
    """Workspace with fewer feasible poses than are needed."""


@dataclass(frozen=True, eq=False)
class FeasibleRegion:
    """Region where poses may be placed: the robot's reach, the tracker's view, and the space."""

    kinematics: Kinematics
    limits: Limits
    centre: Array
    """A feasible pose well inside, (t,)."""
    view_from_mm: Array
    """The tracker's place in the base frame, (3,)."""
    reflector_facing: Array
    """Direction of the reflector's axis in the middle of the workspace, unit length, (3,)."""
    acceptance_rad: float
    """Largest angle between the reflector's axis and the beam."""
    space: RestrictedSpace = UNRESTRICTED

    @property
    def extent(self) -> Array:
        """Half size (t,) of a box about the centre that holds the region."""
        mechanism, p = self.kinematics.mechanism, self.kinematics.p
        return search_extent(mechanism, p, self.limits, self.centre)

    def allows(self, poses: Array) -> Mask:
        """Return which poses can be taken, seen, and reached straight from the centre, (N,).

        So any two poses that are allowed in a space with obstacles are joined by way of the centre.
        """
        # the cheap test first: each next one judges only the poses that remain
        allowed = self.space.allows(poses[:, :3])
        allowed[allowed] = self.can_measure(poses[allowed])
        if self.space.has_obstacles:
            ends = poses[allowed, :3]
            starts = np.broadcast_to(self.centre[:3], ends.shape)
            allowed[allowed] = (self.space.line_clearance_mm(starts, ends) >= 0.0).all(axis=1)
        return allowed

    def can_measure(self, poses: Array) -> Mask:
        """Return which poses can be taken and seen, whatever the space allows, (N,)."""
        is_seen = self.incidence_rad(poses) <= self.acceptance_rad
        return np.asarray(self.kinematics.feasibility(self.limits, poses).feasible & is_seen)

    def incidence_rad(self, poses: Array) -> Array:
        """Return the angle of the beam to the reflector's axis at poses (N, t), (N,)."""
        facing = self.kinematics.mechanism.facing(poses, self.reflector_facing)
        return incidence_rad(poses[:, :3], self.view_from_mm, facing)

    def refusals(self, count: int, rng: np.random.Generator) -> Refusals:
        """Count the refusals by the space among `count` poses that can be taken and seen.

        Raise `WorkspaceTooSmall` if there are fewer.
        """
        poses = _rejection_sample(self.centre, self.extent, count, rng, self.can_measure)
        return count_refusals(self.space, poses[:, :3])


def incidence_rad(points_mm: Array, tracker_mm: Array, facing: Array) -> Array:
    """Return the angles (N,) between a reflector's axis and the beam at points (N, 3).

    `facing` is the axis at each point, (N, 3), or at all, (3,).
    """
    beam = tracker_mm - points_mm
    along = beam @ facing if facing.ndim == 1 else np.sum(beam * facing, axis=1)
    return np.asarray(np.arccos(np.clip(along / np.linalg.norm(beam, axis=1), -1.0, 1.0)))


def boundary_poses(region: FeasibleRegion, count: int, rng: np.random.Generator) -> Array:
    """Draw poses (count, t) that could not be taken 5 % further out (the paper's recipe).

    Raise `WorkspaceTooSmall` if there are fewer.
    """

    def is_near_boundary(poses: Array) -> Mask:
        is_near = region.allows(poses)
        stretched = region.centre + BOUNDARY_STRETCH * (poses[is_near] - region.centre)
        is_near[is_near] = ~region.allows(stretched)
        return is_near

    return _rejection_sample(region.centre, region.extent, count, rng, is_near_boundary)


def interior_poses(region: FeasibleRegion, count: int, rng: np.random.Generator) -> Array:
    """Draw poses (count, t) evenly from the region; raise `WorkspaceTooSmall` if it has fewer."""
    return _rejection_sample(region.centre, region.extent, count, rng, region.allows)


def workspace_poses(
    kinematics: Kinematics,
    limits: Limits,
    centre: Array,
    count: int,
    rng: np.random.Generator,
    space: RestrictedSpace = UNRESTRICTED,
) -> Array:
    """Draw poses (count, t) evenly from the robot's reach in its space, seen or not.

    Raise `WorkspaceTooSmall` if there are fewer.
    """
    extent = search_extent(kinematics.mechanism, kinematics.p, limits, centre)
    return _rejection_sample(centre, extent, count, rng, _within_reach(kinematics, limits, space))


def poses_at_level(
    kinematics: Kinematics,
    limits: Limits,
    centre: Array,
    count: int,
    rng: np.random.Generator,
    space: RestrictedSpace = UNRESTRICTED,
) -> Array:
    """Draw poses (count, t) evenly at the centre's level, turned as there, seen or not.

    Raise `WorkspaceTooSmall` if there are fewer.
    """
    extent = search_extent(kinematics.mechanism, kinematics.p, limits, centre)
    extent[2:] = 0.0
    return _rejection_sample(centre, extent, count, rng, _within_reach(kinematics, limits, space))


def _within_reach(
    kinematics: Kinematics, limits: Limits, space: RestrictedSpace
) -> Callable[[Array], Mask]:
    """Return the judgement of which poses (N, t) a robot can take in its space, (N,)."""

    def is_within_reach(poses: Array) -> Mask:
        allowed = space.allows(poses[:, :3])
        allowed[allowed] = kinematics.feasibility(limits, poses[allowed]).feasible
        return allowed

    return is_within_reach


def sample_workspace(
    kinematics: Kinematics, limits: Limits, centre: Array, space: RestrictedSpace = UNRESTRICTED
) -> Array | None:
    """Return the one sample (N, t) of a robot's workspace at which positions are judged.

    Plans, runs, identifications and studies use this sample, so that their figures compare. Return
    None where hardly a pose can be taken.
    """
    rng = np.random.default_rng(WORKSPACE_SEED)
    try:
        return workspace_poses(kinematics, limits, centre, WORKSPACE_POSES, rng, space)
    except WorkspaceTooSmall:
        return None


def _rejection_sample(
    centre: Array,
    extent: Array,
    count: int,
    rng: np.random.Generator,
    wanted: Callable[[Array], Mask],
) -> Array:
    """Draw evenly from a box about the centre, until `count` poses are wanted."""
    drawn, missing, batches = list[Array](), count, BATCHES * max(1, math.ceil(count / 5000))
    for _ in range(batches):
        poses = centre + rng.uniform(-1.0, 1.0, (BATCH, len(centre))) * extent
        drawn.append(poses[wanted(poses)])
        missing -= len(drawn[-1])
        if missing <= 0:
            return np.concatenate(drawn)[:count]
    raise WorkspaceTooSmall(
        f"{count - missing} of {batches * BATCH} poses tried can be taken, {count} needed"
    )


def random_pairs(poses: Array, rng: np.random.Generator) -> Index:
    """Pair rows of poses (N, t) at random, (N/2, 2).

    A pair shorter than 100 mm swaps an end with another pair, if there is one with which both
    become long enough. An odd pose is left over.
    """
    pairs = rng.permutation(len(poses) - len(poses) % 2).reshape(-1, 2)
    for row in np.flatnonzero(~_is_long_enough(poses, pairs[:, 0], pairs[:, 1])).tolist():
        first, second = pairs[row]
        # (first, second), (a, b) → (first, b), (a, second)
        swappable = np.flatnonzero(
            _is_long_enough(poses, first, pairs[:, 1]) & _is_long_enough(poses, pairs[:, 0], second)
        )
        if swappable.size:
            other = rng.choice(swappable)
            pairs[row, 1], pairs[other, 1] = pairs[other, 1], second
    return pairs


def _is_long_enough(poses: Array, first: Index, second: Index) -> Mask:
    """Return which pairs of rows are far enough apart, (M,)."""
    return np.asarray(distances_mm(poses[:, :3], first, second) >= SHORTEST_PAIR_MM)
