"""Bodies of emScon packets, each a dataclass, its fields in the order of the wire.

A field's type says how it is written: `int` 32-bit integer (also enumerations and flags, 0 or 1),
`float` double, `Triple` three doubles, `str` text of 32 UTF-16 units. All little endian, without
padding: the interface's packing is 4 bytes, and every field has 4 bytes or a multiple of them.
Values are in the units that the client has set; the wire does not say which. Later firmware appends
fields to answers and results, which are passed over.
"""

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar, cast

from drivers.errors import WireError

Triple = tuple[float, float, float]

# 32 UTF-16 units, the last of which is NUL.
TEXT_BYTES = 64
FORMATS: Mapping[object, str] = {int: "i", float: "d", Triple: "3d", str: f"{TEXT_BYTES}s"}
"""Format in `struct` of a field, by its annotation."""


class Body:
    """Body that follows a packet's header, or a command's."""

    __slots__ = ()


BodyType = TypeVar("BodyType", bound=Body)


def annotations_of(kind: type[Body]) -> list[Any]:
    """Return the annotations of a body's fields in their order."""
    return [field.type for field in fields(cast("Any", kind))]


def layout_of(kind: type[Body]) -> struct.Struct:
    """Return the body's layout in bytes."""
    return struct.Struct("<" + "".join(FORMATS[form] for form in annotations_of(kind)))


def decode_body(kind: type[BodyType], data: bytes, *, may_be_longer: bool = False) -> BodyType:
    """Read a body; raises `WireError` unless it has its size.

    Bytes behind its fields are passed over if it `may_be_longer`.
    """
    layout = layout_of(kind)
    if len(data) < layout.size or (len(data) > layout.size and not may_be_longer):
        raise WireError(f"{kind.__name__} has {len(data)} bytes, {layout.size} are expected")
    values = iter(layout.unpack_from(data))
    # `unpack` gives a flat row of numbers; a field takes one of them, a triple takes three.
    make = cast("Callable[..., BodyType]", kind)
    return make(*(_field(form, values) for form in annotations_of(kind)))


def encode_body(body: Body) -> bytes:
    """Write a body; raises `ValueError` for a text that is too long."""
    values: list[Any] = []
    for field in fields(cast("Any", body)):
        value = getattr(body, field.name)
        if field.type == Triple:
            values += value
        else:
            values.append(_text_bytes(value) if field.type is str else value)
    return layout_of(type(body)).pack(*values)


def _field(form: object, values: Iterator[Any]) -> object:
    # Behind a text's first NUL an instrument may leave anything, half a surrogate pair too.
    if form == Triple:
        return next(values), next(values), next(values)
    value = next(values)
    return value.decode("utf-16-le", errors="replace").partition("\0")[0] if form is str else value


def _text_bytes(text: str) -> bytes:
    data = text.encode("utf-16-le")
    if len(data) > TEXT_BYTES - 2:
        raise ValueError(f"text '{text}' has more than {TEXT_BYTES // 2 - 1} UTF-16 units")
    return data.ljust(TEXT_BYTES, b"\0")


@dataclass(frozen=True, slots=True)
class Nothing(Body):
    """Body without parameters."""


@dataclass(frozen=True, slots=True)
class Code(Body):
    """One number: a reflector, `TrackerLight`, mode, or kind of coordinate system."""

    value: int


@dataclass(frozen=True, slots=True)
class SystemStatus(Body):
    """Start-up ladder, laser, distance meter, versions, weather station, serial number."""

    last_result_status: int
    processor_status: int
    laser_status: int
    adm_status: int
    version_major: int
    version_minor: int
    version_build: int
    weather_monitor: int
    flags: int
    serial: int


@dataclass(frozen=True, slots=True)
class Units(Body):
    """The units of everything that follows."""

    length: int
    angle: int
    temperature: int
    pressure: int
    humidity: int


@dataclass(frozen=True, slots=True)
class Environment(Body):
    """Air at the instrument."""

    temperature: float
    pressure: float
    humidity: float


@dataclass(frozen=True, slots=True)
class StationaryMode(Body):
    """Duration of one stationary measurement."""

    time_ms: int
    use_adm: int


