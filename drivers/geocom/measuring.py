"""One distance measurement of a total station, from its start to a point in mm."""

from dataclasses import dataclass

from geocompy.geo.gcdata import Measurement as Program

from drivers.errors import BeamBroken, DeviceRefused
from drivers.geocom.air import relative_humidity_percent
from drivers.geocom.client import GeocomClient
from drivers.geocom.errors import BEAM_REMEDY
from drivers.values import Vector3, Weather

MM_PER_M = 1e3


@dataclass(frozen=True, slots=True)
class MeasuredPoint:
    """A point in the instrument's frame; `warned`: it doesn't vouch for its full accuracy."""

    point_mm: Vector3
    warned: bool
    raw: str


def measure_point(client: GeocomClient) -> MeasuredPoint:
    """Measure a distance and take the point, and clear both so that nothing can use them again.

    Raises `BeamBroken` when there is no distance, or when the angles are not the prism's.
    """
    try:
        client.tell(lambda geocom: geocom.tmc.do_measurement(Program.DISTANCE))
        point = _taken(client)
    except DeviceRefused:
        client.attempt(lambda geocom: geocom.tmc.do_measurement(Program.CLEAR))
        raise
    client.tell(lambda geocom: geocom.tmc.do_measurement(Program.CLEAR))
    return point


def weather_set(client: GeocomClient) -> Weather:
    """Read the air as the operator has set it: a total station measures none itself."""
    _wavelength, pressure_hPa, dry_degC, wet_degC = client.ask(
        lambda geocom: geocom.tmc.get_atmospheric_corrections()
    )
    client.require_finite(pressure_hPa, dry_degC, wet_degC)
    humidity_percent = relative_humidity_percent(dry_degC, wet_degC, pressure_hPa)
    return Weather(dry_degC, pressure_hPa, humidity_percent)


def _taken(client: GeocomClient) -> MeasuredPoint:
    wait_s = client.deadlines.distance_s
    found = client.deliver(
        lambda geocom: geocom.tmc.get_coordinate(wait_s),
        within_s=wait_s + client.deadlines.answer_s,
    )
    if found.warned:
        _require_aimed(client, found.raw)
    place = found.values[0]
    point_mm = (MM_PER_M * place.e, MM_PER_M * place.n, MM_PER_M * place.h)
    client.require_finite(*point_mm)
    return MeasuredPoint(point_mm, warned=found.warned, raw=found.raw)


def _require_aimed(client: GeocomClient, raw: str) -> None:
    """Refuse a point whose angles are where the telescope happened to look."""
    if client.ask_or_none(lambda geocom: geocom.tmc.was_not_atr_corrected()):
        raise BeamBroken(
            f"{client.name}: the angles were not corrected by target recognition ({raw})",
            remedy=BEAM_REMEDY,
        )
