"""What a total station does: turns, searches, follows the prism that is found, measures it."""

from collections.abc import Sequence
from math import atan2, cos, isfinite, sin

from drivers.errors import BeamBroken, DeviceRefused, NoReflector, NotAMeasurement, WireError
from drivers.geocom.accuracy import direction_rad, relative_humidity_percent
from drivers.geocom.client import (
    BEAM_LOST,
    BEAM_REMEDY,
    GeocomClient,
    any_number,
    not_locked,
    numbers,
    refused,
    whole,
)
from drivers.plausible import require, require_point
from drivers.values import PRESSURE, TEMPERATURE, Vector3, Weather, vector
from drivers.wire.framing import ascii_bytes
from drivers.wire.geocom import GeocomReply, decode_reply, parse_whole, parse_words
from drivers.wire.geocom_constants import FACE_2, INCLINATION_AUTO, LockStatus, Program, Result, Rpc

NARROWEST_RAD, WIDEST_RAD = 0.02, 0.5
"""Bounds of a search window: the field where a prism is seen without searching, half a room."""
MM_PER_M = 1e3
NORMAL_POSITIONING, UNUSED = 0, 0
ANYWHERE, TO_TARGET = 0, 1
"""Whether a motion ends where it was sent, or on the prism that is seen there."""
CANNOT_TURN_OVER = frozenset(
    {Result.COM_UNKNOWN_PROCEDURE, Result.NOT_IMPLEMENTED, Result.NOT_AVAILABLE}
)


def is_locked(client: GeocomClient) -> bool:
    """Whether the telescope follows a prism now."""
    return client.ask(Rpc.MOT_READ_LOCK_STATUS, _lock_status) is LockStatus.LOCKED


def require_lock(client: GeocomClient, doing: str) -> None:
    """Raise `BeamBroken` when the telescope doesn't follow a prism."""
    if not is_locked(client):
        raise not_locked(client.name, doing)


def require_prism(client: GeocomClient, doing: str) -> None:
    """Raise `NoReflector` when the telescope doesn't follow a prism before anything begins."""
    if not is_locked(client):
        lost = not_locked(client.name, doing)
        raise NoReflector(lost.problem, remedy=lost.remedy, code=lost.code)


def telescope_direction(client: GeocomClient) -> Vector3 | None:
    """Read the angles as a unit vector, X east, Y north, Z up; None when there are none."""
    angles = client.ask_or_none(Rpc.TMC_GET_ANGLE_5, numbers(2), INCLINATION_AUTO)
    if angles is None or not all(map(isfinite, angles)):
        return None
    hz, zenith = angles
    return sin(zenith) * sin(hz), sin(zenith) * cos(hz), cos(zenith)


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
    how = NORMAL_POSITIONING, TO_TARGET, UNUSED
    code = client.attempt(
        Rpc.AUT_MAKE_POSITIONING, hz_rad, v_rad, *how, within_s=client.deadlines.motion_s
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
        Rpc.AUT_SEARCH, window_rad, window_rad, UNUSED, within_s=client.deadlines.motion_s
    )
    _follow(client, "searching", code)


def use_face(client: GeocomClient, face: int) -> bool:
    """Be in a face (0, 1), following the prism; False where it cannot turn over into the second.

    Raises `BeamBroken` where the prism is not found after turning over.
    """
    present = _face(client)
    if present is None:
        return False  # nobody could tell whether it is back again
    if present == face:
        return True
    code = _turn_over(client, TO_TARGET)
    if code in CANNOT_TURN_OVER and face == FACE_2:
        return False
    _follow(client, "turning over", code)
    return True


def leave_second_face(client: GeocomClient) -> None:
    """Turn back an instrument that somebody, or a run that was cut off, left in its second face."""
    if _face(client) == FACE_2 and (code := _turn_over(client, ANYWHERE)):
        raise refused(client.name, "turning over", code)


def _face(client: GeocomClient) -> int | None:
    return client.ask_or_none(Rpc.TMC_GET_FACE, whole)


def _turn_over(client: GeocomClient, onto: int) -> int:
    how = NORMAL_POSITIONING, onto, UNUSED
    return client.attempt(Rpc.AUT_CHANGE_FACE, *how, within_s=client.deadlines.motion_s)


def _follow(client: GeocomClient, doing: str, code: int) -> None:
    """Lock on after a motion that ended with this code, or say why that cannot be."""
    if code := code or _lock(client):
        raise refused(client.name, doing, code)
    require_lock(client, doing)


