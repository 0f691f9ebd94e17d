"""Measured shots as arrays, whether we measured them or somebody else did."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.journal.records import Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.numerics.geometry import Array, Index
from campaigns.numerics.instrument import TrackerUncertainty, point_covariance_mm2
from campaigns.numerics.pairs import distances_mm
from campaigns.shot_sets import ShotSet
from campaigns.shots.approach import approach

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
    stated_covariance_mm2: Array
    """What the tracker stated of each point, (N, 3, 3); NaN where it stated nothing."""
    approach: Array
    """+1 where a joint last moved towards larger angles, -1 smaller, 0 where unknown, (N, 4)."""

    @property
    def knows_approach(self) -> bool:
        """Whether of any shot it is known from which side its joints came."""
        return bool(self.approach.any())

    def covariance_mm2(self, model: TrackerUncertainty) -> Array:
        """What the tracker stated of each point, or `model` where it stated nothing, (N, 3, 3)."""
        return _completed_mm2(self.stated_covariance_mm2, self.points_in_tracker_mm, model)

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
    return Dataset(
        tuple(shot.intent.shot for shot in shots),
        tuple(ShotSet(shot.intent.purpose) for shot in shots),
        tuple(shot.intent.pair for shot in shots),
        np.array([shot.outcome.joints_rad for shot in shots]).reshape(-1, 4),
        np.array([shot.outcome.point_in_tracker_mm for shot in shots]).reshape(-1, 3),
        _stated_covariance_mm2([shot.outcome for shot in shots]),
        approach(shots),
    )


def _stated_covariance_mm2(outcomes: Sequence[Outcome]) -> Array:
    """What the tracker stated of each point, (N, 3, 3); NaN where it stated nothing."""
    stated = np.full((len(outcomes), 3, 3), np.nan)
    for row, outcome in enumerate(outcomes):
        if outcome.covariance_mm2 is not None:
            stated[row] = outcome.covariance_mm2
    return stated


def outcomes_covariance_mm2(outcomes: Sequence[Outcome], model: TrackerUncertainty) -> Array:
    """What the tracker stated of each point, or `model` where it stated nothing, (N, 3, 3)."""
    points = np.array([outcome.point_in_tracker_mm for outcome in outcomes]).reshape(-1, 3)
    return _completed_mm2(_stated_covariance_mm2(outcomes), points, model)


def _completed_mm2(
    stated_mm2: Array, points_in_tracker_mm: Array, model: TrackerUncertainty
) -> Array:
    """Stated covariances, and those of `model` where they are NaN, (N, 3, 3)."""
    unstated = np.flatnonzero(np.isnan(stated_mm2).all(axis=(1, 2)))
    completed = stated_mm2.copy()
    completed[unstated] = point_covariance_mm2(points_in_tracker_mm[unstated], model)
    return completed
