"""Robot files: one robot's parameter set with its limits, read from and written to YAML."""

import hashlib
import math
from collections.abc import Collection, Iterable, Mapping
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
    FileModel,
    YamlDocument,
    checked,
    parse_document,
    read_document,
    yaml_text,
)
from campaigns.mechanisms.catalog import MECHANISMS
from campaigns.mechanisms.mechanism import Axis, Interval, Kinematics, Limits, Mechanism
from campaigns.mechanisms.plate_tilt import PlateDrawing
from campaigns.robots.schema import SCHEMA, RobotContents, contents_model
from drivers.bounded_files import is_there
from drivers.values import Pose, Vector3

DEFAULT_CENTRE_MM = (0.0, 0.0, -575.0)
"""Centre for robots whose file says nothing of it: Par4's."""
FOR_SOME_CONTROLLERS = (
    "only a controller that computes plate tilt takes axis tilts and skews, as LinuxCNC with "
    "pkmkins does; for any other: export --format plain, or `pkmcal correct`"
)
"""Remark where such a set is found and where it is written."""


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Largest believable change of a parameter from its nominal value."""

    length_mm: float = 10.0
    angle_deg: float = 5.0

    def of(self, name: str) -> float:
        """Limit for a parameter by its name, in its file unit."""
        return self.angle_deg if name.endswith("_deg") else self.length_mm


@dataclass(frozen=True, slots=True)
class RobotFile:
    """Parameter set of one robot, in mm and deg as in its file, and the robot's limits.

    `values` are in the order of the mechanism's `parameters.geometry`. An identified set also has
    standard deviations (1 σ, of what was free) and says where it comes from.
    """

    name: str
    mechanism: Mechanism
    values: tuple[float, ...]
    limits: Limits
    uncertainty: Mapping[str, float] | None = None
    provenance: Mapping[str, JsonValue] | None = None
    workspace_centre_mm: Vector3 | None = None
    tolerance: Tolerance = Tolerance()

    @classmethod
    def from_flat(
        cls, mechanism: Mechanism, flat: Mapping[str, float], *, name: str, limits: Limits
    ) -> Self:
        """Robot from values by name, extensions being 0 if not named; raises `ConfigInvalid`."""
        return cls(name, mechanism, _ordered_values(mechanism, flat, name), limits)

    @property
    def kinematics(self) -> Kinematics:
        """Kinematic model of the robot."""
        return Kinematics.from_flat(self.mechanism, self.geometry_flat())

    def geometry_flat(self) -> dict[str, float]:
        """Values by name, in order, in mm and deg; extensions only where they are not 0."""
        space = self.mechanism.parameters
        named = zip(space.geometry, self.values, strict=True)
        return {name: value for name, value in named if name in space.names or value}

    @property
    def is_extended(self) -> bool:
        """Whether a parameter beyond those that every controller knows is not 0."""
        return bool(self.extended_by)

    @property
    def extended_by(self) -> tuple[str, ...]:
        """Names of extensions that are not 0."""
        flat = self.geometry_flat()
        return tuple(name for name in self.mechanism.parameters.extensions if name in flat)

    def controller_flat(self, lacking: Collection[str]) -> dict[str, float]:
        """Values for a controller that lacks some extensions, by name.

        Raises `ConfigInvalid` where one of these is not 0.
        """
        flat = self.geometry_flat()
        beyond = [name for name in lacking if name in flat]
        if beyond:
            fields = dict.fromkeys(name.rpartition(".")[2] for name in beyond)
            held = " ".join(f"--fix 'arm*.{field}'" for field in fields)
            what = beyond[0].rpartition(".")[2].rpartition("_")[0].replace("_", " ")
            raise ConfigInvalid(
                f"{self.name}: {beyond[0]} is {flat[beyond[0]]:g}, but the controller's "
                f"kinematics has no {what}s",
                remedy=f"identify again with {held}, and export again",
            )
        return flat

    @property
    def workspace_centre(self) -> Array:
        """Pose well inside the workspace, (t,), mm and rad."""
        centre = np.zeros(len(self.mechanism.task))
        centre[: len(DEFAULT_CENTRE_MM)] = self.workspace_centre_mm or DEFAULT_CENTRE_MM
        return centre

    def digest(self) -> str:
        """SHA-256 of the geometry: equal exactly when all its doubles are.

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
    """Additions of an identification to a nominal robot; parameters by flat name, mm and deg."""

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
    if is_there(Path(name_or_path)):
        return read_robot(Path(name_or_path))
    nearest = nearest_word(name_or_path, shipped)
    raise ConfigInvalid(
        f"robot '{name_or_path}' is neither a shipped robot nor a file",
        remedy=(f"did you mean {nearest}? " if nearest else "") + f"shipped: {', '.join(shipped)}",
    )


def parse_robot(text: str, name: str) -> RobotDocument:
    """Check the text of a robot file; raises `ConfigInvalid`."""
    return _robot_of(parse_document(text, name))


def shipped_of(mechanism: Mechanism) -> RobotDocument:
    """First shipped robot of a mechanism."""
    found = map(find_robot, _shipped_robots())
    return next(each for each in found if each.robot.mechanism.name == mechanism.name)


