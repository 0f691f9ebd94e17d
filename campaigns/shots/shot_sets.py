"""Sets of shots, by what they are for."""

from enum import Enum


class ShotSet(Enum):
    """A set of shots; the value is the word in files."""

    IDENTIFICATION = "identification"
    VALIDATION = "validation"
    DRIFT = "drift"
    REPEATABILITY = "repeatability"
    ROTATION = "rotation"
    STRAIGHTNESS = "straightness"
    KNOWN_LENGTH = "known-length"
    NEST = "nest"
    ISO_CUBE = "iso-cube"
    CHECK = "check"

    @property
    def in_pairs(self) -> bool:
        """Whether its shots stand in pairs, whose distance counts."""
        return self in IN_PAIRS

    @property
    def on_robot(self) -> bool:
        """Whether it is the robot's reflector that is measured."""
        return self not in OFF_ROBOT


IN_PAIRS = (ShotSet.IDENTIFICATION, ShotSet.VALIDATION, ShotSet.KNOWN_LENGTH)
OFF_ROBOT = (ShotSet.KNOWN_LENGTH, ShotSet.NEST)
