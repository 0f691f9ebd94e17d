"""Grammar of pointline, our protocol for instruments: docs/pointline.md is its specification.

Millimetres, seconds, °C, hPa and % as on the wire, in the numbered lines of robotline. `MESSAGES`
says which command each verb is, and what is answered; `FIELDS` of a message, which words it has:
`p` is x, y, z, `k` the six terms of a covariance.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from drivers.values import Vector3
from drivers.wire.numbered_lines import (
    CommandDone,
    Hello,
    LineGrammar,
    LineMessage,
    LineOrder,
    LineReply,
    LineRequest,
    LineWords,
)

VERSION = 1
LINE_BYTES = 511
"""The longest line; line feed and carriage return count."""

Covariance = tuple[float, float, float, float, float, float]
"""Terms xx, xy, xz, yy, yz, zz, mm²; all 0 where the instrument states none."""


class Order(LineOrder):
    """Command of a verb alone."""

    STATE = "STATE"
    """Could a point be measured now, and what is missing?"""
    AIR = "AIR"
    """Which air does the instrument correct for?"""
    MEASURE = "MEASURE"
    """Measure the reflector where it is now."""
    DIRECTION = "DIRECTION"
    """Where does the beam point?"""


@dataclass(frozen=True, slots=True)
class ReadReflector(LineMessage):
    """Question for one of the reflectors that the instrument has definitions for, from 0."""

    FIELDS = "w"
    index: int


@dataclass(frozen=True, slots=True)
class Prepare(LineMessage):
    """Brings the instrument to what measuring needs: with this reflector, for so long a point."""

    FIELDS = "nd"
    reflector: str
    measuring_time_s: float


@dataclass(frozen=True, slots=True)
class GoTo(LineMessage):
    """Points at a place, and locks onto the reflector found near it."""

    FIELDS = "p"
    point_mm: Vector3


@dataclass(frozen=True, slots=True)
class Find(LineMessage):
    """Searches around the present direction at about that distance."""

    FIELDS = "d"
    distance_mm: float


@dataclass(frozen=True, slots=True)
class InstrumentGreeting(LineMessage):
    """Identity of the instrument in its greeting."""

    FIELDS = "wnnnn"
    version: int
    vendor: str
    model: str
    serial: str
    firmware: str


@dataclass(frozen=True, slots=True)
class InstrumentStatus(LineMessage):
    """State of the instrument, and the reflector in use."""

    FIELDS = "ffffn"
    busy: bool
    initialised: bool
    warm: bool
    locked: bool
    reflector: str


@dataclass(frozen=True, slots=True)
class Air(LineMessage):
    """The air as the instrument uses it."""

    FIELDS = "ddd"
    temperature_degC: float
    pressure_hPa: float
    humidity_percent: float


@dataclass(frozen=True, slots=True)
class ReflectorDefinition(LineMessage):
    """A reflector, and how many there are."""

    FIELDS = "wnd"
    count: int
    name: str
    surface_offset_mm: float


@dataclass(frozen=True, slots=True)
class PointMeasured(LineMessage):
    """A point in the instrument's frame; `count` numbers its measurements, 0 where it has none."""

    FIELDS = "wnpk"
    count: int
    reflector: str
    point_mm: Vector3
    covariance_mm2: Covariance


@dataclass(frozen=True, slots=True)
class BeamDirection(LineMessage):
    """Direction of the beam, in the instrument's frame; its length does not count."""

    FIELDS = "p"
    direction: Vector3


Command = Hello | ReadReflector | Prepare | GoTo | Find | Order
Answer = (
    InstrumentGreeting
    | InstrumentStatus
    | Air
    | ReflectorDefinition
    | PointMeasured
    | BeamDirection
    | CommandDone
)
MESSAGES: Mapping[str, tuple[type[LineMessage] | Order, type[Answer]]] = {
    "HELLO": (Hello, InstrumentGreeting),
    "STATE": (Order.STATE, InstrumentStatus),
    "AIR": (Order.AIR, Air),
    "REFLECTOR": (ReadReflector, ReflectorDefinition),
    "PREPARE": (Prepare, CommandDone),
    "MEASURE": (Order.MEASURE, PointMeasured),
    "DIRECTION": (Order.DIRECTION, BeamDirection),
    "GOTO": (GoTo, CommandDone),
    "FIND": (Find, CommandDone),
}
"""Command and answer of each verb."""
PointlineRequest = LineRequest[Command]
PointlineReply = LineReply[Answer]


class Words(LineWords):
    """Words of a line of pointline."""

    def place(self, meaning: str) -> Vector3:
        """Take x, y, z."""
        x, y, z = (self.number(f"{axis} of {meaning}") for axis in "xyz")
        return x, y, z

    def covariance(self, _meaning: str) -> Covariance:
        """Take the six terms of a covariance."""
        xx, xy, xz, yy, yz, zz = map(self.number, ("xx", "xy", "xz", "yy", "yz", "zz"))
        return xx, xy, xz, yy, yz, zz

    READERS: ClassVar = {**LineWords.READERS, "p": place, "k": covariance}


GRAMMAR: LineGrammar[Command, Answer] = LineGrammar(MESSAGES, LINE_BYTES, Words)
