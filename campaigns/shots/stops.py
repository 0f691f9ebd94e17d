"""Stops of the robot: consecutive samples of one stop, averaged into the one shot that they are.

Tracker software that logs several points a second, and an operator who measures a pose thrice, give
several rows for each stop. All of them have the same error of the robot, its repeatability of that
stop: as shots of their own they would count it as often, and as pairs they would have no distance.
At equal joints residuals and derivatives are equal too, so that the mean of the samples determines
all that they determine.

Shots that test how the robot comes back (repeatability, drift, cube, …) are never averaged.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.kinematics.axes import Axis
from campaigns.shots.shot_sets import SHOTS_OF_A_PAIR, ShotSet
from campaigns.shots.shots import AT_REST_RAD, TAKEN_UP_RAD, Shots
from campaigns.shots.shots_csv import steady_times_s

AVERAGED = (ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
"""Sets in which samples of one stop are one shot."""
MOST_DECIMALS = 9
"""Number of decimals from which on joints count as exact, in deg or mm."""
ROUNDING = 1e-10
"""Largest error of a joint by its conversion from deg into rad and back, deg or mm."""
PAUSE_S = 5.0
"""Shortest time in which a robot leaves a pose, comes back and settles."""
FAR_LONGER = 10.0
"""Ratio to the usual time between samples from which on a pause is none between samples."""


def by_stops(shots: Shots, axes: Sequence[Axis]) -> Shots:
    """Return the shots with the samples of each stop averaged; `axes` are the joints'.

    Shots of a stop are of one set and session, next to each other in time, at equal joints reached
    from equal sides. Their mean has the number and the time of the first of them. A stated
    covariance is divided by their number, as that of independent samples; the data sheet's, for
    which nothing is stated, is not. A pair within a stop is void, and stops that lose their pairs
    are paired again: each two of a set. Without such shots the result is `shots` itself.
    """
    stops = _stops(shots, axes)
    if len(stops) == len(shots):
        return shots
    merged = shots.rows(np.array([stop[0] for stop in stops]))
    counts = np.array([len(stop) for stop in stops], dtype=np.float64)

    def mean(column: Array) -> Array:
        return np.array([column[stop].mean(axis=0) for stop in stops])

    return replace(
        merged,
        pairs=_pairs_of_stops(shots, stops),
        joints=mean(shots.joints),
        commanded=mean(shots.commanded),
        commanded_points_mm=mean(shots.commanded_points_mm),
        points_in_tracker_mm=mean(shots.points_in_tracker_mm),
        stated_covariance_mm2=mean(shots.stated_covariance_mm2) / counts[:, None, None],
    )


def averaged_in_words(shots: Shots, axes: Sequence[Axis]) -> str:
    """Return a sentence on rows that are samples of fewer stops; "" where each is a stop."""
    stops = by_stops(shots, axes)
    rows, count = len(shots.rows_of(*AVERAGED)), len(stops.rows_of(*AVERAGED))
    if rows == count:
        return ""
    return (
        f"{rows} rows are {count} stops: consecutive rows at equal joints are averaged, and pairs "
        "are of stops"
    )


def _stops(shots: Shots, axes: Sequence[Axis]) -> list[Index]:
    """Return the rows of each stop in the order of time, stops in the order of their first rows."""
    # 1. Go through the shots in the order of time. A shot belongs to the stop before if it differs
    #    in no joint from the mean of its samples so far: jitter averages out, slow motion does not.
    # 2. Where times are known, cut stops at pauses in which the robot may have left and come back.
    order = shots.order_of_time()
    tolerance = _tolerances(shots.joints, axes)
    starts: list[int] = []
    for place, row in enumerate(order.tolist()):
        if not starts or not _is_of(shots, order[starts[-1] : place], row, tolerance):
            starts.append(place)
    starts = sorted({*starts, *_pauses(shots, order, np.array(starts, dtype=np.intp))})
    return sorted(np.split(order, starts[1:]) if starts else [], key=lambda stop: int(stop[0]))


def _is_of(shots: Shots, stop: Index, row: int, tolerance: Array) -> bool:
    """Return whether a row is a sample of the stop of rows (k,), if it comes next in time."""
    before, purpose = int(stop[-1]), shots.purposes[row]
    if purpose not in AVERAGED or purpose is not shots.purposes[before]:
        return False
    off = np.abs(shots.joints[row] - shots.joints[stop].mean(axis=0))
    is_alike = shots.session[row] == shots.session[before]
    return bool(
        is_alike
        and (off <= tolerance).all()
        and (shots.approach[row] == shots.approach[before]).all()
    )


def _tolerances(joints: Array, axes: Sequence[Axis]) -> Array:
    """Return the largest difference between readings (N, n) of a joint at rest, (n,), rad or mm."""
    # Readings of what stands still differ by AT_REST_RAD, or by a last digit each if that is more.
    # A digit that is coarser than the smallest real motion, which takes up a gear's lost motion, is
    # no jitter: a plan in steps of whole degrees has it too.
    tolerances = []
    for axis, readings in zip(axes, joints.T, strict=True):
        at_rest, motion = (axis.to_file(rad * axis.scale) for rad in (AT_REST_RAD, TAKEN_UP_RAD))
        jitter = 2.0 * _last_digit(np.array([*map(axis.to_file, readings.tolist())]))
        within = max(at_rest, jitter) if jitter <= motion else at_rest
        tolerances.append(axis.from_file(within + ROUNDING))
    return np.array(tolerances)


def _last_digit(readings: Array) -> float:
    """Return the last decimal digit of readings, NaN left out; 0 if they have too many decimals."""
    readings = readings[np.isfinite(readings)]
    for decimals in range(MOST_DECIMALS):
        if (np.abs(readings - readings.round(decimals)) <= ROUNDING).all():
            return float(10.0**-decimals)
    return 0.0


def _pauses(shots: Shots, order: Index, starts: Index) -> list[int]:
    """Return the places in the order of time after a pause within a stop; none without times.

    A pause is long for the robot, and for this series: as long as between different stops in the
    median, or far longer than between samples.
    """
    seconds, _ = steady_times_s([shots.measured_utc[row] for row in order.tolist()])
    if seconds is None:
        return []
    gaps_s, is_start = np.diff(seconds), np.zeros(len(order), dtype=np.bool_)
    is_start[starts] = True
    session = shots.session[order]
    in_session, is_start = session[1:] == session[:-1], is_start[1:]
    # a clock that was set back, or times of which some were not measured, give no pauses
    if (gaps_s[in_session] < 0.0).any() or is_start.all():
        return []
    longest_s = FAR_LONGER * float(np.median(gaps_s[~is_start]))
    if (is_move := is_start & in_session).any():
        longest_s = min(longest_s, float(np.median(gaps_s[is_move])))
    after = np.flatnonzero(~is_start & (gaps_s >= max(PAUSE_S, longest_s))) + 1
    return [int(place) for place in after]


def _pairs_of_stops(shots: Shots, stops: Sequence[Index]) -> tuple[int | None, ...]:
    """Return the pair of each stop: one that joins it to another stop, or else a new one."""
    # 1. Pairs keep their numbers if their shots are of two stops without another pair. Whole pairs
    #    come before halves, of which the other shot was never measured.
    stop_of = {row: number for number, stop in enumerate(stops) for row in stop.tolist()}
    rows_of: dict[tuple[ShotSet, int], list[int]] = {}
    for row, (purpose, pair) in enumerate(zip(shots.purposes, shots.pairs, strict=True)):
        if pair is not None:
            rows_of.setdefault((purpose, pair), []).append(row)
    pairs: dict[int, int] = {}
    for (_, pair), rows in sorted(rows_of.items(), key=lambda item: -len(item[1])):
        joined = {stop_of[row] for row in rows}
        if len(joined) == len(rows) and joined.isdisjoint(pairs):
            pairs |= dict.fromkeys(joined, pair)
    # 2. Stops that had none but void pairs are paired as they follow each other in their set.
    unpaired: dict[ShotSet, list[int]] = {}
    for number, stop in enumerate(stops):
        if number not in pairs and any(shots.pairs[row] is not None for row in stop.tolist()):
            unpaired.setdefault(shots.purposes[stop[0]], []).append(number)
    following = max((pair for _, pair in rows_of), default=0) + 1
    for numbers in unpaired.values():
        for place in range(0, len(numbers) - 1, SHOTS_OF_A_PAIR):
            pairs |= dict.fromkeys(numbers[place : place + SHOTS_OF_A_PAIR], following)
            following += 1
    return tuple(pairs.get(number) for number in range(len(stops)))
