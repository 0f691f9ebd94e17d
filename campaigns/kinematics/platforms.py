"""Platforms of parallel robots: where the forearms' lower ends are, seen from the controlled point.

A platform is a point (Delta), a plate of two hinged halves (Par4, H4), or two bars that slide on
each other (I4). The last two have a turn θ. Vectors of all arms are (…, 3, N, n).
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array
from campaigns.kinematics.axes import POSITION, TURN, Axis
from campaigns.kinematics.limbs import vectors
from campaigns.kinematics.parameters import ParameterField, Role

Place = tuple[float, float, float]
TYPICAL_JOINT_MM = 50.0
"""Distance of a plate joint from the plate's middle where a robot file gives none."""
SAG = tuple(
    ParameterField(
        f"sag_{part}_mm", f"the rise of the plate {words}, mm", "place", "sag", Role.EXTENSION
    )
    for part, words in (
        ("x", "over 400 mm of x"),
        ("y", "over 400 mm of y"),
        ("reach", "at 400 mm from the z axis, by the square of the distance"),
        ("z", "over 200 mm of z"),
    )
)
"""Fields of the sag: the plate's change of height over the workspace, mm at about its edge."""
REFLECTOR = tuple(
    ParameterField(
        f"reflector_{c}_mm", f"the reflector's {c} on the plate beyond `reflector_mm`, mm", "place",
        "reflector", Role.EXTENSION, f"the reflector's place in {c}",
    )
    for c in "xyz"
)  # fmt: skip
"""Fields of the reflector's place, which a tilted plate moves in proportion to it."""
ON_PLATE = ("reflector", "plate_joints")
"""Groups of places on the plate. They move points by the plate's tilt alone, so that a large σ of
them is no large σ of positions."""


def sag_basis(x: Array, y: Array, z: Array) -> Array:
    """Return by how much each of the parameters `SAG` lifts the plate, (4, …)."""
    # the first terms of any smooth bending: linear in the place, and square in the reach alike on
    # all sides; a constant rise would be a shift of the base frame
    x, y = x / 400.0, y / 400.0
    return np.stack(np.broadcast_arrays(x, y, x * x + y * y, z / 200.0))


@dataclass(frozen=True)
class PlateGeometry:
    """Nominal places on the plate, of a level plate at θ = 0, mm in the base frame."""

    joints_mm: tuple[Place, ...]
    """Middles of the plate's bars, seen from where the contracted model has them: in the controlled
    point, or displaced from it by the platform's own length alone."""
    reflector_mm: Place | None = (0.0, 0.0, 0.0)
    """Measured point, seen from the controlled one. None: the controlled point itself is meant, so
    that the fitted place of the reflector has no effect."""
    outward_rad: tuple[float, ...] | None = None
    """Azimuths across the plate's bars; None: the azimuths of the arms."""

    @classmethod
    def typical(cls, outward_rad: Array, *, bars_follow_azimuths: bool) -> Self:
        """Place the joints `TYPICAL_JOINT_MM` outward, for a robot whose file has no places."""
        outward = np.stack([np.cos(outward_rad), np.sin(outward_rad)], axis=1)
        places = tuple((float(x), float(y), 0.0) for x, y in TYPICAL_JOINT_MM * outward)
        fixed = None if bars_follow_azimuths else tuple(outward_rad.tolist())
        return cls(places, outward_rad=fixed)


@dataclass(frozen=True)
class Platform:
    """Platform that is a point: all forearms end in it, and it only translates."""

    shares: tuple[float, ...] = (0.0, 0.0, 0.0)
    """Place where each arm ends on the line from part 1 to part 2, as a share of its length from
    the controlled point: 0 and 1 for Par4, -½ and ½ for H4."""

    task: ClassVar[tuple[Axis, ...]] = POSITION
    fields: ClassVar[tuple[ParameterField, ...]] = (*SAG, *REFLECTOR)
    bars_along_x: ClassVar[bool] = False
    """Whether the base frame's x axis is a direction of the platform."""
    turn_limit_rad: ClassVar[float] = math.inf
    """Turn beyond which the platform has turned over."""

    @property
    def arms(self) -> int:
        """Number of arms."""
        return len(self.shares)

    @property
    def arms_at_point(self) -> tuple[int, ...]:
        """Arms that end in the controlled point however the platform is turned."""
        return tuple(arm for arm, share in enumerate(self.shares) if share == 0.0)

    @property
    def has_two_parts(self) -> bool:
        """Whether arms 0 and 1 hold one part, 2 and 3 the other."""
        return len(self.task) > len(POSITION)

    def seen_from(self, part: int) -> Self:
        """Return this platform with the measured point on part 1 or 2.

        Raise `ValueError` for another part, or for a platform of one part.
        """
        if not self.has_two_parts:
            raise ValueError(f"a platform of one part has no part {part}")
        if part not in {1, 2}:
            raise ValueError(f"the platform has parts 1 and 2, no part {part}")
        origin = self.shares[0 if part == 1 else -1]
        return replace(self, shares=tuple(share - origin for share in self.shares))

    # Lower end of arm i: B_i = X + w_i h a(θ), with its share w_i, the platform's length h and the
    # vector a from part 1 to part 2 for a length of 1, which is all that mechanisms differ in.
    def offsets(self, length: Array, turn: Array) -> Array:
        """Return the lower ends seen from the controlled point, (…, 3, N, n), of a level plate.

        `length` (…, 1, 1) is the platform's own, `turn` (…, N, 1) in rad.
        """
        return np.array(self.shares) * (length[..., None, :, :] * self._apart(turn))

    def _apart(self, turn: Array) -> Array:  # noqa: ARG002 - a point has no parts
        """Return the vector a (…, 3, N, 1) from part 1 to part 2 at turns, for a length of 1."""
        return np.zeros((3, 1, 1))

    def lever_mm(self, length: float, forearm: float) -> float:  # noqa: ARG002 - a point turns not
        """Return the lever that makes a turn a length, by the platform's and a forearm's length."""
        return 0.0


class HingedPlate(Platform):
    """Articulated plate of Par4 and H4 (paper eq. 9): part 2 lies along (-sin θ, cos θ, 0)."""

    task = (*POSITION, TURN)
    fields = (
        ParameterField(
            "plate_mm", "the distance between the halves of the plate, mm", "length", "plate"
        ),
        *SAG,
        *REFLECTOR,
    )
    turn_limit_rad = 0.5 * math.pi

    @override
    def _apart(self, turn: Array) -> Array:
        return vectors(-np.sin(turn), np.cos(turn), 0.0)

    @override
    def lever_mm(self, length: float, forearm: float) -> float:
        return forearm / 7.0  # 100 mm of the prototype, whose forearms have 700 mm


class SlidingBars(Platform):
    """I4's bars that slide along x, where a rack turns the tool: part 2 is r θ behind part 1."""

    task = (*POSITION, TURN)
    fields = (
        ParameterField(
            "pinion_mm", "travel of the bars for a turn of 1 rad, mm", "length", "plate"
        ),
        *SAG,
        *REFLECTOR,
    )
    bars_along_x = True

    @override
    def _apart(self, turn: Array) -> Array:
        return np.stack([-turn, 0.0 * turn, 0.0 * turn], axis=-3)

    @override
    def lever_mm(self, length: float, forearm: float) -> float:
        return length  # the bars' travel for a turn of 1 rad
