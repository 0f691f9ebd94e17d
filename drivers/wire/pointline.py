"""Grammar of pointline, our protocol for instruments, specified in docs/reference/pointline.md.

Millimetres, seconds, °C, hPa and % as on the wire, in the numbered lines of robotline. `VERBS` has
the question and the answer of each verb. An answer comes when the work is done, and nothing comes
unasked.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from drivers.values import Vector3
from drivers.wire.lines import Greeting, Hello, LineGrammar, Nothing

VERSION = 1
# Longer than robotline's 255: an answer to MEASURE has nine numbers of up to 24 characters.
LINE_BYTES = 511
"""The longest line; line feed and carriage return count."""


@dataclass(frozen=True, slots=True)
class ReadReflector:
    """Question for one of the reflectors that the instrument has definitions for, from 0."""

    index: int


@dataclass(frozen=True, slots=True)
class Prepare:
    """Preparation of what measuring needs: with this reflector, for so long a point."""

    reflector: str
    measuring_time_s: float


@dataclass(frozen=True, slots=True)
class GoTo:
    """Place to point at, and near which a reflector is locked onto."""

    point_mm: Vector3


@dataclass(frozen=True, slots=True)
class Find:
    """Search around the present direction for a reflector at about this distance."""

    distance_mm: float


@dataclass(frozen=True, slots=True)
class InstrumentStatus:
    """State of the instrument, and the reflector in use."""

    busy: bool
    initialised: bool
    warm: bool
    locked: bool
    reflector: str


@dataclass(frozen=True, slots=True)
class Air:
    """The air as the instrument uses it."""

    temperature_degC: float
    pressure_hPa: float
    humidity_percent: float


@dataclass(frozen=True, slots=True)
class ReflectorDefinition:
    """A reflector, and how many there are."""

    count: int
    name: str
    surface_offset_mm: float


@dataclass(frozen=True, slots=True)
class PointMeasured:
    """A point in the instrument's frame; `count` numbers its measurements, 0 where it has none.

    The covariance's terms are xx, xy, xz, yy, yz, zz, mm²; all 0 where none is stated.
    """

    count: int
    reflector: str
    point_mm: Vector3
    covariance_mm2: tuple[float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class BeamDirection:
    """Direction of the beam, in the instrument's frame; its length does not count."""

    direction: Vector3


VERBS: Mapping[str, tuple[type, type]] = {
    "HELLO": (Hello, Greeting),
    "STATE": (Nothing, InstrumentStatus),
    "AIR": (Nothing, Air),
    "REFLECTOR": (ReadReflector, ReflectorDefinition),
    "PREPARE": (Prepare, Nothing),
    "MEASURE": (Nothing, PointMeasured),
    "DIRECTION": (Nothing, BeamDirection),
    "GOTO": (GoTo, Nothing),
    "FIND": (Find, Nothing),
}
"""Question and answer of each verb."""
GRAMMAR = LineGrammar(VERBS, LINE_BYTES)
