"""What the paper prints, as data, each figure with its place; lengths in mm, angles in deg.

D. Corbel, O. Company, V. Nabat, P. Maurine, "Geometrical Calibration of the High Speed Robot Par4
Using a Laser Tracker", MMAR 2006.
"""

import math
from dataclasses import dataclass
from decimal import Decimal

ABOUT = 0.1
"""How far from the number the word "about" may lead."""


@dataclass(frozen=True, slots=True)
class Printed:
    """A figure in the paper's words, and the lowest and highest value that they allow."""

    text: str
    low: float
    high: float
    place: str

    def allows(self, low: float, high: float) -> bool:
        """Whether a range has a value in common with what is printed."""
        return low <= self.high and high >= self.low


def about(value: float, place: str) -> Printed:
    """A number that the paper gives in round figures."""
    return Printed(f"about {value:g}", value * (1.0 - ABOUT), value * (1.0 + ABOUT), place)


def exactly(digits: str, place: str) -> Printed:
    """A number with its digits: it was rounded to the last one."""
    number = Decimal(digits)
    half = float(Decimal(5).scaleb(int(number.as_tuple().exponent) - 1))
    return Printed(digits, float(number) - half, float(number) + half, place)


def below(value: float, place: str) -> Printed:
    """Less than a number."""
    return Printed(f"< {value:g}", 0.0, value, place)


def above(value: float, place: str) -> Printed:
    """More than a number."""
    return Printed(f"> {value:g}", value, math.inf, place)


PAIRS = 60
TRACKER_NOISE_MM = 0.015 / math.sqrt(3.0)
"""Standard deviation on each coordinate, section IV.D."""
REPEATABILITY_MM = 0.4 / math.sqrt(3.0)
"""Half-width of the uniform draw on each coordinate, section IV.D."""
LINES_MM = (800.0, 800.0, 500.0)
"""Along x, y and z, section IV.E."""

LARGEST_BEFORE = about(10.0, "IV.D, Fig. 7")
LARGEST_AFTER = below(0.01, "IV.D, Fig. 7")
LENGTHS = about(0.05, "IV.D")
ANGLES = about(0.002, "IV.D")
LARGEST_WITH_REPEATABILITY = about(0.3, "IV.D")
LENGTHS_WITH_REPEATABILITY = about(1.0, "IV.D")
ANGLES_WITH_REPEATABILITY = about(0.1, "IV.D")
RADIUS = about(0.4, "IV.E.1")
EXPERIMENT_BEFORE = above(20.0, "IV.E.3, Fig. 8")
EXPERIMENT_AFTER = about(0.6, "IV.E.3, Fig. 8")
ROTATION_BEFORE = about(2.0, "IV.E.3")
ROTATION_AFTER = exactly("0.2", "IV.E.3")
STRAIGHTNESS_BEFORE = {
    axis: exactly(digits, "Table III")
    for axis, digits in (("x", "5.48"), ("y", "5.62"), ("z", "0.91"))
}
STRAIGHTNESS_AFTER = {
    axis: exactly(digits, "Table III")
    for axis, digits in (("x", "0.20"), ("y", "0.61"), ("z", "0.55"))
}
STRAIGHTNESS_GAIN = {
    "x": exactly("96", "Table III"),
    "y": exactly("89", "Table III"),
    "z": Printed("60 (40)", 39.5, 40.5, "Table III"),
}
"""Along z 60 is printed, but the table's own figures make 40: 60 % is what is left."""
MEAN_BEFORE = exactly("7.3", "Table IV")
MEAN_AFTER = exactly("0.4", "Table IV")
MEAN_GAIN = exactly("95", "Table IV")
MAX_BEFORE = exactly("15.2", "Table IV")
MAX_AFTER = exactly("1.2", "Table IV")
MAX_GAIN = exactly("92", "Table IV")

_ORDER = (
    *(f"arm{arm}.joint_offset_deg" for arm in range(4)),
    *(f"arm{arm}.{axis}_mm" for axis in ("x", "y", "z") for arm in (1, 2, 3)),
    *(f"arm{arm}.arm_mm" for arm in range(4)),
    *(f"arm{arm}.forearm_mm" for arm in range(4)),
    "plate_mm",
)


def _table(*values: float) -> dict[str, float]:
    return dict(zip(_ORDER, values, strict=True))


# fmt: off
TABLE_I = _table(
    -0.1, 0.2, -0.3, 0.1,
    -1.0, -2.0, -2.0,
    -3.0, -3.0, 1.0,
    2.0, -1.0, 3.0,
    2.0, 3.0, 3.0, -1.0,
    -1.0, 1.0, 1.0, -3.0,
    1.0,
)
"""The errors simulated in section IV.D, by parameter."""
TABLE_II = _table(
    -4.04, -4.84, -4.54, -3.86,
    -5.00, 2.78, -0.72,
    5.76, -7.23, 0.13,
    0.26, -1.25, -1.45,
    -4.21, -1.37, -7.71, 2.46,
    1.26, 1.41, -1.61, 4.04,
    -1.55,
)
"""The errors estimated on the prototype, by parameter."""
# fmt: on
