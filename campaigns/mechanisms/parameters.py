"""Parameters of a mechanism: what each is, and the values that one robot has of them.

A name such as `arm2.arm_mm` is formed here, of the arm and its field, and read nowhere: who needs
a parameter's arm, unit or role asks the `ParameterSpace` for it by its name.
"""

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Literal, Self

import numpy as np

from campaigns.arrays import Array, Index, Mask

Unit = Literal["mm", "deg", "ppm", ""]
UNITS: Mapping[str, Unit] = {
    "place": "mm",
    "length": "mm",
    "angle": "deg",
    "small angle": "deg",
    "ratio": "ppm",
    "count": "",
}
INNER: Mapping[Unit, float] = {"mm": 1.0, "deg": np.pi / 180.0, "ppm": 1e-6, "": 1.0}
"""Factors from the units of files to inner ones: mm, rad and ratios."""
SIGNS: Mapping[Unit, str] = {"mm": " mm", "deg": "°", "ppm": " ppm", "": ""}

BACKLASHES = ("backlash_deg", "backlash_mm")
JOINT_OFFSETS = ("joint_offset_deg", "joint_offset_mm")


@dataclass(frozen=True, slots=True)
class ParameterField:
    """Kind of parameter: its key in files, what it is, and the range that a file may give it."""

    name: str
    description: str
    quantity: Literal["place", "length", "angle", "small angle", "ratio", "count"]

    @property
    def unit(self) -> Unit:
        """Unit in files and on screens."""
        return UNITS[self.quantity]

    @property
    def stem(self) -> str:
        """Key without the unit: `joint_offset`."""
        return self.name.removesuffix(f"_{self.unit}")

    @property
    def words(self) -> str:
        """What it is called: `joint offset`."""
        return self.stem.replace("_", " ")


FOREARM = "forearm_mm"
PARALLELOGRAM_SKEW = ParameterField(
    "parallelogram_skew_deg",
    "the difference of the forearm's two rods over their distance, deg; may be left out",
    "small angle",
)
"""The rod on the side of (-sin azimuth, cos azimuth, 0) less the other one."""


class Role(Enum):
    """What a parameter is to a fit, to files and to controllers."""

    FREE = "told by shots with a free frame"
    HELD = "nominal by default"
    LEANING = "held unless imperfect parts are looked for: which way they lean"
    EXTENSION = "of imperfect parts, nominally 0: not every controller has it"
    TRANSMISSION = "of a joint's gear and encoder, nominally 0: not every controller has it"
    RATE = "of ripples, how often they come: no entry of a vector, and of sets that have ripples"


