"""From a simulated shot to an emScon result packet's fields."""

from math import sqrt

from drivers.values import Vector3
from drivers.wire.emscon_constants import Mode
from drivers.wire.emscon_messages import SingleResult, SingleResult2
from drivers.wire.emscon_status import ResultStatus
from sim.servers.emscon_units import Scale
from sim.tracker.instrument import TrackerShot

NO_POINTING_ERROR: Vector3 = (0.0, 0.0, 0.0)
"""How far the beam was beside the reflector's centre; the simulated beam never is."""


def result_of(shot: TrackerShot, scale: Scale, *, extended: bool) -> SingleResult | SingleResult2:
    """Write a shot in the client's units.

    The covariance that it was drawn by stands for the observed and for the a-priori one.
    """
    point = scale.point(shot.point_in_tracker_mm)
    std = _std(shot, scale)
    total = sqrt(sum(value * value for value in std))
    air = scale.air((shot.temperature_degC, shot.pressure_hPa, shot.humidity_percent))
    head = (int(ResultStatus.ALL_OK), int(Mode.STATIONARY), 0, point, std, total)
    if not extended:
        return SingleResult(*head, NO_POINTING_ERROR, std, total, *air)
    mixed = _covariance(shot, scale)
    return SingleResult2(*head, mixed, NO_POINTING_ERROR, std, total, mixed, *air)


def _std(shot: TrackerShot, scale: Scale) -> Vector3:
    (xx, _, _), (_, yy, _), (_, _, zz) = shot.covariance_mm2
    return scale.point((sqrt(xx), sqrt(yy), sqrt(zz)))


def _covariance(shot: TrackerShot, scale: Scale) -> Vector3:
    """Return the covariances 12, 13 and 23: squares of lengths."""
    (_, xy, xz), (_, _, yz), _ = shot.covariance_mm2
    return scale.point(scale.point((xy, xz, yz)))
