"""Shots of reflectors elsewhere on the platform, as observations of the objects that carry them."""

from collections.abc import Sequence
from datetime import datetime

import numpy as np

from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.identification.objects import Object
from campaigns.identification.other_kinds import Measured
from campaigns.journal.views import AcceptedShot
from campaigns.shots.shot_sets import ShotSet

KIND = "reflector"
HELD_OUT = {ShotSet.IDENTIFICATION: False, ShotSet.VALIDATION: True}
"""Whether shots of a set check the result instead of being fitted; those of other sets do neither.
"""


def reflector_observations(
    shots: Sequence[AcceptedShot], objects: Sequence[Object], instrument: TrackerUncertainty
) -> tuple[Measured, ...]:
    """Return the accepted shots of reflectors that are not the robot file's own, by object and set.

    Where a tracker stated no covariance, σ is that of the instrument's data sheet. Raise `KeyError`
    for an object that is not among those given.
    """
    by_name = {carrier.name: carrier for carrier in objects}
    groups: dict[tuple[str, bool], list[AcceptedShot]] = {}
    for shot in shots:
        purpose = ShotSet(shot.intent.purpose)
        if (reflector := shot.outcome.reflector) and purpose in HELD_OUT:
            groups.setdefault((reflector, HELD_OUT[purpose]), []).append(shot)
    return tuple(
        _measured(by_name[reflector], group, instrument, held_out=held_out)
        for (reflector, held_out), group in groups.items()
    )


def _measured(
    carrier: Object,
    shots: Sequence[AcceptedShot],
    instrument: TrackerUncertainty,
    *,
    held_out: bool,
) -> Measured:
    outcomes = [shot.outcome for shot in shots]
    points_mm = np.array([outcome.point_in_tracker_mm for outcome in outcomes])
    by_sheet = point_covariance_mm2(points_mm, instrument)
    variances = [
        np.diag(sheet if outcome.covariance_mm2 is None else np.array(outcome.covariance_mm2))
        for outcome, sheet in zip(outcomes, by_sheet, strict=True)
    ]
    return Measured(
        kind=KIND,
        object=carrier,
        joints=np.array([outcome.joints for outcome in outcomes]),
        values=points_mm,
        std_mm=np.sqrt(variances),
        held_out=held_out,
        moment=np.array([_seconds(shot.measured_utc) for shot in shots]),
        session=np.array([max(shot.session, 1) for shot in shots], dtype=np.intp),
    )


def _seconds(measured_utc: str) -> float:
    """Return the seconds since 1970 of a time in the journal."""
    return datetime.fromisoformat(measured_utc).timestamp()
