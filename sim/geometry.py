"""Kinds of mechanisms and their parameters for the simulator's own use.

Flat names (`arm1.forearm_mm`, deg) outside, arrays (rad) inside. A `Kind` says which joints and
parameters a robot has, and what its platform does when it turns:

- `PlateKind`: cranks or carriages, three or four, each with two rods under a plate;
- `BarKind`: a table of arms, each of which holds a free platform, or one in a plane, by one bar;
- `StatedKind`: joints and parameters alone, of a mechanism whose equations come from outside.

`Geometry` holds the contracted parameters of one robot of rods.

Names and values exist a second time in `campaigns.kinematics`, on purpose: the simulator must not
learn from the estimator what a parameter means (docs/adr/0003-simulator-of-eight-rods.md).
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Unit = Literal["mm", "deg"]


class Field(NamedTuple):
    """Field of a robot's file: what it is, and its unit."""

    stem: str
    unit: Literal["mm", "deg", "ppm"]

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


class Kind(ABC):
    """Kind of mechanism: what files, wires and controllers know of it."""

    name: str
    turn: Turn | None = None
    """What the two parts of its platform do when it turns; None: its platform is one part."""
    lengths: tuple[str, ...] = LENGTHS
    """Stems of parameters that are above 0."""

    @property
    @abstractmethod
    def units(self) -> tuple[Unit, ...]:
        """Unit of each joint outside: deg of cranks, mm of carriages and legs."""

    @property
    @abstractmethod
    def turns(self) -> tuple[str, ...]:
        """Names of the turns in a pose."""

    @property
    @abstractmethod
    def unknowns(self) -> int:
        """Unknowns of a platform: place, orientation, and an inner turn where there is one."""

    @property
    @abstractmethod
    def parameters(self) -> Mapping[str, KindParameter]:
        """Its parameters by flat name."""

    @property
    def names(self) -> tuple[str, ...]:
        """Flat names of its parameters."""
        return tuple(self.parameters)

    @property
    def extensions(self) -> tuple[str, ...]:
        """Flat names of parameters that tilt or lower its plate, turn rails or move its joints."""
        return ()

    @property
    def transmission(self) -> tuple[str, ...]:
        """Flat names of the errors of gears and encoders; 0 if perfect."""
        # a carriage's scale is straight: it has no centre that could be beside an axis; and where a
        # robot has gears, its drives have no ripple, which would repeat at another rate
        rippling = "deg" if "deg" in self.units else "mm"
        of_all = [
            (arm, unit, field)
            for field in (*RIPPLES, *ECCENTRICITIES)
            for arm, unit in enumerate(self.units)
        ]
        return tuple(
            f"arm{arm}.{field.format(unit)}"
            for arm, unit, field in of_all
            if not (field.startswith("ripple") and unit != rippling)
            and not (field in ECCENTRICITIES and unit == "mm")
        )

    @property
    def rate(self) -> str:
        """Flat name of the ripples' number in a turn, or of a carriage's way for one ripple."""
        return "ripples_per_turn" if "deg" in self.units else "drive_period_mm"

    @property
    def optional(self) -> tuple[str, ...]:
        """Flat names of all parameters that only some controllers have."""
        return (*self.extensions, *self.transmission, self.rate)

    @property
    def arms(self) -> int:
        """Number of arms, each with one joint."""
        return len(self.units)

    @cached_property
    def is_carriage(self) -> NDArray[np.bool_]:
        """(n,): which joints shift instead of turning."""
        return np.array([unit == "mm" for unit in self.units])

    @cached_property
    def scales(self) -> Array:
        """(n,): inner units of each joint that compare with a crank's turn of 1 rad."""
        return np.where(self.is_carriage, CRANK_MM, 1.0)

    def inner(self, joints: ArrayLike) -> Array:
        """Convert joints (n,), or one value for all, from the units outside to rad or mm."""
        return np.asarray(joints) * np.where(self.is_carriage, 1.0, math.pi / 180.0)

    def outer(self, joints: ArrayLike) -> Array:
        """Convert joints (n,), or one value for all, from rad or mm to deg or mm."""
        return np.asarray(joints) * np.where(self.is_carriage, 1.0, 180.0 / math.pi)

    def text(self, joint: int, value: float, form: str) -> str:
        """Format the value of a joint for people: `12.345°` or `12.345 mm`."""
        return f"{self.outer(value)[joint]:{form}}{' mm' if self.is_carriage[joint] else '°'}"

    def listed(self, joints: Array, form: str) -> str:
        """Format all joints for people."""
        return ", ".join(self.text(joint, value, form) for joint, value in enumerate(joints))


