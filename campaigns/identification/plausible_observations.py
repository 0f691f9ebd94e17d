"""Plausibility of observations of other kinds than points, judged by the nominal robot.

A fit cannot distinguish callipers in centimetres from a part that shrank by nine tenths. Only the
nominal robot contradicts it: with the surroundings that fit it best its values must be the measured
ones, nearly so before any fit of its own. If they are not, the values are tried in the other units
and with the other sign; a reading that fits far better names the cause. Half of the rows decide, so
that single wrong ones are no cause. What a tracker took is judged with its points.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ObservationsInvalid, ShotsMissing
from campaigns.evaluation.readings import UNITS
from campaigns.fit.kinds import KINDS, differentiate
from campaigns.identification.objects import Object
from campaigns.identification.observed import measured_of
from campaigns.identification.other_kinds import Measured, OtherKinds, bodies_of, other_kinds
from campaigns.kinematics.model import Kinematics
from campaigns.shots.observations_csv import ObservationRow
from campaigns.shots.point_words import MM_PER_UNIT
from drivers.values import DISTANCE, SIGMA

BETTER_BY = 0.6
"""Ratio of misfits below which another reading is the cause."""
PLAUSIBLE_MM = 1.0
"""Misfit below which values are not doubted."""
NOMINAL_MM = 5.0
"""Misfit of a robot before any calibration; above it another reading is no cause either."""
LEAST_SPREAD_MM = 5.0
"""Spread of places below which they are one place, at which nothing is determined."""
ROUGH_SHRINKAGE_PERCENT = 5.0
"""Shrinkage that no part exceeds: where nothing is stated it would explain any unit."""


def check_observations(
    nominal: Kinematics,
    rows: Sequence[ObservationRow],
    objects: Sequence[Object],
    limit_mm: float,
    where: str,
) -> None:
    """Raise `ObservationsInvalid`, naming line or cause, for what cannot be this robot's.

    `where` names the file, `limit_mm` is the largest plausible misfit. Raise `OptionsInvalid` for
    an object that is not among the objects.
    """
    nominal = replace(nominal, mechanism=nominal.mechanism.body(None))  # no reflector moves along
    rough = tuple(_with_rough_shrinkage(thing) for thing in objects)
    measured = [replace(group, held_out=False) for group in measured_of(rows, rough)]
    for row in rows:
        _check_values(row, where)
    for name in dict.fromkeys(row.object for row in rows):
        _check_object(nominal, [m for m in measured if m.object.name == name], limit_mm, where)


def _with_rough_shrinkage(thing: Object) -> Object:
    if thing.shrinkage_std_percent is not None:
        return thing
    return replace(thing, shrinkage_std_percent=ROUGH_SHRINKAGE_PERCENT)


def _check_values(row: ObservationRow, where: str) -> None:
    """Raise `ObservationsInvalid` for a value or σ that no instrument measures."""
    marked = zip(row.values, KINDS[row.kind].angles, strict=True)
    of_value = [(value, "its value", DISTANCE.most) for value, is_angle in marked if not is_angle]
    for value, what, most in (*of_value, (row.std_mm, "its σ", SIGMA.most)):
        if abs(value) > most:
            raise ObservationsInvalid(
                f"{where}:{row.line}: {what} is {value:.6g} mm, limit {most:g} mm",
                remedy="correct the row, or the unit of its columns",
            )
    if row.kind == "distance" and row.values[0] <= 0.0:
        raise ObservationsInvalid(
            f"{where}:{row.line}: its value is {row.values[0]:g} mm, must be above 0",
            remedy="measure it again, or leave its rows out",
        )


def _check_object(
    nominal: Kinematics, measured: Sequence[Measured], limit_mm: float, where: str
) -> None:
    """Raise `ObservationsInvalid` where values fit far better in another unit, or never."""
    if any(KINDS[group.kind].by_tracker for group in measured):
        return
    name, plural = measured[0].object.name, KINDS[measured[0].kind].plural
    try:
        as_written = other_kinds(measured, nominal)
    except ShotsMissing:
        return  # too few to judge, which is refused by itself
    places = np.concatenate([block.near[..., :3].reshape(-1, 3) for block in as_written.fitted])
    spread_mm = float(np.ptp(places, axis=0).max())
    if spread_mm < LEAST_SPREAD_MM:
        raise ObservationsInvalid(
            f"{where}: all places of {name} are within {spread_mm:.2g} mm of each other, must be "
            f"{LEAST_SPREAD_MM:g} mm apart",
            remedy="give joints in the units of their columns, and measure at many places",
        )
    misfit_mm = _misfit(as_written, nominal)
    if misfit_mm <= PLAUSIBLE_MM:
        return
    causes = {
        cause: _misfit(other_kinds(meant, nominal), nominal) for cause, meant in _readings(measured)
    }
    cause = min(causes, key=lambda words: causes[words])
    if causes[cause] <= min(BETTER_BY * misfit_mm, NOMINAL_MM):
        raise ObservationsInvalid(
            f"{where}: {cause}: half of the {plural} of {name} are {misfit_mm:.3g} mm "
            f"or more from the nominal robot as written, {causes[cause]:.2g} mm so read",
            remedy="give values in mm, above the plane positive",
        )
    if misfit_mm > limit_mm:
        raise ObservationsInvalid(
            f"{where}: half of the {plural} of {name} are {misfit_mm:.3g} mm or more "
            f"from what the nominal robot has, limit {limit_mm:g} mm",
            remedy="look at the order of rows and joints, and whether this is the robot of "
            "robot.yaml; a robot that is so far off needs a larger gate.distance_mm",
        )


def _readings(measured: Sequence[Measured]) -> Iterator[tuple[str, Sequence[Measured]]]:
    """Yield causes by which values may be meant otherwise, with the values so read."""
    factors = {f"the values look like {UNITS[unit]}": mm for unit, mm in MM_PER_UNIT.items()}
    factors["the values seem to have the other sign"] = -1.0
    for cause, factor in factors.items():
        if factor != 1.0:
            yield cause, [replace(group, values=_scaled(group, factor)) for group in measured]


def _scaled(group: Measured, factor: float) -> Array:
    """Return values (M, v) with their lengths multiplied by a factor."""
    return np.asarray(group.values * np.where(KINDS[group.kind].angles, 1.0, factor))


def _misfit(kinds: OtherKinds, nominal: Kinematics) -> float:
    """Return the median residual of the nominal robot, with surroundings that fit it best, mm."""
    slots = {slot.name: slot.start for slot in kinds.slots}
    residuals = [
        np.linalg.norm(
            differentiate(
                block.kind,
                block.values,
                bodies_of(block, nominal),
                np.concatenate([slots[name] for name in block.slots]),
            ).residual,
            axis=1,
        )
        for block in kinds.fitted
    ]
    return float(np.median(np.concatenate(residuals)))