def compensated(nominal: RobotDocument, compensation: Compensation) -> RobotDocument:
    """Put an identified set into a copy of the nominal's document; its comments stay.

    Raises `ConfigInvalid` when the set would not make a robot file.
    """
    mechanism = nominal.robot.mechanism
    values = _ordered_values(mechanism, compensation.geometry, compensation.name)
    tree = nominal.document.editable_tree()
    _set_values(tree["geometry"], mechanism, values)
    tree["name"] = compensation.name
    tree["uncertainty"] = dict(compensation.uncertainty)
    tree["provenance"] = dict(compensation.provenance)
    tree["sha256"] = replace(nominal.robot, values=values).digest()
    return _robot_of(parse_document(yaml_text(tree), compensation.name))


def write_new_robot(path: Path, robot: RobotDocument) -> None:
    """Write a robot file that must not exist yet; raises `OutputExists` or `WriteFailed`."""
    write_new_text(path, robot.document.text)


def _set_values(geometry: CommentedMap, mechanism: Mechanism, values: tuple[float, ...]) -> None:
    """Replace what differs; what stays equal keeps the form in which it was written.

    An extension that becomes 0 leaves the file.
    """
    space = mechanism.parameters
    for name, value in zip(space.geometry, values, strict=True):
        arm, _, field = name.rpartition(".")
        holder = geometry["arms"][int(arm.removeprefix("arm"))] if arm else geometry
        before = holder.get(field, 0.0 if name in space.extensions else None)
        if before == value:
            continue
        if name in space.extensions and not value:
            del holder[field]
        else:
            holder[field] = value


def _ordered_values(
    mechanism: Mechanism, flat: Mapping[str, float], name: str
) -> tuple[float, ...]:
    """Values of `parameters.geometry`, extensions that are not given being 0.

    Raises `ConfigInvalid`.
    """
    space = mechanism.parameters
    for unknown in flat.keys() - set(space.geometry):
        raise ConfigInvalid(
            f"{name}: {unknown} is not a parameter of a robot",
            remedy=suggestion(unknown, space.geometry),
        )
    given = dict.fromkeys(space.extensions, 0.0) | dict(flat)
    for parameter in space.geometry:
        if not math.isfinite(given.get(parameter, math.nan)):
            raise ConfigInvalid(
                f"{name}: {parameter} is {given.get(parameter, 'missing')}",
                remedy=f"give finite values for all {len(space.names)} parameters",
            )
    return tuple(float(given[parameter]) for parameter in space.geometry)


def _shipped_robots() -> dict[str, Traversable]:
    """Return the robot files that come with the software, by name."""
    folder = resources.files("campaigns.robots")
    files = {file.name.removesuffix(".yaml"): file for file in folder.iterdir()}
    return {name: files[name] for name in sorted(files) if files[name].name.endswith(".yaml")}


def _robot_of(document: YamlDocument) -> RobotDocument:
    """Check a document; raises `ConfigInvalid`, also when its sha256 is not its geometry's."""
    contents = checked(document, SCHEMA, contents_model(document.tree.get("mechanism")))
    mechanism = MECHANISMS[contents.mechanism]
    values = _ordered_values(mechanism, _flat(contents.geometry), contents.name)
    robot = RobotFile(
        contents.name,
        mechanism.with_plate(_plate(mechanism, values, contents)),
        values,
        _limits(mechanism, contents.limits),
        contents.uncertainty,
        contents.provenance,
        contents.workspace_centre_mm,
        Tolerance(contents.tolerance.length_mm, contents.tolerance.angle_deg),
    )
    if contents.sha256 not in {None, robot.digest()}:
        raise ConfigInvalid(
            f"{document.place_of('sha256')}: sha256 is {contents.sha256}, "
            f"but of the geometry it is {robot.digest()}",
            remedy="somebody changed the geometry: restore the file, or delete the line sha256",
        )
    return RobotDocument(robot, document)


def _plate(mechanism: Mechanism, values: Iterable[float], contents: RobotContents) -> PlateDrawing:
    """Drawing of the plate, typical where the file does not say."""
    space = mechanism.parameters
    p = space.vector(dict(zip(space.geometry, values, strict=True)))
    typical = mechanism.typical_plate(p)
    return replace(
        typical,
        joints_mm=contents.plate_joints_mm or typical.joints_mm,
        reflector_mm=contents.reflector_mm or typical.reflector_mm,
    )


def _flat(geometry: FileModel) -> dict[str, float]:
    """Values by name, as the file has them."""
    values = geometry.model_dump()
    arms = enumerate(values.pop("arms"))
    of_arms = {f"arm{arm}.{field}": each for arm, row in arms for field, each in row.items()}
    return of_arms | values


def _limits(mechanism: Mechanism, limits: FileModel) -> Limits:
    values = limits.model_dump()
    joint = mechanism.joints[0]
    low, high = map(joint.from_file, values[f"joint_{joint.unit}"])
    return Limits(
        (low, high),
        tuple(_task_limit(axis, values.get(axis.column)) for axis in mechanism.task),
        math.radians(values["forearm_swing_deg"]),
    )


def _task_limit(axis: Axis, interval: Interval | None) -> Interval | None:
    if interval is None:
        return None
    low, high = map(axis.from_file, interval)
    return low, high


def pose_row(pose: Pose) -> Array:
    """Task coordinates, (t,), mm and rad."""
    return np.array(pose.coordinates, dtype=np.float64)


def pose_of(row: Iterable[float]) -> Pose:
    """Pose of task coordinates (t,)."""
    return Pose(*map(float, row))
