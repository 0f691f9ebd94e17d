"""Observations of a fit: shots of a robot as arrays, with the noise of their points by part."""

from collections.abc import Sequence

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.fit.effects import Walk
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.tracker_noise import covariance_by_direction_mm2
from campaigns.identification.options import IdentificationOptions, matching, named_priors
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.model import Kinematics
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, between, held_out
from campaigns.shots.stops import by_stops

HOLD_OUT_SEED = 1
"""Seed of the pairs that are held out: the same for every identification of the same shots."""
FEWEST_SHOTS = 4
"""Shots of a session: three place its frame, with none to spare."""


def error_model(
    nominal: Kinematics, shots: Shots | None, options: IdentificationOptions, sessions: int = 0
) -> ErrorModel:
    """Return the model of all sources of error, with the options' held names and tolerances.

    Parts may have grown where shots have their temperatures; None for shots that are planned. The
    stand of each of the `sessions` may have moved slowly.
    """
    # The instrument's common errors (scale, axes, reflector) come from its data sheet and stand
    # last: they replace tolerances of robot.yaml for those groups.
    table = nominal.mechanism.parameters
    held = {name for pattern in options.fix for name in matching(pattern, table)}
    return ErrorModel(
        nominal,
        held=frozenset(held),
        tolerances=named_priors(options.prior, table),
        group_tolerances={**options.tolerances, **options.instrument.common},
        with_growth=shots is not None and bool(np.isfinite(shots.part_temperature_degC).any()),
        effects=tuple(map(Walk, range(sessions))),
    )


def observations_of(
    shots: Shots, near: Array, options: IdentificationOptions, sessions: Index | None = None
) -> Observations:
    """Return the observations of shots, with poses (N, t) `near` the ones they had.

    `sessions` are the numbers of the sessions that have a frame of their own each, in the order of
    the frames; shots of others have no frame, -1. None: one frame for all. Shots without a stated
    covariance get the noise of the data sheet along and across the beam, whose factors are
    estimated.
    """
    # The noise of a file may be mixed: some shots with a covariance by the tracker, some without.
    # Each part has its covariance where it holds and zero elsewhere, so their sum is each shot's.
    instrument, points = options.instrument, shots.points_in_tracker_mm
    is_stated = np.asarray(np.isfinite(shots.stated_covariance_mm2).all(axis=(1, 2)))
    along, across = covariance_by_direction_mm2(points, instrument)
    is_unstated = ~is_stated[:, None, None]
    _require_covariances(shots, is_stated)
    noise: dict[str, Array] = {}
    if is_stated.any():
        noise["stated"] = np.where(is_unstated, 0.0, shots.stated_covariance_mm2)
    if not is_stated.all():
        noise["along"] = is_unstated * along
        noise["across"] = is_unstated * across
    frame = np.zeros(len(shots), dtype=np.intp)
    if sessions is not None:
        place = np.minimum(np.searchsorted(sessions, shots.session), len(sessions) - 1)
        frame = np.where(sessions[place] == shots.session, place, -1)
    # A shot without temperatures counts as measured at the reference: its growth is zero.
    warmth = shots.part_temperature_degC - options.reference_degC
    order = shots.order_of_time()
    moment = np.empty(len(shots))
    moment[order] = np.arange(len(shots))
    former = shots.joints.copy()
    former[order[1:]] = shots.joints[order[:-1]]
    return Observations(
        joints=shots.joints,
        approach=shots.approach,
        near=near,
        points=points,
        noise=noise,
        frame=frame,
        warmth=np.where(np.isfinite(warmth), warmth, 0.0),
        moment=moment,
        time=_times_in_sessions(shots, moment, frame),
        former=former,
    )


def _times_in_sessions(shots: Shots, moment: Array, frame: Index) -> Array:
    """Return the time of each shot in its session, from 0 to 1, (N,): by the clock or by order."""
    elapsed_s = shots.elapsed_s()
    clock = moment if elapsed_s is None else elapsed_s
    time = np.zeros(len(clock))
    for number in np.unique(frame).tolist():
        rows = frame == number
        begin, span = clock[rows].min(), np.ptp(clock[rows])
        time[rows] = (clock[rows] - begin) / span if span > 0.0 else 0.5
    return time


def _require_covariances(shots: Shots, is_stated: Mask) -> None:
    """Raise `ShotsInvalid` for the first stated covariance that is not positive definite."""
    rows = np.flatnonzero(is_stated)
    least = np.linalg.eigvalsh(shots.stated_covariance_mm2[rows])[:, 0]
    for row in rows[least <= 0.0].tolist():
        raise ShotsInvalid(
            f"shot {shots.numbers[row]}: its covariance is not positive definite",
            remedy="import the shots again with right covariances, or without any",
        )


def fitted_sessions(shots: Shots, assembles: Mask, options: IdentificationOptions) -> Index:
    """Return the numbers of the sessions that have a frame of their own; one number for all.

    `assembles` (N,) is true for shots at which the nominal robot can be assembled. Raise
    `ShotsMissing` for a session with too few of them to place the tracker's frame.
    """
    rows = shots.rows_of(ShotSet.IDENTIFICATION)
    session = shots.session if options.sessions else np.zeros(len(shots), dtype=np.intp)
    usable = rows[assembles[rows]]
    counts = [int((session[usable] == number).sum()) for number in np.unique(session[rows])] or [0]
    if min(counts) < FEWEST_SHOTS:
        where = "a session has" if options.sessions and len(counts) > 1 else "there are"
        missing = len(rows) - len(usable)
        left_out = f" ({missing} left out)" if missing else ""
        raise ShotsMissing(
            f"{where} {min(counts)} shots to identify from{left_out}: they place no frame of the "
            "tracker",
            remedy=f"measure at least {FEWEST_SHOTS} shots, better 60",
        )
    return np.unique(session[rows])


def asked_shots(shots: Shots, axes: Sequence[Axis], options: IdentificationOptions) -> Shots:
    """Return the stops within the requested range, a requested share of their pairs held out.

    `axes` are the joints'; samples of one stop are averaged.
    """
    # Stops come first: a stop of which some samples were held out would confirm any model.
    rng, stops = np.random.default_rng(HOLD_OUT_SEED), by_stops(shots, axes)
    return held_out(between(stops, *options.shots), options.hold_out, rng)
