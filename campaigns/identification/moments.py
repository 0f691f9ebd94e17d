"""Moments of observations of other kinds: their rank among shots, time in a session, and warmth.

A fit compares moments by rank alone. Observations without a time are of the robot of today. Where
they have times, shots need theirs as well: nothing else says which came first.
"""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import OptionsInvalid, ShotsInvalid
from campaigns.fit.error_model import Observations
from campaigns.fit.kinds import KINDS, Block
from campaigns.identification.other_kinds import Measured, OtherKinds
from campaigns.shots.shots import Shots
from campaigns.shots.shots_csv import times_s


def stations_of(measured: Iterable[Measured]) -> Index:
    """Return the numbers of the tracker's stations from which fitted observations were made.

    Raise `OptionsInvalid` where a tracker's observations do not state their station.
    """
    numbers = []
    for rows in measured:
        if rows.held_out or rows.kind not in KINDS or not KINDS[rows.kind].by_tracker:
            continue
        if rows.session is None:
            raise OptionsInvalid(
                f"{KINDS[rows.kind].plural} of {rows.object.name} do not state their session",
                remedy="give the number of the tracker's station of each, or leave out --sessions",
            )
        numbers.append(np.asarray(rows.session, dtype=np.intp))
    return np.unique(np.concatenate(numbers)) if numbers else np.zeros(0, dtype=np.intp)


# 1. Times of shots in the order in which they were measured: a clock may have been set back.
# 2. Ranks of all moments together. Observations of equal times have one rank.
# 3. Time in the session of the frame, and warmth in proportion to time between shots.
def in_order_of_time(
    kinds: OtherKinds, observations: Observations, shots: Shots | None = None
) -> tuple[OtherKinds, Observations]:
    """Return blocks and observations with moments by rank; the blocks come with theirs in s.

    `observations` are of all `shots`. Raise `ShotsInvalid` for shots without times that go together
    with those of observations.
    """
    blocks = (*kinds.fitted, *kinds.held_out)
    seconds = np.concatenate([np.zeros(0), *(block.moment for block in blocks)])
    moments = np.unique(seconds[np.isfinite(seconds)])
    if not len(moments):
        return kinds, observations
    of_shots = _seconds_of(shots) if shots is not None else np.zeros(0)
    turn = np.concatenate([observations.moment, np.full(len(moments), np.inf)])
    ranks = np.empty(len(turn))
    ranks[np.lexsort((turn, np.concatenate([of_shots, moments])))] = np.arange(len(turn))
    of_moments = np.append(ranks[len(of_shots) :], np.inf)

    def placed(block: Block) -> Block:
        return replace(
            block,
            moment=of_moments[np.searchsorted(moments, block.moment)],
            time=_times_in_sessions(block, blocks, of_shots, observations.frame),
            warmth=_warmth_at(block.moment, of_shots, observations, shots),
        )

    return replace(
        kinds, fitted=tuple(map(placed, kinds.fitted)), held_out=tuple(map(placed, kinds.held_out))
    ), replace(observations, moment=ranks[: len(of_shots)])


def _seconds_of(shots: Shots) -> Array:
    """Return the times of shots in s, (N,), never falling in the order of time."""
    seconds, lacking = times_s(shots.measured_utc)
    if seconds is None:
        raise ShotsInvalid(
            f"observations of other kinds have times, which shots lack: {lacking}",
            remedy="give shots their times as well, or leave out those of the observations",
        )
    order, rising = shots.order_of_time(), np.empty(len(seconds))
    rising[order] = np.maximum.accumulate(seconds[order])
    return rising


def _times_in_sessions(
    block: Block, blocks: Iterable[Block], of_shots: Array, frame: Index
) -> Array:
    """Return the time of each observation in its session, from 0 to 1, (M,).

    A session lasts from its first shot to its last; one without shots by what a tracker observed.
    """
    time = np.zeros(len(block))
    for number in np.unique(block.frame).tolist():
        clock = of_shots[frame == number]
        if not len(clock):
            seen = (other for other in blocks if other.kind.by_tracker)
            clock = np.concatenate(
                [block.moment[:0], *(other.moment[other.frame == number] for other in seen)]
            )
            clock = clock[np.isfinite(clock)]
        rows = (block.frame == number) & np.isfinite(block.moment)
        span = float(np.ptp(clock)) if len(clock) else 0.0
        if span > 0.0:
            time[rows] = np.clip((block.moment[rows] - clock.min()) / span, 0.0, 1.0)
    return time


# Without a moment it is the robot of today, which is stated at the reference.
def _warmth_at(
    moment: Array, of_shots: Array, observations: Observations, shots: Shots | None
) -> Array:
    """Return by how much parts were warmer than the reference at moments (M,) in s, °C."""
    if shots is None or not (is_known := np.isfinite(shots.part_temperature_degC)).any():
        return np.zeros(len(moment))
    rows = np.flatnonzero(is_known)
    rows = rows[np.argsort(of_shots[rows], kind="stable")]
    interpolated = np.interp(moment, of_shots[rows], observations.warmth[rows])
    return np.where(np.isfinite(moment), interpolated, 0.0)
