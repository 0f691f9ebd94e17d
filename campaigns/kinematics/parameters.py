"""Parameters of a mechanism: the table of what each one is, and the values that one robot has.

A parameter belongs to an arm (`arm2.forearm_mm`) or to the platform (`plate_mm`). Its field holds
its meaning, its unit in files, its role in files and controllers, and its group of error sources
(`campaigns/fit/error_sources.py`).

Vectors of parameters are in mm, rad and ratios; files and screens give mm, deg and ppm.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from html import escape
from itertools import chain
from typing import Literal, Self

import numpy as np

from campaigns.arrays import Array, Index

Unit = Literal["mm", "deg", "ppm", ""]
Quantity = Literal["place", "length", "angle", "small angle", "ratio", "count"]
UNITS: Mapping[Quantity, Unit] = {
    "place": "mm",
    "length": "mm",
    "angle": "deg",
    "small angle": "deg",
    "ratio": "ppm",
    "count": "",
}
INNER: Mapping[Unit, float] = {"mm": 1.0, "deg": np.pi / 180.0, "ppm": 1e-6, "": 1.0}
"""Factors from the units of files to those of vectors."""
SIGNS: Mapping[Unit, str] = {"mm": " mm", "deg": "°", "ppm": " ppm", "": ""}


class Role(Enum):
    """Role of a parameter in files and controllers."""

    GEOMETRY = "in every robot file, known to every controller"
    EXTENSION = "of imperfect parts, nominally 0: a file may leave it out"
    TRANSMISSION = "of a joint's gear and encoder, nominally 0: a file may leave it out"
    GROWTH = "of warm parts: determined by a fit, in no robot file"


OPTIONAL = (Role.EXTENSION, Role.TRANSMISSION)
"""Roles of parameters that a file may leave out and a controller may not have."""


@dataclass(frozen=True, slots=True)
class ParameterField:
    """Kind of parameter: key in files, meaning, range, role and group of error sources."""

    name: str
    description: str
    quantity: Quantity
    group: str
    role: Role = Role.GEOMETRY
    name_in_words: str = ""
    """Name in a sentence; empty: the key without its unit."""

    @property
    def unit(self) -> Unit:
        """Unit in files and on screens."""
        return UNITS[self.quantity]

    @property
    def stem(self) -> str:
        """Key without its unit: `joint_offset`."""
        return self.name.removesuffix(f"_{self.unit}")

    @property
    def words(self) -> str:
        """Name in a sentence: `joint offset`."""
        return self.name_in_words or self.stem.replace("_", " ")


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a mechanism: a field of one arm, or of the platform (`arm` None)."""

    arm: int | None
    field: ParameterField

    @property
    def name(self) -> str:
        """Name in files, journals and tables: `arm2.arm_mm`, `plate_mm`."""
        return self.field.name if self.arm is None else f"arm{self.arm}.{self.field.name}"

    @property
    def label(self) -> str:
        """Name without the unit: `arm2.arm`."""
        return self.field.stem if self.arm is None else f"arm{self.arm}.{self.field.stem}"

    @property
    def words(self) -> str:
        """Name in a sentence: `joint offset of arm 2`."""
        return self.field.words if self.arm is None else f"{self.field.words} of arm {self.arm}"

    @property
    def unit(self) -> Unit:
        """Unit in files and on screens."""
        return self.field.unit

    @property
    def sign(self) -> str:
        """Unit as it follows a number: `°`, ` mm` or ` ppm`."""
        return SIGNS[self.unit]


EXPANSIONS = tuple(
    ParameterField(
        f"{part}_expansion_ppm",
        f"the growth of {words} by a degree, ppm of their length",
        "ratio",
        "growth",
        Role.GROWTH,
    )
    for part, words in (
        ("arm", "the arms or rails"),
        ("forearm", "the forearms"),
        ("frame", "the frame that carries the arms"),
    )
)
RIPPLES_PER_TURN = Parameter(
    None,
    ParameterField("ripples_per_turn", "periods of a gear's ripple in a turn", "count", "ripple"),
)
DRIVE_PERIOD = Parameter(
    None,
    ParameterField("drive_period_mm", "travel in a period of a drive's ripple", "length", "ripple"),
)


