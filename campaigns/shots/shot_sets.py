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

    @property
    def in_pairs(self) -> bool:
        """Whether its shots stand in pairs, whose distance counts."""
        return self in {ShotSet.IDENTIFICATION, ShotSet.VALIDATION, ShotSet.KNOWN_LENGTH}
