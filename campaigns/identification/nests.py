"""Nests: whether the tracker's stand moved, by fixed reflectors."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation import information
from campaigns.estimation.information import ChiSquareTest, chi_square_test, length_with_std
from campaigns.estimation.point_sets import away_from_best_line, longest_mm
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.estimation.rigid_transforms import frame_jacobian
from campaigns.estimation.tracker_noise import TrackerUncertainty, inverse_roots
from campaigns.evaluation.diagnostics import Doubt, nests_told
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

FEWEST = 3
"""Number of nests that tell a turn and a shift."""
OFF_LINE_MM = 100.0
"""Way of the farthest nest from the best line through all, below which they tell no turn."""


@dataclass(frozen=True, slots=True, eq=False)
class StandMotion:
    """Motion of all nests in the tracker's axes, by tests what it is worth; E epochs after one."""

    between: tuple[tuple[int, int], ...]
    """Last shot of the first epoch and first one of each later one, by number."""
    moved: Array
    """A small turn about the middle of all shots and a shift, (E, 6), rad and mm."""
    covariance: Array
    """(6 E, 6 E)"""
    rigid: ChiSquareTest
    motion: ChiSquareTest


def stand_motion(shots: Shots, instrument: TrackerUncertainty) -> StandMotion | None:
    """Estimate how the tracker's stand moved by the nests of a series; None if they cannot tell."""
    epochs = list(_epochs(shots))
    if len(epochs) < 2:
        return None
    rows, epoch = np.concatenate(epochs), np.repeat(np.arange(len(epochs)), [*map(len, epochs)])
    names, nest = np.unique([shots.nests[row] for row in rows.tolist()], return_inverse=True)
    about_mm = shots.points_in_tracker_mm.mean(axis=0)
    points = shots.points_in_tracker_mm[rows] - about_mm
    by_place = np.einsum("rn,ij->rinj", np.eye(len(names))[nest], np.eye(3))
    by_motion = np.einsum("re,rij->riej", np.eye(len(epochs))[epoch, 1:], frame_jacobian(points))
    jacobian = np.concatenate([each.reshape(len(rows), 3, -1) for each in (by_place, by_motion)], 2)
    roots = inverse_roots(shots.rows(rows).covariance_mm2(instrument))
    white, seen = (roots @ jacobian).reshape(points.size, -1), (roots @ points[:, :, None]).ravel()
    found = np.linalg.lstsq(white, seen, rcond=None)[0]
    first = by_place[0].size // 3
    moved, own = found[first:], information.covariance(white)[first:, first:]
    numbers = shots.numbers
    return StandMotion(
        tuple((numbers[epochs[0][-1]], numbers[each[0]]) for each in epochs[1:]),
        moved.reshape(-1, FRAME_COLUMNS),
        own,
        chi_square_test(float(np.sum((seen - white @ found) ** 2)), len(seen) - len(found)),
        chi_square_test(float(moved @ np.linalg.solve(own, moved)), len(moved)),
    )


def _epochs(shots: Shots) -> Iterator[Index]:
    """Rows of nests measured one after the other, of those that fix a frame with the first's."""
    first: set[str] = set()
    nests = shots.nests or ("",) * len(shots)
    for named, run in groupby(shots.order_of_time().tolist(), key=lambda row: bool(nests[row])):
        rows = np.array([row for row in run if not first or nests[row] in first], dtype=np.intp)
        own, points = {nests[row] for row in rows.tolist()}, shots.points_in_tracker_mm[rows]
        if named and len(own) >= FEWEST and longest_mm(away_from_best_line(points)) >= OFF_LINE_MM:
            first = first or own
            yield rows


def nest_doubts(stand: StandMotion | None, shots: Shots, left_mm: float) -> Iterator[Doubt]:
    """What nests tell of stand and robot; a fit leaves `left_mm` (rms) of the shots."""
    if stand is None:
        return
    sizes_mm = np.linalg.norm(stand.moved[:, 3:], axis=1)
    most = int(np.argmax(sizes_mm))
    if stand.motion.beyond or stand.rigid.beyond:
        own = slice(6 * most + 3, 6 * most + 6)
        moved = length_with_std(stand.moved[most, 3:], stand.covariance[own, own])
        kind = "loose" if stand.rigid.beyond else "stand"
        yield nests_told(kind, *moved, stand.between[most])
    drift = shots.of_set(ShotSet.DRIFT)
    ways = drift.points_in_tracker_mm - drift.points_in_tracker_mm[:1]
    far = int(np.argmax([0.0, *np.linalg.norm(ways[1:], axis=1)]))
    std_mm, size_mm = 2.0**0.5 * left_mm, float(np.linalg.norm(ways[far : far + 1]))
    if chi_square_test((size_mm / std_mm) ** 2, 3).beyond and not stand.rigid.beyond:
        yield nests_told("robot", size_mm, std_mm, (drift.numbers[0], drift.numbers[far]))
