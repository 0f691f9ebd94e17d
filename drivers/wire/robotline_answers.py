"""The answers of robotline as values: millimetres and degrees, as on the wire."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Self

from drivers.wire.robotline_commands import (
    AXES,
    Abandon,
    AskState,
    Commit,
    Hello,
    MoveJoints,
    MovePose,
    ReadArm,
    Stage,
    Stop,
)
from drivers.wire.robotline_geometry import ArmGeometry, PlateGeometry, read_part
from drivers.wire.robotline_words import Wordless, Words, flag_word, name_word, number_word


@dataclass(frozen=True, slots=True)
class Greeting:
    """Who the controller is."""

    version: int
    vendor: str
    model: str
    serial: str
    firmware: str
    axes: int

    def words(self) -> list[str]:
        """Write the words."""
        names = (self.vendor, self.model, self.serial, self.firmware)
        return [str(self.version), *map(name_word, names), str(self.axes)]

    @classmethod
    def read(cls, words: Words) -> Self:
        """Take the words."""
        return cls(
            version=words.whole("version"),
            vendor=words.name("vendor"),
            model=words.name("model"),
            serial=words.name("serial"),
            firmware=words.name("firmware"),
            axes=words.whole("axes"),
        )


@dataclass(frozen=True, slots=True)
class Status:
    """What the encoders read at that moment; `fault` is empty when there is none."""

    moving: bool
    emergency_stop: bool
    fault: str
    joints_deg: tuple[float, ...]

    def words(self) -> list[str]:
        """Write the words."""
        flags = [flag_word(self.moving), flag_word(self.emergency_stop)]
        return [*flags, name_word(self.fault), *map(number_word, self.joints_deg)]

    @classmethod
    def read(cls, words: Words) -> Self:
        """Take the words."""
        return cls(
            moving=words.flag("moving"),
            emergency_stop=words.flag("emergency stop"),
            fault=words.name("fault"),
            joints_deg=words.numbers(AXES, "joint"),
        )


@dataclass(frozen=True, slots=True)
class Motion:
    """A motion has been accepted and has begun."""

    expected_s: float

    def words(self) -> list[str]:
        """Write the words."""
        return [number_word(self.expected_s)]

    @classmethod
    def read(cls, words: Words) -> Self:
        """Take the words."""
        return cls(words.number("expected seconds"))


@dataclass(frozen=True, slots=True)
class Done(Wordless):
    """Done, and nothing more to say."""


Answer = Greeting | Status | Motion | Done | ArmGeometry | PlateGeometry

READ_ANSWER: Mapping[str, Callable[[Words], Answer]] = {
    Hello.verb: Greeting.read,
    AskState.verb: Status.read,
    MoveJoints.verb: Motion.read,
    MovePose.verb: Motion.read,
    Stop.verb: Done.read,
    ReadArm.verb: read_part,
    Stage.verb: Done.read,
    Commit.verb: Done.read,
    Abandon.verb: Done.read,
}
