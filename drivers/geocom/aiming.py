"""Turning a total station, searching, and following the prism that is found."""

from math import atan2

from geocompy.geo.gcdata import ATR, ATRLock, Position

from drivers.errors import DeviceRefused
from drivers.geocom.accuracy import direction_rad
from drivers.geocom.client import GeocomClient
from drivers.geocom.errors import BEAM_LOST, not_locked, refused
from drivers.values import Vector3
from drivers.wire.geocom_constants import Result

NARROWEST_RAD, WIDEST_RAD = 0.02, 0.5
"""Of a search window: the field in which a prism is seen without searching, and half a room."""


def is_locked(client: GeocomClient) -> bool:
    """Tell whether the telescope follows a prism now."""
    return client.ask(lambda geocom: geocom.mot.get_lockon_status()) is ATRLock.LOCK


def require_lock(client: GeocomClient, doing: str) -> None:
    """Raise `BeamBroken` when the telescope doesn't follow a prism."""
    if not is_locked(client):
        raise not_locked(client.name, doing)


def lock_if_in_view(client: GeocomClient) -> None:
    """Follow the prism that is in view already, if there is one."""
    code = Result.OK if is_locked(client) else _lock(client)
    if code not in BEAM_LOST | {Result.OK}:
        raise refused(client.name, "locking on", code)


def turn_to(client: GeocomClient, point_mm: Vector3, radius_mm: float) -> None:
    """Turn to a point and follow the prism near it; raises `BeamBroken` when there is none."""
    direction = direction_rad(point_mm)
    if direction is None:
        raise DeviceRefused(
            f"{client.name}: cannot turn to {point_mm}: the instrument stands there itself",
            remedy="check the plan's points and the tracker's place",
        )
    hz_rad, v_rad, distance_mm = direction
    code = client.attempt(
        lambda geocom: geocom.aut.turn_to(hz_rad, v_rad, Position.NORMAL, ATR.TARGET),
        within_s=client.deadlines.motion_s,
    )
    if code in BEAM_LOST:
        search(client, distance_mm, radius_mm)
    else:
        _follow(client, "turning", code)


def search(client: GeocomClient, distance_mm: float, radius_mm: float) -> None:
    """Search around the present direction and follow what is found, else `BeamBroken`."""
    width_rad = 2.0 * atan2(radius_mm, max(distance_mm, 0.0))
    window_rad = min(max(width_rad, NARROWEST_RAD), WIDEST_RAD)
    code = client.attempt(
        lambda geocom: geocom.aut.search(window_rad, window_rad),
        within_s=client.deadlines.motion_s,
    )
    _follow(client, "searching", code)


def _follow(client: GeocomClient, doing: str, code: int) -> None:
    """Lock on after a motion that ended with this code, or say why that cannot be."""
    if code := code or _lock(client):
        raise refused(client.name, doing, code)
    require_lock(client, doing)


def _lock(client: GeocomClient) -> int:
    """Aim finely at the prism in view and follow it; returns what failed, or OK."""
    within_s = client.deadlines.motion_s
    code = client.attempt(
        lambda geocom: geocom.aut.fine_adjust(NARROWEST_RAD, NARROWEST_RAD), within_s=within_s
    )
    return code or client.attempt(lambda geocom: geocom.aut.lock_in(), within_s=within_s)
