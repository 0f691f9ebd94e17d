"""Model errors: how far the measured shots are from the nominal and from the identified model."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.fit.rigid_transforms import SHOTS_FOR_A_FRAME, fit_transform
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ModelledShots:
    """Shots of a result, with their poses (N, t) by the nominal and by the identified model."""

    shots: Shots
    before: Array
    after: Array | None
    points: Callable[[Array], Array]
    """Where the measured point is in the base frame, (N, 3), at poses (N, t)."""
    sessions: bool = False
    """Whether each session has a frame of its own."""

    def rows_by_frame(self) -> Iterator[Index]:
        """Yield the rows of each frame's shots, where they are enough to fit it."""
        session_of = self.shots.session if self.sessions else np.zeros(len(self.shots))
        for session in np.unique(session_of).tolist():
            rows = np.flatnonzero(session_of == session)
            if len(rows) >= SHOTS_FOR_A_FRAME:
                yield rows

    def pairs(self, purpose: ShotSet) -> Index:
        """Return rows (M, 2) of the whole pairs of a set, each of one frame."""
        rows, session_of = self.shots.whole_pairs(purpose).rows, self.shots.session
        return rows[session_of[rows[:, 0]] == session_of[rows[:, 1]]] if self.sessions else rows


@dataclass(frozen=True, slots=True, eq=False)
class Residuals:
    """Modelled minus measured distances of pairs, mm."""

    numbers: tuple[int, ...]
    """Of the pairs, (M,)."""
    before_mm: Array
    """(M,)"""
    after_mm: Array | None


@dataclass(frozen=True, slots=True, eq=False)
class PositionErrors:
    """Measured minus modelled positions in the base frame, the frame fitted for each model."""

    poses: Array
    """As modelled, (N, t), mm and rad."""
    before_mm: Array
    """(N, 3)"""
    after_mm: Array | None
    fitted: Mask
    """Shots that were identified from; the others were never fitted."""


@dataclass(frozen=True, slots=True, eq=False)
class ModelErrors:
    """Errors of pairs and positions; None where there are too few shots."""

    fitted: Residuals | None
    """Distances of fitted pairs."""
    unseen: Residuals | None
    positions: PositionErrors | None


def pair_errors(modelled: ModelledShots, purpose: ShotSet) -> Residuals | None:
    """Return errors of the pairs of a set; None without any."""
    rows, shots = modelled.pairs(purpose), modelled.shots
    if len(rows) == 0:
        return None

    def errors_by(poses: Array) -> Array:
        return shots.distance_errors_mm(rows, modelled.points(poses))

    return Residuals(
        tuple(shots.pairs[row] or 0 for row in rows[:, 0].tolist()),
        errors_by(modelled.before),
        None if modelled.after is None else errors_by(modelled.after),
    )


def position_errors(modelled: ModelledShots) -> PositionErrors | None:
    """Return errors of the positions; None where no frame can be fitted."""
    # Each model gets its own best rigid fit, one for each frame: an error of the frame is none of
    # the robot. Shots of a frame that cannot be fitted stay NaN and are left out.
    shots = modelled.shots
    before, after = np.full((2, len(shots), 3), np.nan)
    for rows in modelled.rows_by_frame():
        points = shots.points_in_tracker_mm[rows]
        with suppress(ValueError):  # points on one line fix no frame
            before[rows] = _position_errors(modelled.points(modelled.before[rows]), points)
            if modelled.after is not None:
                after[rows] = _position_errors(modelled.points(modelled.after[rows]), points)
    rows = np.flatnonzero(~np.isnan(before[:, 0]))
    if len(rows) == 0:
        return None
    poses = modelled.before if modelled.after is None else modelled.after
    return PositionErrors(
        poses[rows],
        before[rows],
        None if modelled.after is None else after[rows],
        np.isin(rows, shots.rows_of(ShotSet.IDENTIFICATION)),
    )


def _position_errors(modelled: Array, points: Array) -> Array:
    """Return measured minus modelled positions (N, 3) in the base frame, after the best fit."""
    return np.asarray(fit_transform(points, modelled).apply(points) - modelled)
