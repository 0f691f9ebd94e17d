"""Model errors: what the nominal and the identified model miss of the measured shots."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.point_sets import SHOTS_FOR_A_FRAME, distances_mm
from campaigns.estimation.residuals import arm_joints
from campaigns.estimation.rigid_transforms import Transform, fit_transform
from campaigns.estimation.tracker_noise import TrackerUncertainty, distance_variance_mm2
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots


@dataclass(frozen=True, slots=True, eq=False)
class PairErrors:
    """Modelled minus measured distances of pairs, (M,) each, mm."""

    pairs: tuple[int, ...]
    before_mm: Array
    after_mm: Array | None
    instrument_mm: Array
    """Standard uncertainty of each measured distance."""


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
    plate_tilt_rad: Array
    """Rotation vectors of the plate by the model after, (N, 3); 0 where it stays level."""


@dataclass(frozen=True, slots=True, eq=False)
class ShotErrors:
    """Modelled minus measured positions of the fitted shots, in the tracker's axes, (N, 3).

    Before with the frame that suits the nominal model best, after with the identified one.
    """

    before_mm: Array
    after_mm: Array
    instrument_mm: Array
    """Standard uncertainty of each measured coordinate, as a root mean square of the three, (N,)"""


@dataclass(frozen=True, slots=True, eq=False)
class ModelErrors:
    """Errors of all kinds; None where there are too few shots, or where the estimator has none."""

    fitted: PairErrors | None
    unseen: PairErrors | None
    shots: ShotErrors | None
    positions: PositionErrors | None


@dataclass(frozen=True, slots=True, eq=False)
class SessionShots:
    """Shots between which the tracker's frame did not move."""

    numbers: frozenset[int] = frozenset()
    """Empty: all that are of no other session."""
    tracker_from_base: Transform | None = None
    """None where it was not identified."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ComparedKinematics:
    """Kinematics to compare, and where the tracker stood in each session."""

    before: Kinematics
    after: Kinematics | None = None
    sessions: tuple[SessionShots, ...] = (SessionShots(),)
    backlash: Array | None = None
    """Lost motion found of each gear, (n,)."""


def model_errors(
    shots: Shots, models: ComparedKinematics, excluded: Mask, instrument: TrackerUncertainty
) -> ModelErrors:
    """Errors of the shots that count, not `excluded` (N,), and at which every model has a pose."""
    solved = _Solved.of(models, shots)
    usable = solved.found & ~excluded
    session = _session_of(shots, models.sessions)
    points = shots.points_in_tracker_mm
    covariance = shots.covariance_mm2(instrument)

    def pair_errors(purpose: ShotSet) -> PairErrors | None:
        rows = usable_pairs(shots, purpose, usable)
        rows = rows[session[rows[:, 0]] == session[rows[:, 1]]]
        if len(rows) == 0:
            return None
        first, second = rows.T
        missed = _missed_distances(points, first, second)
        return PairErrors(
            tuple(shots.pairs[row] or 0 for row in first.tolist()),
            missed(solved.before),
            None if solved.after is None else missed(solved.after),
            np.sqrt(distance_variance_mm2(points, covariance, first, second)),
        )

    return ModelErrors(
        pair_errors(ShotSet.IDENTIFICATION),
        pair_errors(ShotSet.VALIDATION),
        _shot_errors(shots, models, solved, usable, covariance),
        _position_errors(shots, models, solved, usable),
    )


def excluded_rows(
    shots: Shots, *, numbers: frozenset[int | None], pairs: frozenset[int | None]
) -> Mask:
    """Rows of the shots of some numbers or pairs, (N,)."""
    both = zip(shots.numbers, shots.pairs, strict=True)
    return np.array(
        [shot in numbers or (pair is not None and pair in pairs) for shot, pair in both],
        dtype=bool,
    )


def usable_pairs(shots: Shots, purpose: ShotSet, usable: Mask) -> Index:
    """Rows (M, 2) of the pairs both shots of which are usable."""
    rows = shots.whole_pairs(purpose).rows
    return np.asarray(rows[usable[rows].all(axis=1)])


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """Poses (N, t) of every shot by each model; NaN where one cannot be assembled."""

    before: Array
    after: Array | None
    found: Mask

    @classmethod
    def of(cls, models: ComparedKinematics, shots: Shots) -> "_Solved":
        before = models.before.forward(shots.joints)
        if models.after is None:
            return cls(before.values, None, before.found)
        joints = shots.joints
        if models.backlash is not None:
            joints = arm_joints(joints, shots.approach, models.backlash)
        after = models.after.forward(joints)
        return cls(before.values, after.values, before.found & after.found)


def _session_of(shots: Shots, sessions: tuple[SessionShots, ...]) -> Index:
    """Place of each shot's session, (N,); of one that is in none the first's."""
    places = {number: place for place, each in enumerate(sessions) for number in each.numbers}
    return np.array([places.get(number, 0) for number in shots.numbers], dtype=np.intp)


def _by_session(
    shots: Shots, models: ComparedKinematics, counted: Mask
) -> Iterator[tuple[Index, Transform | None]]:
    """Rows of the counted shots of each session that has enough of them, and its frame."""
    session = _session_of(shots, models.sessions)
    for place, each in enumerate(models.sessions):
        rows = np.flatnonzero(counted & (session == place))
        if len(rows) >= SHOTS_FOR_A_FRAME:
            yield rows, each.tracker_from_base


def _shot_errors(
    shots: Shots,
    models: ComparedKinematics,
    solved: _Solved,
    usable: Mask,
    covariance_mm2: Array,
) -> ShotErrors | None:
    fitted = np.array([each is ShotSet.IDENTIFICATION for each in shots.purposes], dtype=bool)
    if solved.after is None:
        return None
    before, after = np.full((2, len(shots), 3), np.nan)
    for rows, frame in _by_session(shots, models, usable & fitted):
        if frame is None:
            continue
        measured, nominal = shots.points_in_tracker_mm[rows], solved.before[rows, :3]
        before[rows] = fit_transform(nominal, measured).apply(nominal) - measured
        after[rows] = frame.apply(solved.after[rows, :3]) - measured
    rows = np.flatnonzero(~np.isnan(after[:, 0]))
    if len(rows) == 0:
        return None
    stated_mm = np.sqrt(np.trace(covariance_mm2[rows], axis1=1, axis2=2) / 3.0)
    return ShotErrors(before[rows], after[rows], stated_mm)


def _missed_distances(points: Array, first: Index, second: Index) -> Callable[[Array], Array]:
    measured = distances_mm(points, first, second)

    def missed(poses: Array) -> Array:
        return distances_mm(poses[:, :3], first, second) - measured

    return missed


def _position_errors(
    shots: Shots, models: ComparedKinematics, solved: _Solved, usable: Mask
) -> PositionErrors | None:
    of_sets = {ShotSet.IDENTIFICATION, ShotSet.VALIDATION}
    counted = usable & np.array([p in of_sets for p in shots.purposes], dtype=bool)
    before, after = np.full((2, len(shots), 3), np.nan)
    for rows, _ in _by_session(shots, models, counted):
        points = shots.points_in_tracker_mm[rows]
        with suppress(ValueError):  # points on one line fix no frame
            before[rows] = _missed_positions(solved.before[rows], points)
            if solved.after is not None:
                after[rows] = _missed_positions(solved.after[rows], points)
    rows = np.flatnonzero(~np.isnan(before[:, 0]))
    if len(rows) == 0:
        return None
    poses = solved.before if solved.after is None else solved.after
    robot = models.after or models.before
    tilt = robot.mechanism.plate_tilt(robot.p, shots.joints[rows], poses[rows])
    return PositionErrors(
        poses[rows],
        before[rows],
        None if solved.after is None else after[rows],
        np.array([shots.purposes[row] is ShotSet.IDENTIFICATION for row in rows.tolist()]),
        tilt,
    )


def _missed_positions(poses: Array, points: Array) -> Array:
    return np.asarray(fit_transform(points, poses[:, :3]).apply(points) - poses[:, :3])
