"""Grammar of robotline, our protocol for robot controllers: docs/robotline.md is its specification.

Millimetres and degrees, as on the wire. `MESSAGES` says which command each verb is, and what is
answered; `FIELDS` of a message, which words it has: `s` speed in percent, `j` joints, `c`
coordinates, `a` words that name a part, `v` the values of that part. How many joints, coordinates
and parameters there are is the robot's: its `RobotLayout` counts.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

from drivers.errors import WireError
from drivers.values import Coordinate
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
LINE_BYTES = 255
"""The longest line; line feed and carriage return count."""
FASTEST_PERCENT = 100.0


@dataclass(frozen=True)
class RobotLayout:
    """Joints, coordinates and parameters of a robot.

    Each of `extensions`, `arm0.axis_tilt_deg`, has a line by its name; a controller may have none
    of a kind.
    """

    joints: tuple[Coordinate, ...]
    coordinates: tuple[Coordinate, ...]
    parts: Mapping[str, tuple[str, ...]]
    """Parameters of each line that every controller has, by the words that begin it.

    Those of an arm, `arm0.x_mm`, are in one line `ARM 0`, any other in one of its own.
    """
    extensions: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        joints: Iterable[Coordinate],
        coordinates: Iterable[Coordinate],
        parameters: Iterable[tuple[str, int | None, str]],
        extensions: Iterable[str] = (),
    ) -> Self:
        """Layout of parameters by name, arm and stem: one of no arm has a line `STEM`."""
        parts: dict[str, tuple[str, ...]] = {}
        for name, arm, stem in parameters:
            words = stem.upper() if arm is None else f"ARM {arm}"
            parts[words] = (*parts.get(words, ()), name)
        return cls(tuple(joints), tuple(coordinates), parts, tuple(extensions))

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that every controller has."""
        return frozenset(name for names in self.parts.values() for name in names)

    @cached_property
    def extension_kinds(self) -> tuple[tuple[str, ...], ...]:
        """Extensions by what they are of each arm: `axis_tilt_deg`."""
        by_kind: dict[str, tuple[str, ...]] = {}
        for name in self.extensions:
            kind = name.rpartition(".")[2]
            by_kind[kind] = (*by_kind.get(kind, ()), name)
        return tuple(by_kind.values())

    def parts_of(self, parameters: Mapping[str, float]) -> "Iterator[Part]":
        """Lines that hold a whole parameter set; raises `KeyError` for one that is missing."""
        for words, names in self.parts.items():
            yield Part(words, tuple(parameters[name] for name in names))
        for name in self.extensions:
            if name in parameters:
                yield Part(name, (parameters[name],))

    def names_of(self, words: str) -> tuple[str, ...]:
        """Parameters of a line by the words that begin it; raises `KeyError`."""
        return (words,) if words in self.extensions else self.parts[words]

    def flat(self, part: "Part") -> dict[str, float]:
        """Parameters of a line by their names."""
        return dict(zip(self.names_of(part.name), part.values, strict=True))


@dataclass(frozen=True, slots=True)
class MoveJoints(LineMessage):
    """Starts a move to joint values."""

    FIELDS = "js"
    joints: tuple[float, ...]
    speed_percent: float


@dataclass(frozen=True, slots=True)
class MovePose(LineMessage):
    """Starts a move to a pose by the controller's own kinematics."""

    FIELDS = "cs"
    coordinates: tuple[float, ...]
    speed_percent: float


class Order(LineOrder):
    """Command of a verb alone."""

    STATE = "STATE"
    """What do the encoders read now, and is anything wrong?"""
    STOP = "STOP"
    """Bring the robot to a stand at once."""
    COMMIT = "COMMIT"
    """Put all that was staged to work, or nothing."""
    ABANDON = "ABANDON"
    """Throw away what was staged."""


