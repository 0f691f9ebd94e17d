"""Kinds of mechanisms and their parameters for the simulator's own use.

Flat names (`arm1.forearm_mm`, deg) outside, arrays (rad) inside. A `Kind` says of which parts a
robot is built: cranks or carriages, three or four, and what its platform does when it turns.
`Geometry` holds the contracted parameters of one robot of that kind.

Names and values exist a second time in `campaigns.kinematics`, on purpose: the simulator must not
learn from the estimator what a parameter means (docs/adr/0003-simulator-of-eight-rods.md).
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Field(NamedTuple):
    """Field of a robot's file: what it is, and its unit."""

    stem: str
    unit: Literal["mm", "deg"]

    @property
    def key(self) -> str:
        """Key in files: `joint_offset_deg`."""
        return f"{self.stem}_{self.unit}"


KindParameter = tuple[int | None, Field]
"""Parameter of a kind of mechanism: its arm, None of the platform's, and its field."""

PLACES = (Field("x", "mm"), Field("y", "mm"), Field("z", "mm"))
LENGTHS = ("arm", "forearm", "plate", "pinion")
FOREARM, AZIMUTH = Field("forearm", "mm"), Field("azimuth", "deg")
CRANK_FIELDS = (*PLACES, AZIMUTH, Field("joint_offset", "deg"), Field("arm", "mm"), FOREARM)
CARRIAGE_FIELDS = (
    *(*PLACES, AZIMUTH, Field("elevation", "deg")),
    *(Field("joint_offset", "mm"), FOREARM),
)
ON_PLATE = ("plate_joint_x_mm", "plate_joint_y_mm", "plate_joint_z_mm")
REFLECTOR = ("reflector_x_mm", "reflector_y_mm", "reflector_z_mm")
CRANK_EXTENSIONS = ("axis_tilt_deg", "parallelogram_skew_deg", "bar_turn_deg", *ON_PLATE)
CARRIAGE_EXTENSIONS = ("rail_tilt_deg", *CRANK_EXTENSIONS)
SAG = ("sag_x_mm", "sag_y_mm", "sag_reach_mm", "sag_z_mm")
RIPPLES = ("encoder_gain_ppm", "ripple_sin_{}", "ripple_cos_{}", "backlash_{}")
ECCENTRICITIES = ("eccentricity_sin_deg", "eccentricity_cos_deg")
CRANK_MM = 300.0
"""Typical length of a crank, whose end moves as far by 1 rad as a carriage by this travel."""

UP = np.array([0.0, 0.0, 1.0])
ALONG_X = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class Turn:
    """Inner joint of a platform, and the parameter that sizes the way of its parts."""

    joint: Literal["hinge", "slide"]
    parameter: Field


HINGE, SLIDE = Turn("hinge", Field("plate", "mm")), Turn("slide", Field("pinion", "mm"))


