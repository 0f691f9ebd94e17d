"""Where to measure: poses near the workspace's boundary (the paper's recipe), poses inside it, pairs and their order."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.reach import Limits, reach

FURTHER = 1.05
"""A pose is near the boundary when it cannot be taken this much further from the centre."""
BATCH = 4000
BATCHES = 200
BOX_HALF = np.array([700.0, 700.0, 700.0, np.pi / 4])
"""Half size of a box about the centre that surely holds the workspace, mm and rad."""
SHORTEST_PAIR_MM = 100.0
SWAPS_PER_PAIR = 40


class WorkspaceTooSmall(ValueError):  # noqa: N818 - named by what it says
    """Too few feasible poses were found for what was asked."""


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """Where poses may be placed: the robot's reach and whatever else is asked of a pose."""

    geometry: Geometry
    limits: Limits
    centre: Array
    """A feasible pose well inside, (4,)."""
    view_from_mm: Array
    """The tracker's place in the base frame, (3,)."""
    reflector_facing: Array
    """Direction of the reflector's axis in the base frame, unit length, (3,)."""
    acceptance_rad: float

    def allows(self, poses: Array) -> NDArray[np.bool_]:
        """Which poses can be taken and seen, (N,)."""
        seen = (
            incidence_rad(poses[:, :3], self.view_from_mm, self.reflector_facing)
            <= self.acceptance_rad
        )
        return np.asarray(reach(self.geometry, self.limits, poses).feasible & seen)


def incidence_rad(points_mm: Array, tracker_mm: Array, facing: Array) -> Array:
    """Angle between a reflector's axis and the beam, at points (N, 3) in the base frame, (N,)."""
    beam = tracker_mm - points_mm
    return np.asarray(np.arccos(np.clip(beam @ facing / np.linalg.norm(beam, axis=1), -1.0, 1.0)))


def boundary_poses(region: Region, count: int, rng: np.random.Generator) -> Array:
    """Poses that could not be taken 5 % further from the centre, (count, 4).

    Raises `WorkspaceTooSmall`.
    """

    def near_the_boundary(poses: Array) -> NDArray[np.bool_]:
        near = region.allows(poses)
        further = region.centre + FURTHER * (poses[near] - region.centre)
        near[near] = ~region.allows(further)
        return near

    return _drawn(region, count, rng, near_the_boundary)


def inner_poses(region: Region, count: int, rng: np.random.Generator) -> Array:
    """Poses spread evenly over the whole workspace, (count, 4). Raises `WorkspaceTooSmall`."""
    return _drawn(region, count, rng, region.allows)


def _drawn(
    region: Region,
    count: int,
    rng: np.random.Generator,
    wanted: Callable[[Array], NDArray[np.bool_]],
) -> Array:
    """Even draws from a box about the centre, until enough of them are wanted."""
    found = np.empty((0, 4))
    for _ in range(BATCHES):
        poses = region.centre + rng.uniform(-1.0, 1.0, (BATCH, 4)) * BOX_HALF
        found = np.vstack([found, poses[wanted(poses)]])
        if len(found) >= count:
            return found[:count]
    raise WorkspaceTooSmall(
        f"{len(found)} of {BATCHES * BATCH} poses tried can be taken, {count} needed"
    )


def pair_up(poses: Array, rng: np.random.Generator) -> NDArray[np.intp]:
    """Random pairs (N/2, 2) of rows of poses (N, 4), swapped until none is shorter than 100 mm."""
    pairs = rng.permutation(len(poses) - len(poses) % 2).reshape(-1, 2)
    for row in range(len(pairs)):
        for _ in range(SWAPS_PER_PAIR):
            if _length_mm(poses, pairs[row]) >= SHORTEST_PAIR_MM:
                break
            other = int(rng.integers(len(pairs)))
            pairs[row, 1], pairs[other, 1] = pairs[other, 1], pairs[row, 1]
    return pairs


def _length_mm(poses: Array, pair: NDArray[np.intp]) -> float:
    return float(np.linalg.norm(poses[pair[1], :3] - poses[pair[0], :3]))


def order_pairs(joints_rad: Array, pairs: NDArray[np.intp], start_rad: Array) -> NDArray[np.intp]:
    """The same pairs (M, 2) in an order, and each in a sense, that keeps the joints' travel short.

    Nearest neighbour from `start_rad`, then reversal of stretches (2-opt) while that helps. A stretch
    reversed turns its pairs round too, so only the two joins change.
    """
    ends = _two_opt(_nearest_neighbour(joints_rad, pairs, start_rad), joints_rad, start_rad)
    return ends.reshape(-1, 2)


def travel_rad(from_rad: Array, to_rad: Array) -> Array:
    """What a coordinated joint move takes time for: the largest joint's way."""
    return np.asarray(np.abs(to_rad - from_rad).max(axis=-1))


def _nearest_neighbour(joints: Array, pairs: NDArray[np.intp], start: Array) -> NDArray[np.intp]:
    left, here, ordered = list(range(len(pairs))), start, []
    while left:
        to_ends = travel_rad(here, joints[pairs[left]])
        place, end = np.unravel_index(int(np.argmin(to_ends)), to_ends.shape)
        pair = pairs[left.pop(int(place))]
        ordered.append(pair if end == 0 else pair[::-1])
        here = joints[ordered[-1][1]]
    return np.array(ordered, dtype=np.intp).reshape(-1, 2)


def _two_opt(pairs: NDArray[np.intp], joints: Array, start: Array) -> NDArray[np.intp]:
    count = len(pairs)
    improved = True
    while improved:
        improved = False
        for i in range(count - 1):
            before = joints[pairs[i - 1, 1]] if i else start
            last = np.arange(i + 1, count)
            after = joints[pairs[np.minimum(last + 1, count - 1), 0]]
            closing = (last < count - 1).astype(float)
            old = travel_rad(before, joints[pairs[i, 0]]) + closing * travel_rad(
                joints[pairs[last, 1]], after
            )
            new = travel_rad(before, joints[pairs[last, 1]]) + closing * travel_rad(
                joints[pairs[i, 0]], after
            )
            gain = old - new
            best = int(np.argmax(gain))
            if gain[best] > 1e-9:
                j = int(last[best])
                pairs[i : j + 1] = pairs[i : j + 1][::-1, ::-1]
                improved = True
    return pairs
