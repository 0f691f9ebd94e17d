"""Largest cube of a region whose points can all be measured, its edges along the base's axes."""

import numpy as np

from campaigns.arrays import AXES, Array, Index, Mask
from campaigns.design.pose_sampling import FeasibleRegion

STEPS = 40
"""Of the grid along the longest side of what is searched."""


def largest_cube(region: FeasibleRegion) -> tuple[Array, float]:
    """Middle (3,) and edge of the largest cube, mm, the plate unturned; edge 0: there is none.

    Judged at the points of a grid, once over all and once finer around what was found.
    """
    middle, half_mm = region.centre[: len(AXES)], region.extent[: len(AXES)]
    edge_mm = 0.0
    for _ in range(2):
        step_mm = 2.0 * float(half_mm.max()) / STEPS
        sides = [
            np.arange(at - half, at + half + 0.5 * step_mm, step_mm)
            for at, half in zip(middle, half_mm, strict=True)
        ]
        grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
        poses = np.zeros((grid[..., 0].size, len(region.centre)))
        poses[:, : len(AXES)] = grid.reshape(-1, len(AXES))
        corner, size = _largest_block(region.allows(poses).reshape(grid.shape[:-1]))
        if size < 2:
            return middle, 0.0
        edge_mm = (size - 1) * step_mm
        middle = grid[tuple(corner)] + 0.5 * edge_mm
        half_mm = np.full(len(AXES), 0.5 * edge_mm + step_mm)
    return middle, edge_mm


def _largest_block(mask: Mask) -> tuple[Index, int]:
    """First corner (3,) and size of the largest cube of a mask (I, J, K) that is all true.

    Of those as large the one nearest to their middle; size 0: none.
    """
    counts = np.pad(mask, ((1, 0),) * 3).cumsum(0).cumsum(1).cumsum(2)
    for size in range(min(mask.shape), 0, -1):
        inside = counts
        for axis in range(len(AXES)):
            along = np.moveaxis(inside, axis, 0)
            inside = np.moveaxis(along[size:] - along[:-size], 0, axis)
        corners = np.argwhere(inside == size**3)
        if len(corners):
            away = np.linalg.norm(corners - corners.mean(axis=0), axis=1)
            return np.asarray(corners[np.argmin(away)], dtype=np.intp), size
    return np.zeros(3, dtype=np.intp), 0
