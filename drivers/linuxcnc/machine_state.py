"""What LinuxCNC says of itself at one moment.

Its ACK says "received", its IDLE may be older than the motion, and after `wait done` one move in
sixty still runs. What has been found to hold: a motion is over when the *commanded* position is the
target, the program is idle, and the joints read the same several times in a row.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from drivers.errors import WireError
from drivers.linuxcnc.client import LinuxcncClient
from drivers.wire.linuxcncrsh import Value, read_numbers

JOINTS = 4
SAME_PLACE = 2e-6
"""mm or deg: positions are told with six decimals."""
READINGS = 3
READING_PAUSE_S = 0.005
QUESTIONS = ("joint_pos", "abs_cmd_pos", "program_status", "machine", "estop", "enable")
LETTERS = "XYZABC"
"""The order in which positions are told; newer versions tell U V W after them."""


class Coordinates(Enum):
    """What a move's numbers mean to the controller, by the letters of its axes."""

    JOINTS = "XYZA"
    WORLD = "XYZC"

    @property
    def columns(self) -> tuple[int, ...]:
        """Places of the letters in an answer."""
        return tuple(LETTERS.index(letter) for letter in self.value)


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One reading, in deg and mm as LinuxCNC tells them."""

    joints_deg: tuple[float, ...]
    commanded: tuple[float, ...]
    """Where the trajectory is now, by the machine's own letters."""
    idle: bool
    machine_on: bool
    emergency_stop: bool
    in_control: bool
    raw: str

    def is_as(self, other: "Snapshot", still_deg: float) -> bool:
        """Whether the joints read the same as in another reading."""
        pairs = zip(self.joints_deg, other.joints_deg, strict=True)
        return all(abs(a - b) <= still_deg for a, b in pairs)

    def is_commanded(self, target: Sequence[float]) -> bool:
        """Whether the trajectory has come to its end there."""
        pairs = zip(self.commanded, target, strict=True)
        return self.idle and all(abs(now - wanted) <= SAME_PLACE for now, wanted in pairs)


def take_snapshot(conversation: LinuxcncClient, coordinates: Coordinates) -> Snapshot:
    """Ask for everything that a state is made of; some 25 µs a question."""
    answers = {word: conversation.get(word) for word in QUESTIONS}
    return Snapshot(
        joints_deg=first_numbers(answers["joint_pos"], JOINTS),
        commanded=position_in(answers["abs_cmd_pos"], coordinates),
        idle=answers["program_status"].text == "IDLE",
        machine_on=answers["machine"].text == "ON",
        emergency_stop=answers["estop"].text != "OFF",
        in_control=answers["enable"].text == "ON",
        raw="; ".join(answer.line for answer in answers.values()),
    )


def read_joints_deg(conversation: LinuxcncClient) -> tuple[float, ...]:
    """The joints now."""
    return first_numbers(conversation.get("joint_pos"), JOINTS)


def first_numbers(answer: Value, count: int) -> tuple[float, ...]:
    """The first numbers of an answer: versions differ in how many follow. Raises `WireError`."""
    numbers = read_numbers(answer)
    if len(numbers) < count:
        raise WireError(f"LinuxCNC answers fewer than {count} numbers: {answer.line!r:.80}")
    return numbers[:count]


def position_in(answer: Value, coordinates: Coordinates) -> tuple[float, ...]:
    """The coordinates that this machine moves in; raises `WireError`."""
    numbers = first_numbers(answer, len(LETTERS))
    return tuple(numbers[column] for column in coordinates.columns)
