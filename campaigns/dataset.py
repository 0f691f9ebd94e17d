"""Measured shots as arrays, whether we measured them or somebody else did."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.journal_views import AcceptedShot
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.pairs import distances_mm
from campaigns.shot_sets import ShotSet

SHOTS_OF_A_PAIR = 2


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

    def pair_rows(self, purpose: ShotSet) -> Index:
        """Rows of the shots in whole pairs of that set, (M, 2)."""
        whole = [rows for rows in self._rows_of_pairs(purpose) if len(rows) == SHOTS_OF_A_PAIR]
        return np.array(whole, dtype=np.intp).reshape(-1, SHOTS_OF_A_PAIR)

    def half_pairs(self, purpose: ShotSet) -> tuple[int, ...]:
        """Rows of the shots of that set whose partner is missing."""
        halves = [rows for rows in self._rows_of_pairs(purpose) if len(rows) < SHOTS_OF_A_PAIR]
        return tuple(row for rows in halves for row in rows)

    def measured_distances_mm(self, rows: Index) -> Array:
        """Between the two shots of each row of (M, 2), (M,)."""
        return distances_mm(self.points_in_tracker_mm, rows[:, 0], rows[:, 1])

    def _rows_of_pairs(self, purpose: ShotSet) -> list[list[int]]:
        rows: dict[int, list[int]] = {}
        for row, (kind, pair) in enumerate(zip(self.purposes, self.pairs, strict=True)):
            if kind is purpose and pair is not None:
                rows.setdefault(pair, []).append(row)
        return list(rows.values())


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
