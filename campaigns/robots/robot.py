"""Robots: a parameter set with its limits, read from and written to robot files."""

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import JsonValue
from ruamel.yaml.comments import CommentedMap

from campaigns.arrays import Array
from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import write_new_text
from campaigns.files.wording import nearest_word, suggestion
from campaigns.files.yaml_file import (
    YamlDocument,
    checked,
    parse_document,
    read_document,
    yaml_text,
)
from campaigns.mechanisms.feasibility import Limits
from campaigns.mechanisms.geometry import (
    ARM_FIELDS,
    ARMS,
    AXIS_TILT_NAMES,
    PARAMETER_NAMES,
    Geometry,
)
from campaigns.robots.schema import SCHEMA, LimitsContents, RobotContents
from drivers.values import Pose

Range = tuple[float, float]

NO_TILTS = (0.0,) * ARMS
TILT = "axis_tilt_deg"
GEOMETRY = PARAMETER_NAMES + AXIS_TILT_NAMES
WITHOUT_TILTS = "--fix 'arm*.axis_tilt_deg'"
"""What has `identify` find a set that controllers take."""
NOT_FOR_CONTROLLERS = (
    f"no controller takes axis tilts: identify with {WITHOUT_TILTS} for a set to load"
)
"""Said where such a set is found and where it is written."""


@dataclass(frozen=True, slots=True)
class RobotLimits:
    """What the mechanism allows: lowest and highest joint angle and θ, forearm out of its plane."""

    joint_rad: Range
    theta_rad: Range
    forearm_swing_rad: float


@dataclass(frozen=True, slots=True)
class RobotFile:
    """A robot: its 29 parameters in the order of `PARAMETER_NAMES` (mm, deg), and its limits.

    Beyond the 29 its motors' axes may be tilted, one angle an arm. An identified set also has its
    standard deviations (1 σ, mm or deg, of what was free) and says where it comes from.
    """

    name: str
    values: tuple[float, ...]
    limits: RobotLimits
    uncertainty: Mapping[str, float] | None = None
    provenance: Mapping[str, JsonValue] | None = None
    axis_tilt_deg: tuple[float, ...] = NO_TILTS

    @classmethod
    def from_flat(cls, flat: Mapping[str, float], *, name: str, limits: RobotLimits) -> Self:
        """Make one from the 29 by flat name, and axis tilts if any; raises `ConfigInvalid`."""
        values, tilts_deg = _ordered_values(flat, name)
        return cls(name, values, limits, axis_tilt_deg=tilts_deg)

    def geometry_flat(self) -> dict[str, float]:
        """Return the 29 by flat name, in order, in mm and deg, then axis tilts that are not 0."""
        tilts = zip(AXIS_TILT_NAMES, self.axis_tilt_deg, strict=True)
        flat = dict(zip(PARAMETER_NAMES, self.values, strict=True))
        return flat | {name: tilt_deg for name, tilt_deg in tilts if tilt_deg}

    @property
    def is_tilted(self) -> bool:
        """Whether a motor's axis is tilted, which no controller knows of."""
        return any(self.axis_tilt_deg)

    def controller_flat(self) -> dict[str, float]:
        """Return the 29 that a controller knows; raises `ConfigInvalid` when an axis is tilted."""
        flat = self.geometry_flat()
        if tilted := [name for name in AXIS_TILT_NAMES if name in flat]:
            raise ConfigInvalid(
                f"{self.name}: {tilted[0]} is {flat[tilted[0]]:g}, but the controller's kinematics "
                "has no axis tilts",
                remedy=f"identify again with {WITHOUT_TILTS}, and export again",
            )
        return flat

    def digest(self) -> str:
        """Return the geometry's sha256: equal exactly when all its doubles are.

        It is taken of lines `name=value`, the value in the shortest decimals that give the double.
        """
        named = self.geometry_flat().items()
        text = "".join(f"{name}={value + 0.0!r}\n" for name, value in named)  # -0.0 becomes 0.0
        return hashlib.sha256(text.encode("ascii")).hexdigest()


@dataclass(frozen=True, slots=True)
class RobotDocument:
    """A robot with the document it stands in, comments and all."""

    robot: RobotFile
    document: YamlDocument


@dataclass(frozen=True, slots=True)
class Compensation:
    """What an identification adds to a nominal robot; parameters by flat name, mm and deg."""

    name: str
    geometry: Mapping[str, float]
    uncertainty: Mapping[str, float]
    provenance: Mapping[str, JsonValue]


def read_robot(path: Path) -> RobotDocument:
    """Read and check a robot file; raises `ConfigInvalid`."""
    return _robot_of(
        read_document(path, if_missing="give a robot file, or the name of a shipped robot")
    )


def find_robot(name_or_path: str) -> RobotDocument:
    """Read a shipped robot by its name, or a file; raises `ConfigInvalid`."""
    shipped = _shipped_robots()
    if name_or_path in shipped:
        text = shipped[name_or_path].read_text(encoding="utf-8")
        return _robot_of(parse_document(text, f"{name_or_path}.yaml"))
    if Path(name_or_path).exists():
        return read_robot(Path(name_or_path))
    nearest = nearest_word(name_or_path, shipped)
    raise ConfigInvalid(
        f"robot '{name_or_path}' is neither a shipped robot nor a file",
        remedy=(f"did you mean {nearest}? " if nearest else "") + f"shipped: {', '.join(shipped)}",
    )