@dataclass(frozen=True, slots=True)
class ReflectorEntry(Body):
    """Reflector, one of `total`; each comes in an answer of its own."""

    total: int
    identifier: int
    target_type: int
    surface_offset: float
    name: str


@dataclass(frozen=True, slots=True)
class SearchParams(Body):
    """Radius and time in which a reflector is looked for."""

    radius: float
    timeout_ms: int


@dataclass(frozen=True, slots=True)
class SystemSettings(Body):
    """Switches of the instrument."""

    # SetSystemSettings writes all of them: a switch is changed by reading and writing the whole.
    weather_monitor: int
    apply_transformation: int
    apply_station_orientation: int
    keep_last_position: int
    send_unsolicited_messages: int
    send_reflector_position: int
    try_measurement_mode: int
    has_nivel: int
    has_video_camera: int


@dataclass(frozen=True, slots=True)
class BeamTarget(Body):
    """Point that the beam is sent to."""

    point: Triple
    use_adm: int


@dataclass(frozen=True, slots=True)
class ApproximateDistance(Body):
    """Distance of a reflector, approximately."""

    distance: float


@dataclass(frozen=True, slots=True)
class Direction(Body):
    """Direction of the beam."""

    # In the angle unit that is set; the vertical angle is 0 at the zenith.
    horizontal: float
    vertical: float


@dataclass(frozen=True, slots=True)
class StatisticMode(Body):
    """A `Statistics` for stationary and one for continuous measurements."""

    stationary: int
    continuous: int


@dataclass(frozen=True, slots=True)
class MeasurementStatusInfo(Body):
    """A mask of `StatusBit`."""

    last_result_status: int
    bits: int


@dataclass(frozen=True, slots=True)
class TrackerInfo(Body):
    """Kind of the instrument; `sensor_type` is a key of `SENSOR_NAMES`."""

    # A tracker may lack this command. Only the first two fields are used here.
    sensor_type: int
    name: str
    serial: int
    compensation: int
    has_adm: int
    has_overview_camera: int
    has_nivel: int
    nivel_mount_offset: float
    longest_distance: float
    shortest_distance: float
    highest_data_rate: int
    faces: int
    horizontal_range: float
    vertical_range: float
    accuracy_model: int
    laser_firmware_major: int
    laser_firmware_minor: int


@dataclass(frozen=True, slots=True)
class ErrorResponse(Body):
    """An unasked error, such as a broken beam."""

    # On the wire it looks like a bare answer; only the packet's type (1, not 0) differs.
    command: int
    status: int


@dataclass(frozen=True, slots=True)
class StatusChange(Body):
    """Change of state, by this client or another; `code` may be a `SystemChange`."""

    # Of what comes unasked the only packet without a status.
    code: int


@dataclass(frozen=True, slots=True)
class ReflectorPosition(Body):
    """Live position of the reflector that is being followed."""

    status: int
    point: Triple


@dataclass(frozen=True, slots=True)
class SingleResult(Body):
    """A stationary measurement with standard statistics."""

    # `std` is the scatter that was observed in this measurement, `apriori_std` comes from the
    # instrument's accuracy model. Whether it is of a reading or of their mean is unconfirmed.
    status: int
    mode: int
    is_trial: int
    point: Triple
    std: Triple
    std_total: float
    pointing_error: Triple
    apriori_std: Triple
    apriori_std_total: float
    temperature: float
    pressure: float
    humidity: float


@dataclass(frozen=True, slots=True)
class SingleResult2(Body):
    """A stationary measurement with extended statistics; covariances in the order 12, 13, 23."""

    # Sent in place of `SingleResult` after SetStatisticMode extended. Covariances are taken to be
    # in squares of the unit of length (unconfirmed).
    status: int
    mode: int
    is_trial: int
    point: Triple
    std: Triple
    std_total: float
    covariance: Triple
    pointing_error: Triple
    apriori_std: Triple
    apriori_std_total: float
    apriori_covariance: Triple
    temperature: float
    pressure: float
    humidity: float
