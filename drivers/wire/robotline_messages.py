"""Messages of robotline as layout tables: millimetres and degrees, as on the wire.

`LAYOUT` says which words each message has, in their order. How many joints, coordinates and
parameters there are is the robot's: its `RobotLayout` counts.
"""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

from drivers.errors import WireError
from drivers.wire.robotline_words import Words, flag_word, name_word, number_word

VERSION = 1
FASTEST_PERCENT = 100.0
_OF_ARM = re.compile(r"arm([0-9]+)\.\w+")


@dataclass(frozen=True)
class RobotLayout:
    """Names of a robot's joints, coordinates and parameters, each with its unit (`q0_deg`).

    Parameters of an arm, `arm0.x_mm`, go into one line `ARM 0`; any other has a line of its own,
    `PLATE` for `plate_mm`. Each of `extensions`, `arm0.axis_tilt_deg`, has a line by its name; a
    controller may have none of them.
    """

    joints: tuple[str, ...]
    coordinates: tuple[str, ...]
    parameters: tuple[str, ...]
    extensions: tuple[str, ...] = ()

    @cached_property
    def parts(self) -> dict[str, tuple[str, ...]]:
        """Parameters of each line that every controller has, by the words that begin it."""
        parts: dict[str, tuple[str, ...]] = {}
        for name in self.parameters:
            arm = _OF_ARM.fullmatch(name)
            words = f"ARM {arm[1]}" if arm else name.rpartition("_")[0].upper()
            parts[words] = (*parts.get(words, ()), name)
        return parts

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
class Part:
    """Parameters of one arm or a single one: the words that name them, and their values."""

    name: str
    values: tuple[float, ...]

    def words(self) -> list[str]:
        """Words that name and tell them."""
        return [*self.name.split(), *map(number_word, self.values)]

    @classmethod
    def read(cls, words: Words, robot: RobotLayout) -> Self:
        """Part of a line."""
        name = _read_part_name(words, robot)
        return cls(name, tuple(words.number(each) for each in robot.names_of(name)))


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of a field: how it is written as words, and read from them."""

    # Any: the value's type is the field's, which no table can tell the type checker
    write: Callable[[Any], Sequence[str]]
    read: Callable[[Words, str, RobotLayout], Any]


def _read_part_name(words: Words, robot: RobotLayout) -> str:
    """`ARM` with a number, or the name of a single parameter."""
    singles = [name for name in robot.parts if " " not in name]
    word = words.word(" or ".join(["ARM", *singles]))
    if word in singles or word in robot.extensions:
        return word
    if word != "ARM":
        raise WireError(f"'{word}' is neither {' nor '.join(['ARM', *singles])}")
    name = f"ARM {words.whole('arm')}"
    if name not in robot.parts:
        last = len(robot.parts) - len(singles) - 1
        raise WireError(f"arm is {name.removeprefix('ARM ')}, not 0 to {last}")
    return name


def _read_speed(words: Words, name: str, _robot: RobotLayout) -> float:
    speed_percent = words.number(name)
    if not 0.0 < speed_percent <= FASTEST_PERCENT:
        raise WireError(f"speed_percent is {speed_percent:g}, not above 0 and up to 100")
    return speed_percent


def _numbers(values: Sequence[float]) -> list[str]:
    return [number_word(value) for value in values]


WHOLE = Kind(lambda value: [str(value)], lambda words, name, _: words.whole(name))
NUMBER = Kind(lambda value: [number_word(value)], lambda words, name, _: words.number(name))
FLAG = Kind(lambda value: [flag_word(value)], lambda words, name, _: words.flag(name))
NAME = Kind(lambda value: [name_word(value)], lambda words, name, _: words.name(name))
SPEED = Kind(lambda value: [number_word(value)], _read_speed)
JOINTS = Kind(_numbers, lambda words, _, robot: words.numbers(len(robot.joints), "joint"))
POSE = Kind(_numbers, lambda words, _, robot: words.numbers(len(robot.coordinates), "coordinate"))
PART_NAME = Kind(lambda name: name.split(), lambda words, _, robot: _read_part_name(words, robot))
PART = Kind(lambda part: part.words(), lambda words, _, robot: Part.read(words, robot))


class Message:
    """Fields and their words in the order of `LAYOUT`."""

    __slots__ = ()

    def words(self) -> list[str]:
        """Words of the message; raises `WireError` for a number that is not finite."""
        return [
            word
            for name, kind in LAYOUT.get(type(self), {}).items()
            for word in kind.write(getattr(self, name))
        ]

    @classmethod
    def read(cls, words: Words, robot: RobotLayout) -> Self:
        """Message of these words; raises `WireError`."""
        fields = LAYOUT.get(cls, {}).items()
        return cls(**{name: kind.read(words, name, robot) for name, kind in fields})


@dataclass(frozen=True, slots=True)
class Hello(Message):
    """Greets, and says which version of the protocol the client speaks."""

    verb: ClassVar[str] = "HELLO"
    version: int


@dataclass(frozen=True, slots=True)
class AskState(Message):
    """Question for what the encoders read now and whether anything is wrong."""

    verb: ClassVar[str] = "STATE"


@dataclass(frozen=True, slots=True)
class MoveJoints(Message):
    """Starts a move to joint values."""

    verb: ClassVar[str] = "MOVEJ"
    joints: tuple[float, ...]
    speed_percent: float


@dataclass(frozen=True, slots=True)
class MovePose(Message):
    """Starts a move to a pose by the controller's own kinematics."""

    verb: ClassVar[str] = "MOVEP"
    coordinates: tuple[float, ...]
    speed_percent: float