def compensated(nominal: RobotDocument, compensation: Compensation) -> RobotDocument:
    """Put an identified set into a copy of the nominal's document; its comments stay.

    Raises `ConfigInvalid` when the set would not make a robot file.
    """
    values, tilts_deg = _ordered_values(compensation.geometry, compensation.name)
    tree = nominal.document.editable_tree()
    _set_values(tree["geometry"], values)
    _set_tilts(tree["geometry"], tilts_deg)
    tree["name"] = compensation.name
    tree["uncertainty"] = dict(compensation.uncertainty)
    tree["provenance"] = dict(compensation.provenance)
    tree["sha256"] = replace(nominal.robot, values=values, axis_tilt_deg=tilts_deg).digest()
    return _robot_of(parse_document(yaml_text(tree), compensation.name))


def write_new_robot(path: Path, robot: RobotDocument) -> None:
    """Write a robot file that must not exist yet; raises `OutputExists` or `WriteFailed`."""
    write_new_text(path, robot.document.text)


def _set_values(geometry: CommentedMap, values: tuple[float, ...]) -> None:
    """Replace what differs; what stays equal keeps the form in which it was written."""
    holders = [(arm, field) for arm in geometry["arms"] for field in ARM_FIELDS]
    for (holder, field), value in zip([*holders, (geometry, "plate_mm")], values, strict=True):
        if holder[field] != value:
            holder[field] = value


def _set_tilts(geometry: CommentedMap, tilts_deg: tuple[float, ...]) -> None:
    """Replace what differs; only an axis that is tilted has the key."""
    for arm, tilt_deg in zip(geometry["arms"], tilts_deg, strict=True):
        if arm.get(TILT, 0.0) == tilt_deg:
            continue
        if tilt_deg:
            arm[TILT] = tilt_deg
        else:
            del arm[TILT]


def _ordered_values(
    flat: Mapping[str, float], name: str
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The 29 and the axis tilts, those that are not given being 0; raises `ConfigInvalid`."""
    for unknown in flat.keys() - set(GEOMETRY):
        raise ConfigInvalid(
            f"{name}: {unknown} is not a parameter of a robot",
            remedy=suggestion(unknown, GEOMETRY),
        )
    given = dict.fromkeys(AXIS_TILT_NAMES, 0.0) | dict(flat)
    for parameter in GEOMETRY:
        if not math.isfinite(given.get(parameter, math.nan)):
            raise ConfigInvalid(
                f"{name}: {parameter} is {given.get(parameter, 'missing')}",
                remedy=f"give finite values for all {len(PARAMETER_NAMES)} parameters",
            )
    values = tuple(float(given[parameter]) for parameter in PARAMETER_NAMES)
    return values, tuple(float(given[parameter]) for parameter in AXIS_TILT_NAMES)


def _shipped_robots() -> dict[str, Traversable]:
    """Return the robot files that come with the software, by name."""
    folder = resources.files("campaigns.robots")
    files = {file.name.removesuffix(".yaml"): file for file in folder.iterdir()}
    return {name: files[name] for name in sorted(files) if files[name].name.endswith(".yaml")}


def _robot_of(document: YamlDocument) -> RobotDocument:
    """Check a document; raises `ConfigInvalid`, also when its sha256 is not its geometry's."""
    contents = checked(document, SCHEMA, RobotContents)
    robot = _robot(contents)
    if contents.sha256 not in {None, robot.digest()}:
        raise ConfigInvalid(
            f"{document.place_of('sha256')}: sha256 is {contents.sha256}, "
            f"but of the geometry it is {robot.digest()}",
            remedy="somebody changed the geometry: restore the file, or delete the line sha256",
        )
    return RobotDocument(robot, document)


def _robot(contents: RobotContents) -> RobotFile:
    geometry = contents.geometry
    arms = (getattr(arm, field) for arm in geometry.arms for field in ARM_FIELDS)
    values = (*arms, geometry.plate_mm)
    return RobotFile(
        contents.name,
        values,
        _limits(contents.limits),
        contents.uncertainty,
        contents.provenance,
        tuple(arm.axis_tilt_deg for arm in geometry.arms),
    )


def _limits(contents: LimitsContents) -> RobotLimits:
    return RobotLimits(
        joint_rad=_radians(contents.joint_deg),
        theta_rad=_radians(contents.theta_deg),
        forearm_swing_rad=math.radians(contents.forearm_swing_deg),
    )


def _radians(limits_deg: Range) -> Range:
    low_deg, high_deg = limits_deg
    return math.radians(low_deg), math.radians(high_deg)


def numeric_geometry(robot: RobotFile) -> Geometry:
    """The parameter set as arrays."""
    return Geometry.from_flat(robot.geometry_flat())


def numeric_limits(robot: RobotFile) -> Limits:
    """The limits as the numerics want them."""
    return Limits(robot.limits.joint_rad, robot.limits.theta_rad, robot.limits.forearm_swing_rad)


def pose_row(pose: Pose) -> Array:
    """X, Y, Z in mm and θ in rad, (4,)."""
    return np.array([pose.x_mm, pose.y_mm, pose.z_mm, pose.theta_rad], dtype=np.float64)


def pose_of(row: Array) -> Pose:
    """A row (4,) as a pose."""
    return Pose(*(float(value) for value in row))
