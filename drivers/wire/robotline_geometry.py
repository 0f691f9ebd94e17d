"""A robot's geometry as robotline cuts it into lines: one an arm, one for the plate; mm, deg."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

from drivers.errors import WireError
from drivers.wire.robotline_words import Words, number_word

ARMS = 4
ARM_PARAMETERS = (
    "x_mm",
    "y_mm",
    "z_mm",
    "azimuth_deg",
    "joint_offset_deg",
    "arm_mm",
    "forearm_mm",
)
PLATE_PARAMETER = "plate_mm"


@dataclass(frozen=True, slots=True)
class ArmGeometry:
    """The seven parameters of one arm, in the order of `ARM_PARAMETERS`."""

    arm: int
    values: tuple[float, ...]

    @classmethod
    def of(cls, arm: int, geometry: Mapping[str, float]) -> Self:
        """Pick one arm out of a flat parameter set; raises `KeyError`."""
        return cls(arm, tuple(geometry[f"arm{arm}.{name}"] for name in ARM_PARAMETERS))

    def flat(self) -> dict[str, float]:
        """Return the parameters by their flat names."""
        names = (f"arm{self.arm}.{name}" for name in ARM_PARAMETERS)
        return dict(zip(names, self.values, strict=True))

    def words(self) -> list[str]:
        """Write the words."""
        return ["ARM", str(self.arm), *map(number_word, self.values)]


@dataclass(frozen=True, slots=True)
class PlateGeometry:
    """The one parameter of the articulated plate."""

    plate_mm: float

    @classmethod
    def of(cls, geometry: Mapping[str, float]) -> Self:
        """Pick the plate out of a flat parameter set; raises `KeyError`."""
        return cls(geometry[PLATE_PARAMETER])

    def flat(self) -> dict[str, float]:
        """Return the parameter by its flat name."""
        return {PLATE_PARAMETER: self.plate_mm}

    def words(self) -> list[str]:
        """Write the words."""
        return ["PLATE", number_word(self.plate_mm)]


Part = ArmGeometry | PlateGeometry


def parts_of(geometry: Mapping[str, float]) -> tuple[Part, ...]:
    """Cut a flat parameter set into the parts that go into one line each; raises `KeyError`."""
    arms = (ArmGeometry.of(arm, geometry) for arm in range(ARMS))
    return (*arms, PlateGeometry.of(geometry))


GEOMETRY_NAMES = (
    *(f"arm{arm}.{name}" for arm in range(ARMS) for name in ARM_PARAMETERS),
    PLATE_PARAMETER,
)


def read_part(words: Words) -> Part:
    """Take `ARM arm` and seven numbers, or `PLATE` and one."""
    if is_plate_next(words):
        return PlateGeometry(words.number(PLATE_PARAMETER))
    arm = read_arm(words)
    return ArmGeometry(arm, tuple(words.number(name) for name in ARM_PARAMETERS))


def is_plate_next(words: Words) -> bool:
    """Take `ARM` or `PLATE`."""
    part = words.word("ARM or PLATE")
    if part not in {"ARM", "PLATE"}:
        raise WireError(f"'{part}' is neither ARM nor PLATE")
    return part == "PLATE"


def read_arm(words: Words) -> int:
    """Take the number of an arm."""
    arm = words.whole("arm")
    if arm >= ARMS:
        raise WireError(f"arm is {arm}, not 0 to {ARMS - 1}")
    return arm
