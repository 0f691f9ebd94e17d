"""Measured shots as arrays, whether we measured them or somebody else did."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.exchange import ShotRow
from campaigns.journal_views import AcceptedShot
from campaigns.numerics.geometry import Array
from campaigns.shot_sets import ShotSet


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """N shots. `numbers` are those of the plan or, imported, of the file's rows."""

    numbers: tuple[int, ...]
    purposes: tuple[ShotSet, ...]
    pairs: tuple[int | None, ...]
    joints_rad: Array
    """(N, 4)"""
    points_in_tracker_mm: Array
    """(N, 3)"""
    covariance_mm2: Array | None
    """(N, 3, 3); None when any shot came without."""

    def pair_rows(self, purpose: ShotSet) -> Array:
        """Rows of the shots in whole pairs of that set, (M, 2)."""
        rows: dict[int, list[int]] = {}
        for row, (kind, pair) in enumerate(zip(self.purposes, self.pairs, strict=True)):
            if kind is purpose and pair is not None:
                rows.setdefault(pair, []).append(row)
        whole = [both for both in rows.values() if len(both) == 2]
        return np.array(whole, dtype=np.intp).reshape(-1, 2)

    def rows(self, purpose: ShotSet) -> Array:
        """Rows of the shots of one set, (K,)."""
        return np.array(
            [row for row, kind in enumerate(self.purposes) if kind is purpose], dtype=np.intp
        )

    def measured_distances_mm(self, rows: Array) -> Array:
        """Between the two shots of each row of (M, 2), (M,)."""
        points = self.points_in_tracker_mm
        return np.asarray(np.linalg.norm(points[rows[:, 1]] - points[rows[:, 0]], axis=1))


def dataset_of_journal(shots: Sequence[AcceptedShot]) -> Dataset:
    """The accepted shots of a series."""
    covariances = [shot.outcome.covariance_mm2 for shot in shots]
    return Dataset(
        tuple(shot.intent.shot for shot in shots),
        tuple(ShotSet(shot.intent.purpose) for shot in shots),
        tuple(shot.intent.pair for shot in shots),
        np.array([shot.outcome.joints_rad for shot in shots]).reshape(-1, 4),
        np.array([shot.outcome.point_in_tracker_mm for shot in shots]).reshape(-1, 3),
        None if None in covariances or not covariances else np.array(covariances),
    )


def dataset_of_rows(rows: Sequence[ShotRow]) -> Dataset:
    """Imported shots, numbered as they stand in their file."""
    covariances = [row.covariance_mm2 for row in rows]
    return Dataset(
        tuple(range(len(rows))),
        tuple(row.purpose for row in rows),
        tuple(row.pair for row in rows),
        np.array([row.joints_rad for row in rows]).reshape(-1, 4),
        np.array([row.point_in_tracker_mm for row in rows]).reshape(-1, 3),
        None if None in covariances else np.array(covariances),
    )
