"""Roadmap: positions all over the allowed workspace and straight lines between them.

It says which positions can be come to from the workspace's centre at all, and by which others: a
probabilistic roadmap's graph (Kavraki et al. 1996) on an even grid, the platform unturned.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
import scipy

from campaigns.arrays import Array, Index, Mask
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.mechanisms.mechanism import Kinematics, Limits

GRID = 24
"""Positions along each side of the box that holds the workspace."""
NEAREST = 12
"""Positions of the grid to which a point may be joined."""
NOWHERE = -9999
"""What SciPy says of a node without a predecessor."""
HALF_OF_NEIGHBOURS = tuple(step for step in product((-1, 0, 1), repeat=3) if step > (0, 0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class Roadmap:
    """Positions that the robot can take, all joined with the workspace's centre."""

    space: RestrictedSpace
    poses: Array
    """(M, t)"""
    lines: Index
    """Rows that a clear line joins, (K, 2)."""

    @classmethod
    def of(
        cls, kinematics: Kinematics, limits: Limits, space: RestrictedSpace, centre: Array
    ) -> "Roadmap":
        """Roadmap of the part of the workspace that holds the centre (t,)."""
        extent = kinematics.mechanism.search_extent(kinematics.p, limits, centre)[:3]
        low, high = space.bounds_mm()
        low, high = np.maximum(low, centre[:3] - extent), np.minimum(high, centre[:3] + extent)
        sides = [np.linspace(*ends, GRID) for ends in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
        poses = np.tile(centre, (GRID**3, 1))
        poses[:, :3] = grid.reshape(-1, 3)
        free = space.allows(poses)
        free[free] = kinematics.feasibility(limits, poses[free]).feasible
        every = cls(space, poses[free], _neighbours(free.reshape(grid.shape[:3])))
        clear = every.are_clear(*(every.poses[rows, :3] for rows in every.lines.T))
        return _around(cls(space, every.poses, every.lines[clear]), centre)

    def are_clear(self, starts: Array, ends: Array) -> Mask:
        """Mask (N,) of straight lines between points (N, 3) that cross no zone."""
        return np.asarray((self.space.line_clearance_mm(starts, ends) >= 0.0).all(axis=1))

    def connected(self, points: Array) -> Mask:
        """Mask (N,) of points (N, 3) from which a clear line leads to the roadmap."""
        rows, clear = self.near(points)
        return np.asarray(clear.any(axis=1)) if rows.size else np.zeros(len(points), dtype=bool)

    def way(
        self, start: Array, end: Array, blocked: frozenset[tuple[int, int]]
    ) -> tuple[int, ...] | None:
        """Shortest way between points (3,), as rows from start to end; None when there is none.

        The start is row M, the end M + 1. `blocked` lines, lower row first, are not taken.
        """
        rows, clear = self.near(np.stack([start, end]))
        first = len(self.poses)
        points = np.vstack([self.poses[:, :3], start, end])
        ends = [
            np.column_stack([rows[place, clear[place]], np.full(clear[place].sum(), first + place)])
            for place in range(2)
        ]
        lines = np.vstack([self.lines, *ends])
        if blocked:
            taken = np.isin(_keys(lines), _keys(np.array(sorted(blocked), dtype=np.intp)))
            lines = lines[~taken]
        graph = _graph(points, lines)
        _, before = scipy.sparse.csgraph.dijkstra(
            graph, directed=False, indices=first, return_predecessors=True
        )  # type: ignore[call-overload] # its stubs know no csr_array
        way = [first + 1]
        while way[-1] != first:
            if before[way[-1]] == NOWHERE:
                return None
            way.append(int(before[way[-1]]))
        return tuple(reversed(way))

    def near(self, points: Array) -> tuple[Index, Mask]:
        """Rows (N, k) near points (N, 3), and which of them a clear line leads to."""
        count = min(NEAREST, len(self.poses))
        if not count:
            return np.empty((len(points), 0), dtype=np.intp), np.empty((len(points), 0), dtype=bool)
        _, rows = scipy.spatial.cKDTree(self.poses[:, :3]).query(points, np.arange(1, count + 1))
        starts = np.repeat(points, count, axis=0)
        clear = self.are_clear(starts, self.poses[rows.ravel(), :3])
        return np.asarray(rows, dtype=np.intp), clear.reshape(rows.shape)


def _around(roadmap: Roadmap, centre: Array) -> Roadmap:
    """The part of it that a clear line joins with the centre (t,)."""
    (rows,), (clear,) = roadmap.near(centre[None, :3])
    graph = _graph(roadmap.poses[:, :3], roadmap.lines)
    _, parts = scipy.sparse.csgraph.connected_components(graph, directed=False)
    kept = np.isin(parts, parts[rows[clear]])
    numbers = np.cumsum(kept) - 1
    lines = roadmap.lines[kept[roadmap.lines].all(axis=1)]
    return Roadmap(roadmap.space, roadmap.poses[kept], numbers[lines])


def _neighbours(free: Mask) -> Index:
    """Pairs of rows of free places of a grid (A, B, C) that are neighbours, (K, 2)."""
    rows = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
    padded = np.pad(rows, 1, constant_values=-1)
    inner = slice(1, -1)
    pairs = []
    for step in HALF_OF_NEIGHBOURS:
        shifted = np.roll(padded, [-each for each in step], axis=(0, 1, 2))[inner, inner, inner]
        both = (rows >= 0) & (shifted >= 0)
        pairs.append(np.column_stack([rows[both], shifted[both]]))
    return np.vstack(pairs)


def _graph(points: Array, lines: Index) -> "scipy.sparse.csr_array":
    """Graph of lines (K, 2) between rows of points (M, 3), by length."""
    length = np.linalg.norm(points[lines[:, 0]] - points[lines[:, 1]], axis=1)
    return scipy.sparse.csr_array((length, lines.T), shape=(len(points), len(points)))


def _keys(lines: Index) -> Index:
    """One number (K,) for each line between rows, (K, 2), lower row first."""
    return np.asarray(lines.min(axis=1) << 32 | lines.max(axis=1))