@dataclass(frozen=True, slots=True)
class Stop(Message):
    """Brings the robot to a stand at once."""

    verb: ClassVar[str] = "STOP"


@dataclass(frozen=True, slots=True)
class ReadPart(Message):
    """Question for the parameters of one part that the controller works with."""

    verb: ClassVar[str] = "GEOM"
    part: str


@dataclass(frozen=True, slots=True)
class Stage(Message):
    """Lays one part of a new parameter set ready, without any effect yet."""

    verb: ClassVar[str] = "STAGE"
    part: Part


@dataclass(frozen=True, slots=True)
class Commit(Message):
    """Puts all that was staged to work, or nothing."""

    verb: ClassVar[str] = "COMMIT"


@dataclass(frozen=True, slots=True)
class Abandon(Message):
    """Throws away what was staged."""

    verb: ClassVar[str] = "ABANDON"


@dataclass(frozen=True, slots=True)
class Greeting(Message):
    """Identity of the controller in its greeting."""

    version: int
    vendor: str
    model: str
    serial: str
    firmware: str
    axes: int


@dataclass(frozen=True, slots=True)
class Status(Message):
    """Readings of the encoders at that moment; `fault` is empty when there is none."""

    moving: bool
    emergency_stop: bool
    fault: str
    joints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Motion(Message):
    """A motion has been accepted and has begun."""

    expected_s: float


@dataclass(frozen=True, slots=True)
class Parameters(Message):
    """Parameters of one part as the controller works with them."""

    part: Part


@dataclass(frozen=True, slots=True)
class Done(Message):
    """Done, and nothing more to say."""


LAYOUT: Mapping[type[Message], Mapping[str, Kind]] = {
    Hello: {"version": WHOLE},
    MoveJoints: {"joints": JOINTS, "speed_percent": SPEED},
    MovePose: {"coordinates": POSE, "speed_percent": SPEED},
    ReadPart: {"part": PART_NAME},
    Stage: {"part": PART},
    Greeting: {
        "version": WHOLE,
        "vendor": NAME,
        "model": NAME,
        "serial": NAME,
        "firmware": NAME,
        "axes": WHOLE,
    },
    Status: {"moving": FLAG, "emergency_stop": FLAG, "fault": NAME, "joints": JOINTS},
    Motion: {"expected_s": NUMBER},
    Parameters: {"part": PART},
}
"""Words of each message in their order; what is missing here says everything by its verb."""

Command = Hello | AskState | MoveJoints | MovePose | Stop | ReadPart | Stage | Commit | Abandon
Answer = Greeting | Status | Motion | Done | Parameters

COMMANDS: Mapping[str, type[Command]] = {
    kind.verb: kind
    for kind in (Hello, AskState, MoveJoints, MovePose, Stop, ReadPart, Stage, Commit, Abandon)
}
ANSWERS: Mapping[str, type[Answer]] = {
    Hello.verb: Greeting,
    AskState.verb: Status,
    MoveJoints.verb: Motion,
    MovePose.verb: Motion,
    Stop.verb: Done,
    ReadPart.verb: Parameters,
    Stage.verb: Done,
    Commit.verb: Done,
    Abandon.verb: Done,
}
"""Answers by verb."""
