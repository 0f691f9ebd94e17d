"""Bodies of emScon packets, each a dataclass, its fields in the order of the wire.

Values are in the units that the client has chosen; the wire doesn't say which.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields
from typing import Any, ClassVar, TypeVar, cast

from drivers.errors import WireError

Triple = tuple[float, float, float]

TEXT_BYTES = 64
_STRUCT_CODES = {"i": "i", "d": "d", "v": "ddd", "s": f"{TEXT_BYTES}s"}


class Body:
    """Body that follows a packet's header, or a command's."""

    __slots__ = ()
    LAYOUT: ClassVar[str] = ""

    def describe(self) -> str:
        """Say to people what came by itself."""
        return f"unasked: {self}"


BodyType = TypeVar("BodyType", bound=Body)


def layout_of(kind: type[Body]) -> struct.Struct:
    """Return the body's layout in bytes."""
    return struct.Struct("<" + "".join(_STRUCT_CODES[code] for code in kind.LAYOUT))


def decode_body(kind: type[BodyType], data: bytes, *, may_be_longer: bool = False) -> BodyType:
    """Read a body; raises `WireError` unless it has its size.

    Later firmware appends fields: where it `may_be_longer`, they are passed over.
    """
    layout = layout_of(kind)
    if len(data) < layout.size or (len(data) > layout.size and not may_be_longer):
        raise WireError(f"{kind.__name__} has {len(data)} bytes, {layout.size} are expected")
    values = iter(layout.unpack_from(data))
    make = cast("Callable[..., BodyType]", kind)
    return make(*(_field(code, values) for code in kind.LAYOUT))


def encode_body(body: Body) -> bytes:
    """Write a body; raises `ValueError` for a text that is too long."""
    values: list[Any] = []
    for code, slot in zip(body.LAYOUT, fields(cast("Any", body)), strict=True):
        value = getattr(body, slot.name)
        values += value if code == "v" else [_text_bytes(value) if code == "s" else value]
    return layout_of(type(body)).pack(*values)


def _field(code: str, values: Iterator[Any]) -> object:
    if code == "v":
        return next(values), next(values), next(values)
    value = next(values)
    return _text(value) if code == "s" else value


def _text(data: bytes) -> str:
    return data.decode("utf-16-le", errors="replace").partition("\0")[0]


def _text_bytes(text: str) -> bytes:
    data = text.encode("utf-16-le")
    if len(data) > TEXT_BYTES - 2:
        raise ValueError(f"text '{text}' has more than {TEXT_BYTES // 2 - 1} UTF-16 units")
    return data.ljust(TEXT_BYTES, b"\0")


@dataclass(frozen=True, slots=True)
class Nothing(Body):
    """Body without parameters."""


@dataclass(frozen=True, slots=True)
class SystemStatus(Body):
    """Start-up ladder, laser, distance meter, versions, weather station, serial number."""

    LAYOUT: ClassVar[str] = "iiiiiiiiii"
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
class TrackerStatus(Body):
    """The traffic light, a `TrackerLight`."""

    LAYOUT: ClassVar[str] = "i"
    light: int


@dataclass(frozen=True, slots=True)
class Units(Body):
    """The units of everything that follows."""

    LAYOUT: ClassVar[str] = "iiiii"
    length: int
    angle: int
    temperature: int
    pressure: int
    humidity: int


@dataclass(frozen=True, slots=True)
class Environment(Body):
    """Air at the instrument."""

    LAYOUT: ClassVar[str] = "ddd"
    temperature: float
    pressure: float
    humidity: float


@dataclass(frozen=True, slots=True)
class StationOrientation(Body):
    """Pose of the instrument, which it applies to points where its switches say so."""

    LAYOUT: ClassVar[str] = "vv"
    place: Triple
    rotation: Triple


@dataclass(frozen=True, slots=True)
class Transformation(Body):
    """Similarity that it applies to points where its switches say so."""

    LAYOUT: ClassVar[str] = "vvd"
    place: Triple
    rotation: Triple
    scale: float


