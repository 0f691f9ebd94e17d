"""Grammar of robotline, our protocol for controllers, specified in docs/reference/robotline.md.

Millimetres and degrees, as on the wire. `VERBS` has the question and the answer of each verb. The
numbers of joints, coordinates and parameters are the robot's: its `RobotLayout` counts them, and a
message with another count is refused like one that is badly written.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

from drivers.errors import WireError
from drivers.values import Coordinate
from drivers.wire.lines import Greeting, Hello, LineGrammar, Nothing, Title

VERSION = 1
LINE_BYTES = 255
"""The longest line; line feed and carriage return count."""
FASTEST_PERCENT = 100.0
MOST_COORDINATES = 4
"""x, y, z and theta of MOVEP."""


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
        """Lay out parameters by name, arm and stem: one of no arm has a line `STEM`."""
        # The order of the parameters is that of the numbers in a line, and of the lines.
        parts: dict[str, tuple[str, ...]] = {}
        for name, arm, stem in parameters:
            words = stem.upper() if arm is None else f"ARM {arm}"
            parts[words] = (*parts.get(words, ()), name)
        return cls(tuple(joints), tuple(coordinates), parts, tuple(extensions))

    @cached_property
    def has_movep(self) -> bool:
        """Whether its poses are those of MOVEP: x, y, z, and theta if its platform turns."""
        is_in_plane = any(axis.is_fixed for axis in self.coordinates)
        return not is_in_plane and len(self.coordinates) <= MOST_COORDINATES

    @cached_property
    def parameters(self) -> frozenset[str]:
        """Names of the parameters that every controller has."""
        return frozenset(name for names in self.parts.values() for name in names)

    @cached_property
    def extension_kinds(self) -> tuple[tuple[str, ...], ...]:
        """Names of the extensions, those of a kind (`axis_tilt_deg`) of all arms together."""
        by_kind: dict[str, tuple[str, ...]] = {}
        for name in self.extensions:
            kind = name.rpartition(".")[2]
            by_kind[kind] = (*by_kind.get(kind, ()), name)
        return tuple(by_kind.values())

    def parts_of(self, parameters: Mapping[str, float]) -> "Iterator[Part]":
        """Yield the lines of a whole parameter set; raises `KeyError` for one that is missing."""
        for words, names in self.parts.items():
            yield Part(Title(words), tuple(parameters[name] for name in names))
        # Only those of the set: a controller refuses the line of a parameter that it lacks.
        for name in self.extensions:
            if name in parameters:
                yield Part(Title(name), (parameters[name],))

    def names_of(self, words: str) -> tuple[str, ...]:
        """Return the parameters of a line by the words that begin it; raises `KeyError`."""
        return (words,) if words in self.extensions else self.parts[words]

    def flat(self, part: "Part") -> dict[str, float]:
        """Return the parameters of a line by their names."""
        return dict(zip(self.names_of(part.name), part.values, strict=True))

    def check(self, body: object) -> None:
        """Raise `WireError` for a message that is of another robot, or for an impossible speed."""
        # Messages that are not listed have nothing that depends on the robot.
        match body:
            case ControllerStatus(joints=joints):
                _require_count("joints", joints, len(self.joints))
            case MoveJoints(joints, speed_percent):
                _require_count("joints", joints, len(self.joints))
                _require_speed(speed_percent)
            case MovePose(coordinates, speed_percent):
                _require_count("coordinates", coordinates, len(self.coordinates))
                _require_speed(speed_percent)
            case ReadPart(name):
                self._require_part(name)
            case Part(name, values):
                self._require_part(name)
                _require_count(f"values of {name}", values, len(self.names_of(name)))

    def _require_part(self, name: str) -> None:
        if name not in self.parts and name not in self.extensions:
            raise WireError(f"'{name}' is not a part of this robot: {', '.join(self.parts)}")


def _require_count(what: str, values: tuple[float, ...], count: int) -> None:
    if len(values) != count:
        raise WireError(f"there are {len(values)} {what}, {count} are needed")


def _require_speed(percent: float) -> None:
    if not 0.0 < percent <= FASTEST_PERCENT:
        raise WireError(f"the speed is {percent:g}, not above 0 and up to 100")


@dataclass(frozen=True, slots=True)
class MoveJoints:
    """Start of a move to joint values."""

    joints: tuple[float, ...]
    speed_percent: float


@dataclass(frozen=True, slots=True)
class MovePose:
    """Start of a move to a pose by the controller's own kinematics."""

    coordinates: tuple[float, ...]
    speed_percent: float


@dataclass(frozen=True, slots=True)
class Part:
    """Parameters of one arm, or a single one, by the words that name them.

    As a question (STAGE) it is a part of a new set, which has no effect before COMMIT. As an answer
    (GEOM) it is what the controller works with.
    """

    name: Title
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ReadPart:
    """Question for the parameters of one part that the controller works with."""

    name: Title


@dataclass(frozen=True, slots=True)
class ControllerGreeting(Greeting):
    """Identity of the controller, and how many joints it moves."""

    axes: int


@dataclass(frozen=True, slots=True)
class ControllerStatus:
    """Readings of the encoders at that moment; `fault` is empty when there is none."""

    moving: bool
    emergency_stop: bool
    fault: str
    joints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class MotionBegun:
    """A motion has been accepted and has begun."""

    expected_s: float


VERBS: Mapping[str, tuple[type, type]] = {
    "HELLO": (Hello, ControllerGreeting),
    "STATE": (Nothing, ControllerStatus),
    "MOVEJ": (MoveJoints, MotionBegun),
    "MOVEP": (MovePose, MotionBegun),
    "STOP": (Nothing, Nothing),  # answered when braking has begun: STATE shows when it has ended
    "GEOM": (ReadPart, Part),
    "STAGE": (Part, Nothing),
    "COMMIT": (Nothing, Nothing),
    "ABANDON": (Nothing, Nothing),
}
"""Question and answer of each verb."""


def grammar(robot: RobotLayout) -> LineGrammar:
    """Return the grammar of a robot's lines."""
    return LineGrammar(VERBS, LINE_BYTES, robot.check)
