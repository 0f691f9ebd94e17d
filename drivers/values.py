"""Values that devices give: millimetres, radians, seconds, degrees Celsius."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import chain

Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]


@dataclass(frozen=True, slots=True)
class Identity:
    """Identity of the device at the other end of a wire."""

    vendor: str
    model: str
    serial: str
    firmware: str
    protocol: str

    def __str__(self) -> str:
        version = f"{self.protocol}, firmware {self.firmware}"
        return f"{self.vendor} {self.model} serial {self.serial} ({version})"


@dataclass(frozen=True, slots=True)
class Bounds:
    """Bounds of a quantity that no real cell exceeds, in the unit in which it is shown."""

    quantity: str
    least: float
    most: float
    unit: str

    def holds(self, value: float) -> bool:
        """Return whether a value is within the bounds; NaN is not."""
        return self.least <= value <= self.most

    def text(self) -> str:
        """Return the bounds in words, for messages."""
        return f"{self.least:g} to {self.most:g}{self.unit}"


JOINT_ANGLE = Bounds("joint angle", -360.0, 360.0, "°")
"""Encoder angles of one turn, in degrees."""
JOINT_LENGTH = Bounds("joint length", -1e5, 1e5, " mm")
DISTANCE = Bounds("distance of a point from the tracker", 0.0, 200_000.0, " mm")
SIGMA = Bounds("standard deviation of a coordinate", 0.0, 100.0, " mm")
TEMPERATURE = Bounds("air temperature", -40.0, 70.0, " °C")
PART_TEMPERATURE = Bounds("temperature of the robot's parts", -40.0, 150.0, " °C")
PRESSURE = Bounds("air pressure", 300.0, 1200.0, " hPa")
HUMIDITY = Bounds("air humidity", 0.0, 110.0, " %")
"""Above 100 % for what a sensor says in wet air."""


def vector(values: Iterable[float]) -> Vector3:
    """Return three plain floats."""
    x, y, z = map(float, values)
    return x, y, z


@dataclass(frozen=True, slots=True)
class Coordinate:
    """Joint or coordinate of a robot: an angle, rad inside and deg outside, or a length in mm."""

    name: str
    is_angle: bool
    is_fixed: bool = False
    """Whether it is always 0: the robot moves in a plane."""


def outer_units(coordinates: Sequence[Coordinate], values: Sequence[float]) -> tuple[float, ...]:
    """Convert values in rad and mm to deg and mm."""
    pairs = zip(coordinates, values, strict=True)
    return tuple(math.degrees(value) if axis.is_angle else value for axis, value in pairs)


def inner_units(coordinates: Sequence[Coordinate], values: Sequence[float]) -> tuple[float, ...]:
    """Convert values in deg and mm to rad and mm."""
    pairs = zip(coordinates, values, strict=True)
    return tuple(math.radians(value) if axis.is_angle else value for axis, value in pairs)


@dataclass(frozen=True, slots=True)
class Pose:
    """The controlled point in the base frame, and the platform's turns where it turns."""

    x_mm: float
    y_mm: float
    z_mm: float
    theta_rad: float | None = None
    """Turn about z of a platform with one turn."""
    rotation_rad: Vector3 | None = None
    """Rotation vector, in the base frame, of a platform with three turns."""

    @property
    def coordinates(self) -> tuple[float, ...]:
        """Task coordinates in the order of the mechanism's axes, mm and rad."""
        turns = self.rotation_rad or (() if self.theta_rad is None else (self.theta_rad,))
        return (self.x_mm, self.y_mm, self.z_mm, *turns)


@dataclass(frozen=True, slots=True)
class RobotState:
    """Reading of a controller: `fault` is empty without one, `raw` is the answer as sent.

    Joints are as its encoders read them, rad or mm.
    """

    joints: tuple[float, ...]
    moving: bool
    fault: str
    emergency_stop: bool
    raw: str = ""


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
    """Stationary measurement in the tracker's frame, with the instrument's own covariance.

    None: an instrument that states no covariance, one that knows nothing of the air.
    """

    point_in_tracker_mm: Vector3
    covariance_mm2: Matrix3 | None
    weather: Weather | None
    raw: str = ""
    """The answer as sent."""


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
    ignored_packets: int = 0
    """Of this connection: of unknown kinds, and states that were not asked for."""


LEAST_DETERMINANT = 1e-12
"""Least determinant of correlations; below, one direction is known a million times better."""


def is_positive_definite(matrix: Matrix3, least_determinant: float = LEAST_DETERMINANT) -> bool:
    """Return whether a matrix can be a covariance, by Sylvester's criterion on its correlations."""
    # Correlations have no unit, so that one least determinant suits every unit and size. Each root
    # is divided by on its own: a product of two variances could underflow to 0 or overflow.
    if not all(math.isfinite(value) for value in chain.from_iterable(matrix)):
        return False
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
    if min(xx, yy, zz) <= 0.0:
        return False
    r_xy = xy / math.sqrt(xx) / math.sqrt(yy)
    r_xz = xz / math.sqrt(xx) / math.sqrt(zz)
    r_yz = yz / math.sqrt(yy) / math.sqrt(zz)
    if max(abs(r_xy), abs(r_xz), abs(r_yz)) >= 1.0:
        return False
    determinant = 1.0 + 2.0 * r_xy * r_xz * r_yz - r_xy**2 - r_xz**2 - r_yz**2
    return determinant > least_determinant


class NoValue(Enum):
    """Answer of an operator who reads no value off an instrument."""

    SKIPPED = "skipped by the operator"
    BACK = "the one before is read again"