@dataclass(frozen=True)
class Kind:
    """Kind of mechanism, by the parts of which it is built."""

    name: str
    shares: tuple[float, ...]
    """Share of the parts' way that each arm's plate joint moves when the platform turns."""
    turn: Turn | None = None
    on_rails: bool = False

    @property
    def arms(self) -> int:
        """Number of arms, each with two rods."""
        return len(self.shares)

    @property
    def unknowns(self) -> int:
        """Unknowns of a platform: place, orientation, and the turn where there is one."""
        return 6 if self.turn is None else 7

    @property
    def turns_point(self) -> bool:
        """Whether the part at the controlled point turns, neither arm's end being there."""
        return self.turn is not None and 0.0 not in self.shares

    @cached_property
    def parameters(self) -> Mapping[str, KindParameter]:
        """Its parameters by flat name."""
        fields = CARRIAGE_FIELDS if self.on_rails else CRANK_FIELDS
        of_arms = ((arm, field) for arm in range(self.arms) for field in fields)
        by_name: dict[str, KindParameter] = {f"arm{arm}.{f.key}": (arm, f) for arm, f in of_arms}
        if self.turn is not None:
            by_name[self.turn.parameter.key] = None, self.turn.parameter
        return by_name

    @property
    def names(self) -> tuple[str, ...]:
        """Flat names of its parameters."""
        return tuple(self.parameters)

    @cached_property
    def extensions(self) -> tuple[str, ...]:
        """Flat names of parameters that tilt or lower its plate, turn rails or move its joints."""
        fields = CARRIAGE_EXTENSIONS if self.on_rails else CRANK_EXTENSIONS
        return (*self._of_arms((*fields, f"compliance_{self.unit}")), *SAG, *REFLECTOR)

    @cached_property
    def transmission(self) -> tuple[str, ...]:
        """Flat names of the errors of gears and encoders; 0 if perfect."""
        # a carriage's scale is straight: it has no centre that could be beside an axis
        rings = () if self.on_rails else ECCENTRICITIES
        return self._of_arms((*(field.format(self.unit) for field in RIPPLES), *rings))

    @property
    def rate(self) -> str:
        """Flat name of the ripples' number in a turn, or of a carriage's way for one ripple."""
        return "drive_period_mm" if self.on_rails else "ripples_per_turn"

    @property
    def optional(self) -> tuple[str, ...]:
        """Flat names of all parameters that only some controllers have."""
        return (*self.extensions, *self.transmission, self.rate)

    def _of_arms(self, fields: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(f"arm{arm}.{field}" for field in fields for arm in range(self.arms))

    @property
    def unit(self) -> str:
        """Unit of the joints outside."""
        return "mm" if self.on_rails else "deg"

    @property
    def scale(self) -> float:
        """Inner units of a joint that compare with a crank's turn of 1 rad."""
        return CRANK_MM if self.on_rails else 1.0

    def inner(self, joint: float) -> float:
        """Convert a joint from the unit outside to rad or mm."""
        return joint if self.on_rails else math.radians(joint)

    def outer(self, joint: float) -> float:
        """Convert a joint from rad or mm to deg or mm."""
        return joint if self.on_rails else math.degrees(joint)

    def text(self, joint: float, form: str) -> str:
        """Format a joint for people: `12.345°` or `12.345 mm`."""
        return f"{self.outer(joint):{form}}{' mm' if self.on_rails else '°'}"


# Shares: arms 0 and 1 of Par4 and both I4 hold the controlled point's part, arms 2 and 3 the other
# part, which the turn moves. H4's controlled point is in the middle of its crossbar, so both ends
# move by half the way. A Delta's rigid platform does not turn.
PAR4 = Kind("par4", (0.0, 0.0, 1.0, 1.0), HINGE)
ALL_KINDS = (
    PAR4,
    Kind("h4", (-0.5, -0.5, 0.5, 0.5), HINGE),
    Kind("i4r", (0.0, 0.0, 1.0, 1.0), SLIDE),
    Kind("i4l", (0.0, 0.0, 1.0, 1.0), SLIDE, on_rails=True),
    Kind("delta", (0.0, 0.0, 0.0)),
    Kind("linear-delta", (0.0, 0.0, 0.0), on_rails=True),
)
KINDS: Mapping[str, Kind] = MappingProxyType({kind.name: kind for kind in ALL_KINDS})


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """The contracted parameters (paper, eq. 1) as arrays, one row an arm, in the base frame."""

    kind: Kind
    motors_mm: Array
    """(n, 3): the contracted motor centres P_i, or the zeros of the rails."""
    azimuths_rad: Array
    """(n,)"""
    elevations_rad: Array
    """(n,): of the rails' directions above the horizontal; 0 for cranks."""
    joint_offsets: Array
    """(n,): joint = encoder + offset, rad or mm."""
    arms_mm: Array
    """(n,): of cranks; 0 for rails."""
    forearms_mm: Array
    """(n,)"""
    apart_mm: float
    """Distance of a hinged platform's parts, or a slide's way for 1 rad; 0 without a turn."""

    @property
    def outward(self) -> Array:
        """(n, 3): u_i, direction of cranks at 0°; of rails, from the robot's middle to each."""
        if not self.kind.on_rails:
            azimuth = self.azimuths_rad
            return np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)])
        # a vertical rail has no azimuth, so outward is where it stands from the middle of all
        level = (self.motors_mm - self.motors_mm.mean(axis=0)) * [1.0, 1.0, 0.0]
        return np.asarray(level / np.linalg.norm(level, axis=1, keepdims=True))

    @property
    def sideways(self) -> Array:
        """(n, 3): v_i, the motor axes without any tilt; the bars on the carriages."""
        return np.cross(UP, self.outward)

    @property
    def rails(self) -> Array:
        """(n, 3): direction in which a carriage moves with a growing joint."""
        level = np.cos(self.elevations_rad)[:, None]
        east = np.column_stack([np.cos(self.azimuths_rad), np.sin(self.azimuths_rad)])
        return np.column_stack([level * east, np.sin(self.elevations_rad)])

    def plate_joints_apart(self, turn_rad: float) -> tuple[Array, Array]:
        """Return each plate joint's way by the turn on a level platform, and its rate, (n, 3)."""
        # A hinge swings the other part round the first on a circle, from +y at no turn (paper,
        # eq. 9); a slide moves it along -x, in proportion to the turn that a rack makes of the way.
        sine, cosine = math.sin(turn_rad), math.cos(turn_rad)
        if self.kind.turn is HINGE:
            apart, rate = np.array([-sine, cosine, 0.0]), np.array([-cosine, -sine, 0.0])
        else:
            apart, rate = -turn_rad * ALONG_X, -ALONG_X
        shares = self.apart_mm * np.array(self.kind.shares)[:, None]
        return shares * apart, shares * rate


def problem_with(
    flat: Mapping[str, float], kind: Kind = PAR4, *, extensions: Collection[str] = ()
) -> str:
    """Return the first reason why flat parameters are no robot of a kind; empty if there is none.

    Names in `extensions` may be there beside the parameters of the kind.
    """
    if missing := [name for name in kind.names if name not in flat]:
        return f"{missing[0]} is missing"
    if unknown := [name for name in flat if name not in kind.names and name not in extensions]:
        return f"{unknown[0]} is no parameter of this robot"
    # NaN fails every comparison, so finiteness is checked before the sign of a length
    for name in flat:
        if not math.isfinite(flat[name]):
            return f"{name} is {flat[name]}, not a finite number"
        parameter = kind.parameters.get(name)
        if parameter is not None and parameter[1].stem in LENGTHS and flat[name] <= 0.0:
            return f"{name} is {flat[name]:g} mm, and a length is above 0"
    return ""


def geometry_of(flat: Mapping[str, float], kind: Kind = PAR4) -> Geometry:
    """Convert flat parameters, mm and deg, for which `problem_with` is empty, to arrays."""

    def column(field: str) -> Array:
        return np.array([flat.get(f"arm{arm}.{field}", 0.0) for arm in range(kind.arms)])

    offset = column(f"joint_offset_{kind.unit}")
    return Geometry(
        kind,
        motors_mm=np.column_stack([column("x_mm"), column("y_mm"), column("z_mm")]),
        azimuths_rad=np.radians(column("azimuth_deg")),
        elevations_rad=np.radians(column("elevation_deg")),
        joint_offsets=offset if kind.on_rails else np.radians(offset),
        arms_mm=column("arm_mm"),
        forearms_mm=column("forearm_mm"),
        apart_mm=0.0 if kind.turn is None else float(flat[kind.turn.parameter.key]),
    )
