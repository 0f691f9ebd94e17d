"""What devices say, as values: millimetres, radians, seconds, degrees Celsius."""

from dataclasses import dataclass
from enum import Enum

Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]


@dataclass(frozen=True, slots=True)
class Identity:
    """Who answers at the other end of a wire."""

    vendor: str
    model: str
    serial: str
    firmware: str
    protocol: str

    def __str__(self) -> str:
        version = f"{self.protocol}, firmware {self.firmware}"
        return f"{self.vendor} {self.model} serial {self.serial} ({version})"


@dataclass(frozen=True, slots=True)
class Pose:
    """The controlled point B'_0 in the base frame and the plate's natural rotation angle."""

    x_mm: float
    y_mm: float
    z_mm: float
    theta_rad: float


@dataclass(frozen=True, slots=True)
class RobotState:
    """One reading of a controller: `fault` is empty without one, `raw` is the answer as sent."""

    joints_rad: tuple[float, ...]
    moving: bool
    fault: str
    emergency_stop: bool
    raw: str


@dataclass(frozen=True, slots=True)
class Weather:
    """The air that the laser beam passes through."""

    temperature_degC: float
    pressure_hPa: float
    humidity_percent: float


@dataclass(frozen=True, slots=True)
class Reflector:
    """A reflector that the tracker knows, by the name its operator gave it."""

    name: str
    identifier: int
    surface_offset_mm: float


@dataclass(frozen=True, slots=True)
class Measurement:
    """One stationary measurement in the tracker's frame, with the instrument's own covariance."""

    point_in_tracker_mm: Vector3
    covariance_mm2: Matrix3
    weather: Weather
    raw: str


class Readiness(Enum):
    """The tracker's traffic light."""

    NOT_READY = "not ready"
    BUSY = "busy"
    READY = "ready"


@dataclass(frozen=True, slots=True)
class TrackerState:
    """Whether a measurement could be taken now, and if not, what is missing."""

    readiness: Readiness
    initialised: bool
    laser_warm: bool
    beam_locked: bool
    reflector: str