RIPPLES_PER_TURN = ParameterField(
    "ripples_per_turn", "periods of a gear's ripple in a turn of its crank", "count"
)
DRIVE_PERIOD = ParameterField(
    "drive_period_mm", "a carriage's travel in a period of its drive's ripple", "length"
)
OPTIONAL = (Role.EXTENSION, Role.TRANSMISSION)
"""Roles of what a file leaves out where it is 0."""
IN_FILES = (Role.FREE, Role.HELD, Role.LEANING)


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a mechanism: an arm's, or the platform's."""

    arm: int | None
    field: ParameterField
    role: Role
    fixes_datum: bool = False
    """Whether no measured point tells it: it places the base frame or says how a turn counts."""

    @property
    def name(self) -> str:
        """Name in files, journals and tables: `arm2.arm_mm`, `plate_mm`."""
        return self.field.name if self.arm is None else f"arm{self.arm}.{self.field.name}"

    @property
    def words(self) -> str:
        """What it is called: `joint offset of arm 2`."""
        return self.field.words if self.arm is None else f"{self.field.words} of arm {self.arm}"

    @property
    def label(self) -> str:
        """Name without the unit: `arm2.arm`."""
        return self.field.stem if self.arm is None else f"arm{self.arm}.{self.field.stem}"

    @property
    def unit(self) -> Unit:
        """Unit in files and on screens."""
        return self.field.unit

    @property
    def sign(self) -> str:
        """Unit as it follows a number: `°`, ` mm` or ` ppm`."""
        return SIGNS[self.unit]

    @property
    def is_angle(self) -> bool:
        """Whether it is in rad inside."""
        return self.field.unit == "deg"

    @property
    def is_ripple(self) -> bool:
        """Whether it counts by the phase of a drive, which nobody may know."""
        return self.field.stem.startswith("ripple_")


@dataclass(frozen=True, eq=False)
class ParameterSpace:
    """Parameters of a mechanism, in the order of its vectors.

    First those of each arm, then the platform's, then extensions and the joints' transmission,
    which a robot file holds where they are not 0. Selections are by name.
    """

    every: tuple[Parameter, ...]

    @classmethod
    def of(
        cls,
        arms: int,
        arm_fields: Sequence[ParameterField],
        platform_fields: Sequence[ParameterField],
        extensions: Sequence[ParameterField],
        transmission: Sequence[ParameterField],
        roles: Mapping[str, Role],
        datum: Collection[str],
    ) -> Self:
        """Space of fields; `roles` by field where they are not free, and what fixes the datum."""
        numbers = range(arms)
        named = (
            *((arm, each, Role.FREE) for arm in numbers for each in arm_fields),
            *((None, each, Role.FREE) for each in platform_fields),
            *((arm, each, Role.EXTENSION) for each in extensions for arm in numbers),
            *((arm, each, Role.TRANSMISSION) for each in transmission for arm in numbers),
        )
        every = (Parameter(arm, each, roles.get(each.name, role)) for arm, each, role in named)
        return cls(tuple(replace(each, fixes_datum=each.name in datum) for each in every))

    def __iter__(self) -> Iterator[Parameter]:
        return iter(self.every)

    def __getitem__(self, name: str) -> Parameter:
        """Parameter of a name, or of the ripples' rate; raises `KeyError`."""
        return self.rate if name == self.rate.name else self._by_name[name]

    @cached_property
    def _by_name(self) -> dict[str, Parameter]:
        return {each.name: each for each in self.every}

    @cached_property
    def arms(self) -> int:
        """Number of arms."""
        return len(self.offsets)

    @cached_property
    def arm_fields(self) -> tuple[ParameterField, ...]:
        """Fields of each arm that every file holds, in the order of its values."""
        return tuple(each.field for each in self.every if each.arm == 0 and each.role in IN_FILES)

    @cached_property
    def platform_fields(self) -> tuple[ParameterField, ...]:
        """Fields of the platform."""
        own = (each for each in self.every if each.role in IN_FILES)
        return tuple(each.field for each in own if each.arm is None)

    @cached_property
    def extension_fields(self) -> tuple[ParameterField, ...]:
        """Fields of each arm's geometry beyond those of every file."""
        own = (each for each in self.every if each.role is Role.EXTENSION)
        return tuple(each.field for each in own if each.arm == 0)

    @cached_property
    def optional_fields(self) -> tuple[ParameterField, ...]:
        """Fields of each arm that a file leaves out where they are 0."""
        own = (each for each in self.every if each.role in OPTIONAL)
        return tuple(each.field for each in own if each.arm == 0)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of what every file and every controller has."""
        return self._of_roles(*IN_FILES)

    @cached_property
    def extensions(self) -> tuple[str, ...]:
        """Names beyond those, of the geometry too: nominally 0."""
        return self._of_roles(Role.EXTENSION)

    @cached_property
    def skews(self) -> tuple[str, ...]:
        """Names of the differences of the forearms' rods."""
        return self.of_field(PARALLELOGRAM_SKEW.name)

    @cached_property
    def backlashes(self) -> tuple[str, ...]:
        """Names of the backlashes of the joints' gears."""
        return self.of_field(*BACKLASHES)

    @cached_property
    def transmission(self) -> tuple[str, ...]:
        """Names of what joints' gears and encoders add to their readings: nominally 0."""
        return self._of_roles(Role.TRANSMISSION)

    @cached_property
    def optional(self) -> tuple[str, ...]:
        """Names of what is nominally 0 and not known to every controller; the rate is last."""
        return (*self.extensions, *self.transmission, self.rate.name)

    @cached_property
    def rate(self) -> Parameter:
        """How often ripples come: `ripples_per_turn`, of carriages `drive_period_mm`."""
        is_angle = self.every[self.offsets[0]].is_angle
        return Parameter(None, RIPPLES_PER_TURN if is_angle else DRIVE_PERIOD, Role.RATE)

    def phase_rate(self, rate: float) -> float:
        """Phase of ripples in rad over readings in rad or mm, by how often they come; or back."""
        return 2.0 * np.pi / rate if rate and self.rate.unit == "mm" else rate

    @cached_property
    def arm_lengths(self) -> tuple[str, ...]:
        """Names of the length of the link that each joint drives."""
        first = next(each for each in self.arm_fields if each.quantity == "length")
        return self.of_field(first.name)

    @cached_property
    def geometry(self) -> tuple[str, ...]:
        """Names of what places the limbs, (G,): the first entries of a vector p."""
        return self.names + self.extensions

    @cached_property
    def of_robot(self) -> tuple[str, ...]:
        """Names of the entries of a vector p, (P,): all that a robot file may hold."""
        return self.geometry + self.transmission

    @cached_property
    def datum(self) -> tuple[str, ...]:
        """Names that no measured point tells: they are held in every fit."""
        return tuple(each.name for each in self.every if each.fixes_datum)

    @cached_property
    def free_by_default(self) -> tuple[str, ...]:
        """Names of what shots with a free frame can tell, unless told otherwise."""
        return self._told(Role.FREE)

    @cached_property
    def free_in_full(self) -> tuple[str, ...]:
        """Names of what shots tell of imperfect parts too: unequal rods, tilted axes and rails."""
        return self._told(Role.FREE, Role.LEANING, Role.EXTENSION)

    @cached_property
    def free_if_extended(self) -> tuple[str, ...]:
        """Names of the geometry and backlashes that shots of known approach can tell apart."""
        return tuple(n for n in self.geometry + self.backlashes if not self[n].fixes_datum)

    @cached_property
    def is_angle(self) -> Mask:
        """Mask of the angles among `model`."""
        return np.array([each.is_angle for each in self.every])

    @cached_property
    def file_unit(self) -> Array:
        """Factors from the units of files (mm, deg, ppm) to inner ones, for `model`."""
        return np.array([INNER[each.unit] for each in self.every])

    @cached_property
    def offsets(self) -> Index:
        """Places of the joint offsets, one a joint."""
        return self.places(self.of_field(*JOINT_OFFSETS))

    def of_field(self, *fields: str) -> tuple[str, ...]:
        """Names of the parameters of some fields; none where the mechanism has no such field."""
        return tuple(each.name for each in self.every if each.field.name in fields)

    def of_unit(self, unit: str, names: Sequence[str]) -> tuple[str, ...]:
        """Those of some names that are in mm, deg or ppm."""
        return tuple(name for name in names if self[name].unit == unit)

    def places(self, names: Sequence[str]) -> Index:
        """Places of parameters in `of_robot`; raises `ValueError` for an unknown name."""
        return np.array([self.of_robot.index(name) for name in names], dtype=np.intp)

    def units(self, names: Sequence[str]) -> Array:
        """Factors from the units of files to inner ones, of the named parameters."""
        return self.file_unit[self.places(names)]

    def _of_roles(self, *roles: Role) -> tuple[str, ...]:
        return tuple(each.name for each in self.every if each.role in roles)

    def _told(self, *roles: Role) -> tuple[str, ...]:
        return tuple(name for name in self._of_roles(*roles) if not self[name].fixes_datum)