@dataclass(frozen=True, eq=False)
class ParameterTable:
    """Parameters of a mechanism in the order of its vectors.

    Geometry comes arm by arm, then the platform's; extensions, transmission and growth follow, each
    field of all arms together.
    """

    rows: tuple[Parameter, ...]
    rate: Parameter
    """Repetition of the ripples of all joints: `ripples_per_turn` of cranks, `drive_period_mm` of
    carriages."""

    @classmethod
    def of(
        cls,
        arms: Sequence[Sequence[ParameterField]],
        platform_fields: Sequence[ParameterField],
        rate: Parameter,
    ) -> Self:
        """Make the table of a mechanism with the fields of each arm, and of its platform."""
        # A vector of the geometry alone is the beginning of the whole one.
        rows: list[Parameter] = []
        for role in Role:
            together: dict[int | str, list[Parameter]] = {}
            for arm, of_arm in enumerate(arms):
                for field in of_arm:
                    if field.role is role:  # the geometry of each arm, other fields of all arms
                        key = arm if role is Role.GEOMETRY else field.stem
                        together.setdefault(key, []).append(Parameter(arm, field))
            rows += chain.from_iterable(together.values())
            rows += [Parameter(None, field) for field in platform_fields if field.role is role]
        return cls((*rows, *(Parameter(None, field) for field in EXPANSIONS)), rate)

    def __getitem__(self, name: str) -> Parameter:
        """Return the parameter of a name; raise `KeyError` for an unknown one."""
        if name == self.rate.name:
            return self.rate
        return self.rates.get(name) or self.rows[self._places[name]]

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def select(
        self, *roles: Role, field: str | None = None, group: str | None = None
    ) -> tuple[str, ...]:
        """Return the names of the parameters that have one of the roles, the field and the group.

        A field may be given without its unit. Without roles all roles count, without a field or a
        group all of these.
        """
        return tuple(
            parameter.name
            for parameter in self.rows
            if (not roles or parameter.field.role in roles)
            and field in (None, parameter.field.name, parameter.field.stem)
            and group in (None, parameter.field.group)
        )

    def arm_fields(self, *roles: Role, arm: int = 0) -> tuple[ParameterField, ...]:
        """Return the fields of an arm in these roles; without roles those that every file has."""
        return self._fields(arm, roles)

    def platform_fields(self, *roles: Role) -> tuple[ParameterField, ...]:
        """Return the platform's fields in these roles; without roles those that every file has."""
        return self._fields(None, roles)

    def _fields(self, arm: int | None, roles: tuple[Role, ...]) -> tuple[ParameterField, ...]:
        fields = (parameter.field for parameter in self.rows if parameter.arm == arm)
        return tuple(field for field in fields if field.role in (roles or (Role.GEOMETRY,)))

    @cached_property
    def _places(self) -> dict[str, int]:
        return {parameter.name: place for place, parameter in enumerate(self.rows)}

    @property
    def arms(self) -> int:
        """Number of arms."""
        return len(self.columns["joint_offset"])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the geometry, which every file and every controller has, (G,)."""
        return self.select(Role.GEOMETRY)

    @cached_property
    def of_robot(self) -> tuple[str, ...]:
        """Names of all that a robot file may hold, (P,)."""
        return self.select(Role.GEOMETRY, *OPTIONAL)

    @cached_property
    def optional(self) -> tuple[str, ...]:
        """Names of the parameters that not every controller has; the ripples' rates are last."""
        return (*self.select(*OPTIONAL), self.rate.name, *self.rates)

    @cached_property
    def rates(self) -> Mapping[str, Parameter]:
        """Repetition of each joint's ripple by name, `arm0.drive_period_mm`, for unlike joints."""
        rates = (Parameter(arm, self.rate.field) for arm in range(self.arms))
        return {rate.name: rate for rate in rates}

    def named_rates(self, rates: Sequence[float]) -> dict[str, float]:
        """Return rates (n,) by name: a common one as one value, of others those that are not 0."""
        if len({*rates}) == 1:
            return {self.rate.name: rates[0]} if rates[0] else {}
        return {name: rate for name, rate in zip(self.rates, rates, strict=True) if rate}

    @cached_property
    def file_unit(self) -> Array:
        """Factors (M,) from the units of files to those of vectors."""
        return np.array([INNER[parameter.unit] for parameter in self.rows])

    def whole(self, p: Array) -> Array:
        """Return a copy (P,) of a vector or of its geometry (G,), with 0 for missing parameters."""
        whole = np.zeros(len(self.of_robot))
        whole[: len(p)] = p
        return whole

    @cached_property
    def columns(self) -> Mapping[str, Index]:
        """Places in a vector by stem of the field: of all arms, (n,), or of the platform, (1,)."""
        stems = np.array([parameter.field.stem for parameter in self.rows])
        return {stem: np.flatnonzero(stems == stem) for stem in dict.fromkeys(stems.tolist())}

    def places(self, names: Sequence[str]) -> Index:
        """Return the places of parameters in a vector; raise `KeyError` for an unknown name."""
        return np.array([self._places[name] for name in names], dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Parameters(Mapping[str, float]):
    """Values of one robot's parameters by name, in mm, deg and ppm as its file has them.

    The mapping lists what a file lists: an optional parameter only if it is not 0, and the rate of
    ripples only beside a ripple: one value if all joints with a ripple have the same rate, else one
    for each of these joints. The rate of a joint without a ripple changes nothing.
    """

    table: ParameterTable
    values_in_file: tuple[float, ...]
    """Values of all of `table.of_robot`, (P,)."""
    covariance: Array | None = None
    """Covariance (P, P) in mm, deg, ppm; NaN where it is unknown. None: all of it is unknown."""
    rates: tuple[float, ...] = ()
    """Repetition of each joint's ripple, (n,), in the unit of `table.rate`; 0 where it is unknown.
    () if no rate is known."""

    @classmethod
    def of(
        cls,
        table: ParameterTable,
        values: Mapping[str, float],
        std: Mapping[str, float] | None = None,
    ) -> Self:
        """Take values by name, 0 for a missing optional one, and 1 σ by name where it is known.

        Names that no robot file has are ignored. Raise `KeyError` for a missing value.
        """
        ordered = [values[name] for name in table.names]
        ordered += [values.get(name, 0.0) for name in table.of_robot[len(ordered) :]]
        covariance = None
        if std is not None:
            covariance = np.full((len(ordered), len(ordered)), np.nan)
            np.fill_diagonal(covariance, [std.get(n, np.nan) ** 2 for n in table.of_robot])
        rates = stated_rates(table, values)
        return cls(table, tuple(map(float, ordered)), covariance, rates)

    @classmethod
    def of_vector(cls, table: ParameterTable, p: Array, rates: tuple[float, ...] = ()) -> Self:
        """Take the values from a vector (P,), or from its geometry (G,) alone."""
        whole = table.whole(p)
        return cls(table, tuple((whole / table.file_unit[: len(whole)]).tolist()), rates=rates)

    @property
    def rippling_arms(self) -> tuple[int, ...]:
        """Arms with a ripple that is not 0."""
        named = zip(self.table.rows, self.values_in_file, strict=False)
        ripples = (p.arm for p, value in named if value and p.field.group == "ripple")
        return tuple(sorted({arm for arm in ripples if arm is not None}))

    @cached_property
    def _listed(self) -> dict[str, float]:
        named = zip(self.table.rows, self.values_in_file, strict=False)
        listed = {p.name: v for p, v in named if v or p.field.role not in OPTIONAL}
        if not self.rates or not (arms := self.rippling_arms):
            return listed
        rates = [self.rates[arm] for arm in arms]
        if len({*rates}) > 1:
            rates = [rate if arm in arms else 0.0 for arm, rate in enumerate(self.rates)]
        return listed | self.table.named_rates(rates)

    def __getitem__(self, name: str) -> float:
        """Return the value of a listed parameter; raise `KeyError` for any other."""
        return self._listed[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._listed)

    def __len__(self) -> int:
        return len(self._listed)

    def __hash__(self) -> int:
        return hash(self.values_in_file)

    def __repr__(self) -> str:
        return f"<Parameters: {len(self)} of {self.table.arms} arms>"

    def __str__(self) -> str:
        std = self.std or {}
        lines = (
            f"{name:28}{value:14.6f}" + (f" ± {std[name]:.6f}" if name in std else "")
            for name, value in self.items()
        )
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return the values by name, with 1 σ where it is known, as a text for notebooks."""
        return f"<pre>{escape(str(self))}</pre>"

    @cached_property
    def vector(self) -> Array:
        """Vector (P,) in mm, rad and ratios."""
        values = np.array(self.values_in_file)
        return np.asarray(values * self.table.file_unit[: len(values)])

    @property
    def std(self) -> dict[str, float] | None:
        """1 σ by name where it is known, in mm, deg and ppm; None if all of it is unknown."""
        if self.covariance is None:
            return None
        std = np.sqrt(np.diag(self.covariance)).tolist()
        named = zip(self.table.of_robot, std, strict=True)
        return {name: value for name, value in named if value == value}  # NaN is unknown

    @property
    def extended_by(self) -> tuple[str, ...]:
        """Names of the optional parameters that are not 0."""
        return tuple(name for name in self.table.optional if name in self)

    def __or__(self, other: Mapping[str, float]) -> dict[str, float]:
        """Return the values by name, replaced by `other` where it has the name too."""
        return {**self, **other}

    def __ror__(self, other: Mapping[str, float]) -> dict[str, float]:
        """Return `other`, replaced by these values where both have a name."""
        return {**other, **self}

    def digest(self) -> str:
        """Return the SHA-256 of all listed values: equal exactly when all doubles are.

        Hashed are lines `name=value`, the value in the shortest decimals that give the double.
        """
        # adding 0.0 makes 0.0 of -0.0, which is equal but is written otherwise
        lines = "".join(f"{name}={value + 0.0!r}\n" for name, value in self.items())
        return hashlib.sha256(lines.encode("ascii")).hexdigest()


def stated_rates(
    table: ParameterTable, values: Mapping[str, float], default: Sequence[float] = ()
) -> tuple[float, ...]:
    """Return the rates of ripples, (n,), that values state: the common one or a joint's own.

    `default` (n,) holds those of joints for which the values state none or 0; () is 0 for all.
    """
    none = (0.0,) * table.arms
    if isinstance(values, Parameters):  # what it lists leaves out joints without a ripple
        stated = values.rates or none
    else:
        common = values.get(table.rate.name, 0.0)
        stated = tuple(float(values.get(name, common)) for name in table.rates)
    return tuple(rate or other for rate, other in zip(stated, default or none, strict=True))
