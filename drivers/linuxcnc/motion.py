"""Moves as LinuxCNC's G-code, and what its refusals mean."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees, isfinite

from drivers.errors import DeviceRefused, EmergencyStop, LimitViolation, MotionFault
from drivers.linuxcnc.machine_state import JOINTS, Coordinates

DECIMALS = 6
"""Of mm and deg, as LinuxCNC tells positions: what was sent is read back to the digit."""
AT_THE_LIMIT_RAD = 1e-8
MINUTE_S = 60.0
SHORTEST_S = 0.05
OVERLONG_MM = 1e6
LIMIT_WORDS = ("exceed", "limit", "kinematicsinverse")
MDI = "mdi"
PER_MINUTE = "G94"
"""The mode of feed that an operator expects: after a paced move, F is a time."""
FAULT_WORDS = ("following error", "amplifier fault", "amp fault")


@dataclass(frozen=True, slots=True)
class Target:
    """Where a move ends, by the machine's own letters, mm and deg as they are sent."""

    coordinates: Coordinates
    values: tuple[float, ...]

    @classmethod
    def of(cls, coordinates: Coordinates, values: Sequence[float]) -> "Target":
        """Round to what is sent; raises `LimitViolation` for what is no place."""
        if not all(isfinite(value) and abs(value) < OVERLONG_MM for value in values):
            raise LimitViolation(f"{list(values)} is no place", remedy="check the plan")
        return cls(coordinates, tuple(round(value, DECIMALS) + 0.0 for value in values))

    def words(self) -> str:
        """`X12.345679 Y…`."""
        pairs = zip(self.coordinates.value, self.values, strict=True)
        return " ".join(f"{letter}{value:.{DECIMALS}f}" for letter, value in pairs)


@dataclass(frozen=True, slots=True)
class Pace:
    """How fast the joints may go: `fraction` of the full speed that the driver was told."""

    fraction: float
    full_speed_rad_s: float

    def command(self, target: Target, travel_rad: float) -> str:
        """The block of G-code for a move whose longest joint travels that far.

        At full speed it is the machine's own rapid (G0). Below, it is given its duration: a rapid
        does not follow the feed override in all versions, and a feed would not count the rotary
        letter. Millimetres and absolute positions are said each time: somebody may have changed
        them by hand.
        """
        if self.fraction >= 1.0:
            return f"G21 G90 G94 G53 G0 {target.words()}"
        duration_s = max(travel_rad / (self.fraction * self.full_speed_rad_s), SHORTEST_S)
        return f"G21 G90 G93 G53 G1 {target.words()} F{MINUTE_S / duration_s:.{DECIMALS}f}"


@dataclass(frozen=True, slots=True)
class JointLimits:
    """The lowest and the highest angle of every joint."""

    lowest_rad: float
    highest_rad: float

    def text(self) -> str:
        """In degrees, for messages."""
        return f"{degrees(self.lowest_rad):g}° to {degrees(self.highest_rad):g}°"

    def wider_by(self, slack_rad: float) -> "JointLimits":
        """What joints may do that only pass."""
        return JointLimits(self.lowest_rad - slack_rad, self.highest_rad + slack_rad)

    def check(self, joints: Sequence[float]) -> None:
        """Raise `LimitViolation` for a target outside, before anything is sent."""
        if len(joints) != JOINTS:
            raise LimitViolation(
                f"{len(joints)} joints were given, the robot has {JOINTS}",
                remedy="check the plan",
                code="LIMIT",
            )
        for joint, angle_rad in enumerate(joints):
            low = self.lowest_rad - AT_THE_LIMIT_RAD
            if not low <= angle_rad <= self.highest_rad + AT_THE_LIMIT_RAD:
                raise LimitViolation(
                    f"joint {joint} to {degrees(angle_rad):.4f}°, limits {self.text()}",
                    remedy="check the plan against the robot file's limits",
                    code="LIMIT",
                )


def refusal(
    name: str, messages: Sequence[str], *, emergency_stop: bool, machine_on: bool
) -> DeviceRefused:
    """What LinuxCNC's messages mean, with its own words."""
    said = "; ".join(messages)
    if emergency_stop:
        return EmergencyStop(
            f"{name}: the emergency stop is on" + (f" ({said})" if said else ""),
            remedy="make the cell safe, release it, then start again",
            code=said,
        )
    text = said.lower()
    if not machine_on or any(word in text for word in FAULT_WORDS):
        remedy = "clear the fault at the machine, then start again"
        return MotionFault(f"{name}: {said or 'the machine is off'}", remedy=remedy, code=said)
    if any(word in text for word in LIMIT_WORDS):
        remedy = "compare the plan's limits with [AXIS_…] and [JOINT_…] of LinuxCNC's INI file"
        return LimitViolation(f"{name}: {said}", remedy=remedy, code=said)
    return DeviceRefused(
        f"{name}: {said}", remedy="look at LinuxCNC's messages, then try again", code=said
    )