@dataclass(frozen=True)
class PlateKind(Kind):
    """Kind of mechanism whose arms hold a plate by two rods each."""

    name: str
    shares: tuple[float, ...]
    """Share of the parts' way that each arm's plate joint moves when the platform turns."""
    turn: Turn | None = None
    on_rails: bool = False

    @cached_property
    def units(self) -> tuple[Unit, ...]:
        """Unit of each joint outside."""
        return (self.unit,) * len(self.shares)

    @property
    def unit(self) -> Unit:
        """Unit of all joints outside."""
        return "mm" if self.on_rails else "deg"

    @cached_property
    def turns(self) -> tuple[str, ...]:
        """Names of the turns in a pose."""
        return () if self.turn is None else ("theta",)

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
        by_name = _parameters_of([fields] * len(self.shares))
        if self.turn is not None:
            by_name[self.turn.parameter.key] = None, self.turn.parameter
        return by_name

    @cached_property
    def extensions(self) -> tuple[str, ...]:
        """Flat names of parameters that tilt or lower its plate, turn rails or move its joints."""
        fields = CARRIAGE_EXTENSIONS if self.on_rails else CRANK_EXTENSIONS
        of_arms = (*fields, f"compliance_{self.unit}")
        arms = range(len(self.shares))
        return (*(f"arm{arm}.{field}" for field in of_arms for arm in arms), *SAG, *REFLECTOR)


@dataclass(frozen=True)
class Limb:
    """Arm that holds a platform by one bar, by how its joint moves the bar's upper end."""

    moves: Literal["leg", "carriage", "crank"]
    """`leg`: the end stays, and the joint is the bar's length; `carriage`: the joint shifts it
    along a rail; `crank`: the joint turns it about z."""
    fields: tuple[Field, ...]
    side: float = 1.0
    """Which of two joints takes a pose: 1, a crank's elbow on the left of the way to the platform,
    or a carriage above it or further along; -1, the other one."""


@dataclass(frozen=True)
class BarKind(Kind):
    """Kind of mechanism whose arms hold a platform by one bar each, stated by a table."""

    name: str
    limbs: tuple[Limb, ...]
    free: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    """Coordinates in which the platform moves: 0 to 2 are x, y, z, 3 to 5 the turns about them."""

    unknowns = 6

    @cached_property
    def units(self) -> tuple[Unit, ...]:
        """Unit of each joint outside."""
        return tuple("deg" if limb.moves == "crank" else "mm" for limb in self.limbs)

    @cached_property
    def turns(self) -> tuple[str, ...]:
        """Names of the turns in a pose."""
        turning = [place for place in self.free if place > 2]
        return ("theta",) if turning == [5] else ("rx", "ry", "rz")[: len(turning)]

    @cached_property
    def parameters(self) -> Mapping[str, KindParameter]:
        """Its parameters by flat name."""
        return _parameters_of([limb.fields for limb in self.limbs])