def _lock(client: GeocomClient) -> int:
    """Aim finely at the prism in view and follow it; returns what failed, or OK."""
    within_s = client.deadlines.motion_s
    window = NARROWEST_RAD, NARROWEST_RAD, UNUSED
    code = client.attempt(Rpc.AUT_FINE_ADJUST, *window, within_s=within_s)
    return code or client.attempt(Rpc.AUT_LOCK_IN, within_s=within_s)


def _lock_status(words: Sequence[str]) -> LockStatus:
    try:
        return LockStatus(whole(words))
    except ValueError as error:
        raise WireError(f"{words[0]!r:.80} is no status of a lock") from error


MeasuredPoint = tuple[Vector3, int, GeocomReply]
"""Point in the instrument's frame, mm; when its distance was measured, by the instrument's clock,
ms, 0 where it doesn't say; and the reply, whose code warns of less than its full accuracy."""


def measure_point(client: GeocomClient, before_ms: int) -> MeasuredPoint:
    """Measure a distance and take the point, and clear both so that nothing can use them again.

    Raises `BeamBroken` when there is no distance, or when the angles are not the prism's, and
    `NotAMeasurement` when the distance is that of the point before, measured at `before_ms`.
    """
    clear = Rpc.TMC_DO_MEASURE, Program.CLEAR, INCLINATION_AUTO
    try:
        client.tell(Rpc.TMC_DO_MEASURE, Program.DISTANCE, INCLINATION_AUTO)
        point = _taken(client)
        _require_new(client.name, *point[1:], before_ms)
    except DeviceRefused:
        if client.attempt(*clear) != Result.OK:
            client.close()  # its distance may still come, and would be the next one's
        raise
    client.tell(*clear)
    return point


def weather_set(client: GeocomClient) -> Weather:
    """Read the air as the operator has set it: a total station measures none itself."""
    _wavelength, pressure_hPa, dry_degC, wet_degC = client.ask(Rpc.TMC_GET_ATM_CORR, numbers(4))
    require(client.name, PRESSURE, pressure_hPa)
    require(client.name, TEMPERATURE, dry_degC)
    require(client.name, TEMPERATURE, wet_degC, which="wet air temperature")
    humidity_percent = relative_humidity_percent(dry_degC, wet_degC, pressure_hPa)
    return Weather(dry_degC, pressure_hPa, humidity_percent)


def read_coordinates(words: Sequence[str]) -> tuple[Vector3, int]:
    """Point in mm and the time in ms at which its distance was measured; raises `WireError`.

    East, north, height and their time; behind them, the same of the present angles.
    """
    east, north, height, at_ms, *present, _present_at_ms = parse_words(words, 8)
    for word in present:
        any_number(word)
    return vector(MM_PER_M * any_number(word) for word in (east, north, height)), parse_whole(at_ms)


def point_said(raw: str) -> Vector3:
    """Point, mm, of an answer with coordinates as records keep it; raises `WireError`."""
    point_mm, _ = read_coordinates(decode_reply(ascii_bytes(raw)).parameters)
    return point_mm


def _taken(client: GeocomClient) -> MeasuredPoint:
    wait_s = client.deadlines.distance_s
    (point_mm, distance_at_ms), reply = client.deliver(
        Rpc.TMC_GET_COORDINATE,
        read_coordinates,
        wait_s * 1000,
        INCLINATION_AUTO,
        within_s=wait_s + client.deadlines.answer_s,
    )
    if reply.code != Result.OK:
        _require_aimed(client, reply.line)
    require_point(client.name, point_mm)
    return point_mm, distance_at_ms, reply


def _require_new(where: str, at_ms: int, reply: GeocomReply, before_ms: int) -> None:
    """Refuse a distance by its time stamp, which no later one can have.

    Coordinates don't tell: they come rounded, and can be the same of a prism that stands still.
    """
    if at_ms == before_ms != 0:
        raise NotAMeasurement(
            f"{where}: the distance is that of the point before, by its time stamp of "
            f"{before_ms} ms ({reply.line})",
            remedy="measure again; if it comes back, restart the instrument",
        )


def _require_aimed(client: GeocomClient, raw: str) -> None:
    """Refuse a point whose angles are where the telescope happened to look."""
    if client.ask_or_none(Rpc.TMC_IF_DATA_AZE_CORR_ERROR, whole):
        raise BeamBroken(
            f"{client.name}: the angles were not corrected by target recognition ({raw})",
            remedy=BEAM_REMEDY,
        )