@dataclass(frozen=True, slots=True)
class Refraction(Body):
    """Refractive indices for the interferometer and for the distance meter."""

    LAYOUT: ClassVar[str] = "dd"
    interferometer: float
    distance_meter: float


@dataclass(frozen=True, slots=True)
class MeasurementMode(Body):
    """A `Mode`."""

    LAYOUT: ClassVar[str] = "i"
    mode: int


@dataclass(frozen=True, slots=True)
class CoordinateSystem(Body):
    """A `CoordinateSystemType`."""

    LAYOUT: ClassVar[str] = "i"
    kind: int


@dataclass(frozen=True, slots=True)
class StationaryMode(Body):
    """Duration of one stationary measurement."""

    LAYOUT: ClassVar[str] = "ii"
    time_ms: int
    use_adm: int


@dataclass(frozen=True, slots=True)
class ReflectorChoice(Body):
    """The reflector in use."""

    LAYOUT: ClassVar[str] = "i"
    identifier: int


@dataclass(frozen=True, slots=True)
class ReflectorEntry(Body):
    """Reflector, one of `total`; each comes in an answer of its own."""

    LAYOUT: ClassVar[str] = "iiids"
    total: int
    identifier: int
    target_type: int
    surface_offset: float
    name: str


@dataclass(frozen=True, slots=True)
class SearchParams(Body):
    """Radius and time in which a reflector is looked for."""

    LAYOUT: ClassVar[str] = "di"
    radius: float
    timeout_ms: int


@dataclass(frozen=True, slots=True)
class SystemSettings(Body):
    """Switches of the instrument."""

    LAYOUT: ClassVar[str] = "iiiiiiiii"
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

    LAYOUT: ClassVar[str] = "vi"
    point: Triple
    use_adm: int


@dataclass(frozen=True, slots=True)
class ApproximateDistance(Body):
    """Distance of a reflector, approximately."""

    LAYOUT: ClassVar[str] = "d"
    distance: float


@dataclass(frozen=True, slots=True)
class Direction(Body):
    """Direction of the beam."""

    LAYOUT: ClassVar[str] = "dd"
    horizontal: float
    vertical: float


@dataclass(frozen=True, slots=True)
class StatisticMode(Body):
    """A `Statistics` for stationary and one for continuous measurements."""

    LAYOUT: ClassVar[str] = "ii"
    stationary: int
    continuous: int


@dataclass(frozen=True, slots=True)
class ReflectorPlace(Body):
    """Point at which a reflector is measured."""

    LAYOUT: ClassVar[str] = "v"
    point: Triple


@dataclass(frozen=True, slots=True)
class Face(Body):
    """A `TelescopeFace`."""

    LAYOUT: ClassVar[str] = "i"
    face: int


@dataclass(frozen=True, slots=True)
class SoftwareVersion(Body):
    """The controller's software, in its own words."""

    LAYOUT: ClassVar[str] = "s"
    version: str


@dataclass(frozen=True, slots=True)
class MeasurementStatusInfo(Body):
    """A mask of `StatusBit`."""

    LAYOUT: ClassVar[str] = "ii"
    last_result_status: int
    bits: int


@dataclass(frozen=True, slots=True)
class TrackerInfo(Body):
    """Kind of the instrument; `sensor_type` is a key of `SENSOR_NAMES`."""

    LAYOUT: ClassVar[str] = "isiiiiidddiiddiii"
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
    """An error that nobody asked for, such as a broken beam."""

    LAYOUT: ClassVar[str] = "ii"
    command: int
    status: int


@dataclass(frozen=True, slots=True)
class StatusChange(Body):
    """Change of state, by this client or another; `code` may be a `SystemChange`."""

    LAYOUT: ClassVar[str] = "i"
    code: int


@dataclass(frozen=True, slots=True)
class ReflectorPosition(Body):
    """Live position of the reflector that is being followed."""

    LAYOUT: ClassVar[str] = "iv"
    status: int
    point: Triple


@dataclass(frozen=True, slots=True)
class SingleResult(Body):
    """A stationary measurement with standard statistics."""

    LAYOUT: ClassVar[str] = "iiivvdvvdddd"
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

    LAYOUT: ClassVar[str] = "iiivvdvvvdvddd"
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