@dataclass(frozen=True)
class StatedKind(Kind):
    """Kind of mechanism by what its robot file states; its equations come from outside."""

    name: str
    joint_units: tuple[Unit, ...]
    stated: tuple[str, ...]
    """Flat names of its parameters."""
    named_turns: tuple[str, ...] = ()
    """Names of the turns in a pose."""
    zeros: tuple[str, ...] = ()
    """Flat names of parameters that its equations have too, and that are 0 by its drawing."""

    unknowns = 6
    lengths = ()

    @property
    def turns(self) -> tuple[str, ...]:
        """Names of the turns in a pose."""
        return self.named_turns

    @property
    def units(self) -> tuple[Unit, ...]:
        """Unit of each joint outside."""
        return self.joint_units

    @property
    def extensions(self) -> tuple[str, ...]:
        """Flat names of the parameters that are 0 by its drawing."""
        return self.zeros

    @cached_property
    def parameters(self) -> Mapping[str, KindParameter]:
        """Its parameters by flat name."""
        return {name: parameter_of(name) for name in self.stated}


def _parameters_of(arms: Sequence[tuple[Field, ...]]) -> dict[str, KindParameter]:
    """Return the parameters of arms with these fields by flat name."""
    of_arms = ((arm, field) for arm, fields in enumerate(arms) for field in fields)
    return {f"arm{arm}.{field.key}": (arm, field) for arm, field in of_arms}


def parameter_of(name: str) -> KindParameter:
    """Return a parameter by its flat name: `arm1.length_mm`, `tool_x_mm`."""
    holder, _, key = name.rpartition(".")
    stem, _, unit = key.rpartition("_")
    arm = int(holder.removeprefix("arm")) if holder else None
    return arm, Field(stem, unit if unit in {"mm", "deg"} else "ppm")  # type: ignore[arg-type]


# Shares: arms 0 and 1 of Par4 and both I4 hold the controlled point's part, arms 2 and 3 the other
# part, which the turn moves. H4's controlled point is in the middle of its crossbar, so both ends
# move by half the way. A Delta's rigid platform does not turn.
PAR4 = PlateKind("par4", (0.0, 0.0, 1.0, 1.0), HINGE)
PLATE_KINDS: Mapping[str, PlateKind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            PAR4,
            PlateKind("h4", (-0.5, -0.5, 0.5, 0.5), HINGE),
            PlateKind("i4r", (0.0, 0.0, 1.0, 1.0), SLIDE),
            PlateKind("i4l", (0.0, 0.0, 1.0, 1.0), SLIDE, on_rails=True),
            PlateKind("delta", (0.0, 0.0, 0.0)),
            PlateKind("linear-delta", (0.0, 0.0, 0.0), on_rails=True),
        )
    }
)
"""Kinds of rods under a plate."""

ON_PLATFORM = (Field("plate_x", "mm"), Field("plate_y", "mm"), Field("plate_z", "mm"))
RAIL = (AZIMUTH, Field("elevation", "deg"))
ALONG = Field("joint_offset", "mm")
LEG = Limb("leg", (*PLACES, *ON_PLATFORM, ALONG))
CARRIAGE = Limb("carriage", (*PLACES, *RAIL, *ON_PLATFORM, ALONG, FOREARM))
IN_PLANE = (*PLACES[:2], Field("joint_offset", "deg"), Field("arm", "mm"), FOREARM)
BAR_KINDS: Mapping[str, BarKind] = MappingProxyType(
    {
        kind.name: kind
        for kind in (
            BarKind("hexapod", (LEG,) * 6),
            BarKind("hexaglide", (CARRIAGE,) * 6),
            BarKind(
                "five-bar", (Limb("crank", IN_PLANE), Limb("crank", IN_PLANE, -1.0)), free=(0, 1)
            ),
        )
    }
)
"""Kinds of bars: a further one is a further row."""
TWINS: Mapping[str, Kind] = MappingProxyType({**PLATE_KINDS, **BAR_KINDS})
"""Kinds that are simulated by parts of this package."""


@dataclass(frozen=True, slots=True, eq=False)
class Geometry:
    """The contracted parameters (paper, eq. 1) as arrays, one row an arm, in the base frame."""

    kind: PlateKind
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
        if parameter is not None and parameter[1].stem in kind.lengths and flat[name] <= 0.0:
            return f"{name} is {flat[name]:g} mm, and a length is above 0"
    return ""


def geometry_of(flat: Mapping[str, float], kind: PlateKind = PAR4) -> Geometry:
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