@dataclass(frozen=True, eq=False)
class Parameters(Mapping[str, float]):
    """Values of one robot's parameters, by name in mm, deg and ppm as its file has them.

    It lists what a file lists: what is optional only where it is not 0, and how often ripples come
    where there are any. `vector` is the same for the solver, `std` what a file says of its
    uncertainty.
    """

    space: ParameterSpace
    values_in_file: tuple[float, ...]
    """Of all of `space.of_robot`."""
    covariance: Array | None = None
    """Of `space.of_robot`, (P, P), mm, deg, ppm; NaN where it is not known. None: nothing is."""
    rate: float = 0.0
    """Of ripples, as `space.rate` has it; 0 where nobody knows."""

    @classmethod
    def of(
        cls,
        space: ParameterSpace,
        values: Mapping[str, float],
        std: Mapping[str, float] | None = None,
    ) -> Self:
        """From values by name, what is optional and not named being 0, and 1 σ of some of them.

        Names beyond a robot file's are left out. Raises `KeyError` for a value that is missing.
        """
        ordered = [values[name] for name in space.names]
        ordered += [values.get(name, 0.0) for name in space.of_robot[len(ordered) :]]
        known = None if std is None else _covariance(space.of_robot, std)
        return cls(space, tuple(map(float, ordered)), known, values.get(space.rate.name, 0.0))

    @classmethod
    def of_vector(cls, space: ParameterSpace, p: Array, rate: float = 0.0) -> Self:
        """From a vector p (P,), or its geometry (G,), mm and rad, and the ripples' rate."""
        whole = np.zeros(len(space.of_robot))
        whole[: len(p)] = p
        return cls(space, tuple((whole / space.file_unit[: len(whole)]).tolist()), rate=rate)

    @cached_property
    def _by_name(self) -> dict[str, float]:
        named = zip(self.space.every, self.values_in_file, strict=False)
        listed = {each.name: v for each, v in named if v or each.role not in OPTIONAL}
        ripples = self.rate and any(self.space[name].is_ripple for name in listed)
        return listed | ({self.space.rate.name: self.rate} if ripples else {})

    def __getitem__(self, name: str) -> float:
        """Value of a parameter that is listed; raises `KeyError`."""
        return self._by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def __len__(self) -> int:
        return len(self._by_name)

    def __hash__(self) -> int:
        return hash(self.values_in_file)

    @cached_property
    def vector(self) -> Array:
        """Vector p (P,), mm and rad."""
        values = np.array(self.values_in_file)
        return np.asarray(values * self.space.file_unit[: len(values)])

    @property
    def std(self) -> dict[str, float] | None:
        """1 σ by name of what is known, mm and deg; None where nothing is said of it."""
        if self.covariance is None:
            return None
        std = np.sqrt(np.diag(self.covariance)).tolist()
        return {name: s for name, s in zip(self.space.of_robot, std, strict=True) if s == s}

    @property
    def extended_by(self) -> tuple[str, ...]:
        """Names of what is optional and not 0: what not every controller knows."""
        return tuple(name for name in self.space.optional if name in self)

    def __or__(self, other: Mapping[str, float]) -> dict[str, float]:
        """Values by name with others in their place, as of dictionaries."""
        return {**self, **other}

    def __ror__(self, other: Mapping[str, float]) -> dict[str, float]:
        """Values by name in the place of others."""
        return {**other, **self}

    def digest(self) -> str:
        """SHA-256 of all that is listed: equal exactly when all doubles are.

        It is taken of lines `name=value`, the value in the shortest decimals that give the double.
        """
        lines = "".join(f"{name}={value + 0.0!r}\n" for name, value in self.items())  # no -0.0
        return hashlib.sha256(lines.encode("ascii")).hexdigest()


def _covariance(names: Sequence[str], std: Mapping[str, float]) -> Array:
    """Covariance (G, G) of which the diagonal alone is known."""
    known = np.full((len(names), len(names)), np.nan)
    np.fill_diagonal(known, np.square([std.get(name, np.nan) for name in names]))
    return known
