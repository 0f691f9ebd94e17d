"""The commands of robotline as values: millimetres and degrees, as on the wire."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import ClassVar, Self

from drivers.errors import WireError
from drivers.wire.robotline_geometry import Part, is_plate_next, read_arm, read_part
from drivers.wire.robotline_words import Wordless, Words, number_word

VERSION = 1
AXES = 4
FASTEST_PERCENT = 100.0


@dataclass(frozen=True, slots=True)
class Hello:
    """Greets, and says which version of the protocol the client speaks."""

    verb: ClassVar[str] = "HELLO"
    version: int

    def words(self) -> list[str]:
        """Write the words."""
        return [str(self.version)]

    @classmethod
    def read(cls, words: Words) -> Self:
        """Take the words."""
        return cls(words.whole("version"))


@dataclass(frozen=True, slots=True)
class AskState(Wordless):
    """Asks what the encoders read now and whether anything is wrong."""

    verb: ClassVar[str] = "STATE"


@dataclass(frozen=True, slots=True)
class MoveJoints:
    """Starts a move to joint angles."""

    verb: ClassVar[str] = "MOVEJ"
    joints_deg: tuple[float, ...]
    speed_percent: float

    def words(self) -> list[str]:
        """Write the words."""
        return [*map(number_word, self.joints_deg), number_word(self.speed_percent)]

    @classmethod
    def read(cls, words: Words) -> Self:
        """Take the words."""
        return cls(words.numbers(AXES, "joint"), _read_speed(words))


@dataclass(frozen=True, slots=True)
class MovePose:
    """Starts a move to a pose by the controller's own kinematics."""

    verb: ClassVar[str] = "MOVEP"
    x_mm: float
    y_mm: float
    z_mm: float
    theta_deg: float
    speed_percent: float

    def words(self) -> list[str]:
        """Write the words."""
        pose = (self.x_mm, self.y_mm, self.z_mm, self.theta_deg)
        return [*map(number_word, pose), number_word(self.speed_percent)]

    @classmethod
    def read(cls, words: Words) -> Self:
        """Take the words."""
        x_mm, y_mm, z_mm, theta_deg = words.numbers(4, "coordinate")
        return cls(x_mm, y_mm, z_mm, theta_deg, _read_speed(words))


def _read_speed(words: Words) -> float:
    speed_percent = words.number("speed_percent")
    if not 0.0 < speed_percent <= FASTEST_PERCENT:
        raise WireError(f"speed_percent is {speed_percent:g}, not above 0 and up to 100")
    return speed_percent


@dataclass(frozen=True, slots=True)
class Stop(Wordless):
    """Brings the robot to a stand at once."""

    verb: ClassVar[str] = "STOP"


@dataclass(frozen=True, slots=True)
class ReadArm:
    """Asks for the parameters of one arm that the controller works with."""

    verb: ClassVar[str] = "GEOM"
    arm: int

    def words(self) -> list[str]:
        """Write the words."""
        return ["ARM", str(self.arm)]


@dataclass(frozen=True, slots=True)
class ReadPlate:
    """Asks for the plate's parameter that the controller works with."""

    verb: ClassVar[str] = "GEOM"

    def words(self) -> list[str]:
        """Write the words."""
        return ["PLATE"]


def _read_geom(words: Words) -> ReadArm | ReadPlate:
    return ReadPlate() if is_plate_next(words) else ReadArm(read_arm(words))


@dataclass(frozen=True, slots=True)
class Stage:
    """Lays one part of a new parameter set ready, without any effect yet."""

    verb: ClassVar[str] = "STAGE"
    part: Part

    def words(self) -> list[str]:
        """Write the words."""
        return self.part.words()

    @classmethod
    def read(cls, words: Words) -> Self:
        """Take the words."""
        return cls(read_part(words))


@dataclass(frozen=True, slots=True)
class Commit(Wordless):
    """Puts all that was staged to work, or nothing."""

    verb: ClassVar[str] = "COMMIT"


@dataclass(frozen=True, slots=True)
class Abandon(Wordless):
    """Throws away what was staged."""

    verb: ClassVar[str] = "ABANDON"


Command = (
    Hello | AskState | MoveJoints | MovePose | Stop | ReadArm | ReadPlate | Stage | Commit | Abandon
)

READ_COMMAND: Mapping[str, Callable[[Words], Command]] = {
    Hello.verb: Hello.read,
    AskState.verb: AskState.read,
    MoveJoints.verb: MoveJoints.read,
    MovePose.verb: MovePose.read,
    Stop.verb: Stop.read,
    ReadArm.verb: _read_geom,
    Stage.verb: Stage.read,
    Commit.verb: Commit.read,
    Abandon.verb: Abandon.read,
}
