"""From which side each joint came to rest at a shot: what tells on which flank its gear lies."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.point_sets import distances_mm
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.journal.records import Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.mechanisms.geometry import ARMS
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Matrix3

TAKEN_UP_RAD = float(np.radians(5.0 / 60.0))
"""A joint that went this far has taken up its gear's lost motion, whatever it did before."""
AT_REST_RAD = float(np.radians(0.005))
"""Readings of a joint that stands still differ by less."""


def approach_directions(shots: Sequence[AcceptedShot]) -> Array:
    """+1 where a joint last moved towards larger angles, -1 smaller, 0 where unknown, (N, 4).

    A joint that hardly moved on the last leg keeps the direction of the shot before, if it stood
    there when the leg began and was not turned round. Before means before in time: a shot measured
    again comes after others of higher numbers.
    """
    found = np.zeros((len(shots), ARMS))
    before, standing_rad = np.zeros(ARMS), np.full(ARMS, np.nan)
    for row in sorted(range(len(shots)), key=lambda row: shots[row].measured_utc):
        outcome = shots[row].outcome
        joints_rad = np.array(outcome.joints_rad)
        if outcome.came_from_rad is not None:
            came_from_rad = np.array(outcome.came_from_rad)
            straight = bool((np.abs(came_from_rad - standing_rad) < AT_REST_RAD).all())
            found[row] = _direction(joints_rad - came_from_rad, before * straight)
        before, standing_rad = found[row], joints_rad
    return found


def _direction(moved_rad: Array, before: Array) -> Array:
    """Of each joint after a leg, (4,), from how far it went and the direction before the leg."""
    way = np.sign(moved_rad)
    kept = (np.abs(moved_rad) < AT_REST_RAD) | (way == before)
    return np.where(np.abs(moved_rad) > TAKEN_UP_RAD, way, np.where(kept, before, 0.0))


LEAST_DETERMINANT = 1e-12
"""Of the correlations; below it one direction would be known a million times better than others."""


def is_positive_definite(matrix: Matrix3) -> bool:
    """Sylvester's rule on the correlations, so that the scale does not matter."""
    if not all(math.isfinite(value) for value in chain.from_iterable(matrix)):
        return False
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
    if min(xx, yy, zz) <= 0.0:
        return False
    r_xy = xy / math.sqrt(xx) / math.sqrt(yy)
    r_xz = xz / math.sqrt(xx) / math.sqrt(zz)
    r_yz = yz / math.sqrt(yy) / math.sqrt(zz)
    if max(abs(r_xy), abs(r_xz), abs(r_yz)) >= 1.0:
        return False
    determinant = 1.0 + 2.0 * r_xy * r_xz * r_yz - r_xy**2 - r_xz**2 - r_yz**2
    return determinant > LEAST_DETERMINANT


SHOTS_OF_A_PAIR = 2


@dataclass(frozen=True, slots=True, eq=False)
class Shots:
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


def shots_of_journal(shots: Sequence[AcceptedShot]) -> Shots:
    """The accepted shots of a series."""
    return Shots(
        tuple(shot.intent.shot for shot in shots),
        tuple(ShotSet(shot.intent.purpose) for shot in shots),
        tuple(shot.intent.pair for shot in shots),
        np.array([shot.outcome.joints_rad for shot in shots]).reshape(-1, 4),
        np.array([shot.outcome.point_in_tracker_mm for shot in shots]).reshape(-1, 3),
        _stated_covariance_mm2([shot.outcome for shot in shots]),
        approach_directions(shots),
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