@dataclass(frozen=True, slots=True)
class Part(LineMessage):
    """Parameters of one arm or a single one, by the words that name them.

    As a command: part of a new set, which is laid ready without any effect yet. As an answer: what
    the controller works with.
    """

    FIELDS = "av"
    name: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ReadPart(LineMessage):
    """Question for the parameters of one part that the controller works with."""

    FIELDS = "a"
    part: str


@dataclass(frozen=True, slots=True)
class ControllerGreeting(LineMessage):
    """Identity of the controller in its greeting."""

    FIELDS = "wnnnnw"
    version: int
    vendor: str
    model: str
    serial: str
    firmware: str
    axes: int


@dataclass(frozen=True, slots=True)
class ControllerStatus(LineMessage):
    """Readings of the encoders at that moment; `fault` is empty when there is none."""

    FIELDS = "ffnj"
    moving: bool
    emergency_stop: bool
    fault: str
    joints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class MotionBegun(LineMessage):
    """A motion has been accepted and has begun."""

    FIELDS = "d"
    expected_s: float


Told = Hello | MoveJoints | MovePose | ReadPart | Part
Command = Told | Order
Answer = ControllerGreeting | ControllerStatus | MotionBegun | CommandDone | Part
MESSAGES: Mapping[str, tuple[type[Told] | Order, type[Answer]]] = {
    "HELLO": (Hello, ControllerGreeting),
    "STATE": (Order.STATE, ControllerStatus),
    "MOVEJ": (MoveJoints, MotionBegun),
    "MOVEP": (MovePose, MotionBegun),
    "STOP": (Order.STOP, CommandDone),
    "GEOM": (ReadPart, Part),
    "STAGE": (Part, CommandDone),
    "COMMIT": (Order.COMMIT, CommandDone),
    "ABANDON": (Order.ABANDON, CommandDone),
}
"""Command and answer of each verb."""
RobotlineRequest = LineRequest[Command]
RobotlineReply = LineReply[Answer]


class Words(LineWords):
    """Words of a line of robotline."""

    def __init__(self, words: Sequence[str], robot: RobotLayout) -> None:
        super().__init__(words)
        self._robot = robot
        self._part = ""

    def speed(self, meaning: str) -> float:
        """Take a share of the full speed in percent."""
        value = self.number(meaning)
        if not 0.0 < value <= FASTEST_PERCENT:
            raise WireError(f"{meaning} is {value:g}, not above 0 and up to 100")
        return value

    def joints(self, _meaning: str) -> tuple[float, ...]:
        """Take as many numbers as the robot has joints."""
        return tuple(self.number(f"joint {index}") for index in range(len(self._robot.joints)))

    def coordinates(self, _meaning: str) -> tuple[float, ...]:
        """Take as many numbers as the robot has coordinates."""
        indices = range(len(self._robot.coordinates))
        return tuple(self.number(f"coordinate {index}") for index in indices)

    def part_name(self, _meaning: str) -> str:
        """Take `ARM` with a number, or the name of a single parameter."""
        parts = self._robot.parts
        singles = [name for name in parts if " " not in name]
        word = self.word(" or ".join(["ARM", *singles]))
        if word in singles or word in self._robot.extensions:
            self._part = word
            return word
        if word != "ARM":
            raise WireError(f"'{word}' is neither {' nor '.join(['ARM', *singles])}")
        name = f"ARM {self.whole('arm')}"
        if name not in parts:
            last = len(parts) - len(singles) - 1
            raise WireError(f"arm is {name.removeprefix('ARM ')}, not 0 to {last}")
        self._part = name
        return name

    def values(self, _meaning: str) -> tuple[float, ...]:
        """Take the values of the part that was named before."""
        return tuple(self.number(each) for each in self._robot.names_of(self._part))

    READERS: ClassVar = {
        **LineWords.READERS,
        "s": speed,
        "j": joints,
        "c": coordinates,
        "a": part_name,
        "v": values,
    }


def grammar(robot: RobotLayout) -> LineGrammar[Command, Answer]:
    """Grammar of a robot's lines."""
    return LineGrammar(MESSAGES, LINE_BYTES, lambda words: Words(words, robot))
