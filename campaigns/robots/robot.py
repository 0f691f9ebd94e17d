"""Robot files: one robot's parameter set with its limits, read from and written to YAML."""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import JsonValue
from ruamel.yaml.comments import CommentedMap

from campaigns.arrays import Array
from campaigns.errors import ConfigInvalid
from campaigns.files import yaml_file
from campaigns.files.text_file import read_text, write_new_text
from campaigns.files.wording import suggestion
from campaigns.kinematics.axes import Axis, Interval
from campaigns.kinematics.catalog import PYTHON, find_mechanism
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.mechanism import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.kinematics.transmission import STEEPEST_ERROR
from campaigns.robots.reach import middle_of_reach_mm
from campaigns.robots.schema import SCHEMA, RobotContents, Tolerance, contents_model
from drivers.bounded_files import is_there
from drivers.texts import nearest_word
from drivers.values import Pose, Vector3

FOR_SOME_CONTROLLERS = (
    "only a controller that computes plate tilt takes axis tilts and skews, as LinuxCNC with "
    "pkmkins does; for any other, and for errors of gears and encoders: export --format plain, or "
    "`pkmcal correct`"
)
"""Remark where such a set is found and where it is written."""
INNER_OF = {"mm": 1.0, "deg": math.pi / 180.0, "ppm": 1e-6}
"""Factors from units of tolerances to those of the fit."""
EXPANSION, EXPANSIONS = "_expansion_ppm", "expansion_ppm_per_degC"
REFERENCE = "reference_temperature_degC"
LONGEST_IN_METRES = 5.0
"""Lengths up to this many m are those of robots; up to this many mm of none."""


@dataclass(frozen=True, slots=True)
class RobotFile:
    """Parameter set of one robot, and the robot's limits.

    An identified set also has standard deviations and says where it comes from.
    """

    name: str
    mechanism: ClosedChain
    parameters: Parameters
    limits: Limits
    provenance: Mapping[str, JsonValue] | None = None
    workspace_centre_mm: Vector3 | None = None
    tolerance: Tolerance = field(default_factory=Tolerance)
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """1 σ of parts about nominal by group and unit (`rods_deg`), in mm, rad or ratios."""
    expansions: Mapping[str, float] = field(default_factory=dict)
    """By the names of `parameters.thermal`, ppm/°C, where the file says."""
    reference_degC: float | None = None
    """Temperature of parts for which parameters are stated, where the file says."""

    def __repr__(self) -> str:
        kind = "identified" if self.provenance else "nominal"
        return f"<RobotFile: {self.name}, {kind} {self.mechanism.name}>"

    @classmethod
    def of(
        cls, mechanism: ClosedChain, values: Mapping[str, float], *, name: str, limits: Limits
    ) -> Self:
        """Robot from values by name, the optional 0 if not named; raises `ConfigInvalid`."""
        checked = checked_parameters(mechanism, values, name)
        return cls(name, mechanism.with_ripples(checked.rate), checked, limits)

    @property
    def kinematics(self) -> Kinematics:
        """Kinematic model of the robot."""
        return Kinematics(self.mechanism, self.parameters.vector)

    @property
    def is_extended(self) -> bool:
        """Whether a parameter beyond those that every controller knows is not 0."""
        return bool(self.parameters.extended_by)

    def require_known(self, lacking: Collection[str], remedy: str) -> None:
        """Raise `ConfigInvalid` where a parameter that a controller lacks is not 0."""
        values = self.parameters
        beyond = [name for name in lacking if name in values]
        if beyond:
            raise ConfigInvalid(
                f"{self.name}: {beyond[0]} is {values[beyond[0]]:g}, but the controller's "
                f"kinematics has no {values.table[beyond[0]].field.words}s",
                remedy=remedy,
            )

    @property
    def workspace_centre(self) -> Array:
        """Pose well inside the workspace, (t,), mm and rad: the file's, or where it reaches most.

        Raises `ConfigInvalid` for a robot that reaches nothing.
        """
        centre = np.zeros(len(self.mechanism.task))
        centre[:3] = self.workspace_centre_mm or middle_of_reach_mm(self.kinematics, self.limits)
        return centre

    def digest(self) -> str:
        """SHA-256 of the geometry: equal exactly when all its doubles are."""
        return self.parameters.digest()


@dataclass(frozen=True, slots=True)
class RobotDocument:
    """A robot with the document it stands in, comments and all."""

    robot: RobotFile
    document: yaml_file.YamlDocument

    def files_in(self, folder: Path, name: str) -> dict[Path, str]:
        """Return the texts of a copy of it in a folder, with the Python file of its mechanism."""
        file, colon, mechanism = str(self.document.tree["mechanism"]).rpartition(":")
        if not colon:
            return {folder / name: self.document.text}
        module, tree = Path(self.document.name).parent / file, self.document.editable_tree()
        tree["mechanism"] = f"{module.name}:{mechanism}"
        code = read_text(module, ConfigInvalid, if_missing="give the mechanism's file again")
        return {folder / module.name: code, folder / name: yaml_file.yaml_text(tree)}


def read_robot(path: Path) -> RobotDocument:
    """Read and check a robot file; raises `ConfigInvalid`."""
    remedy = "give a robot file, or the name of a shipped robot"
    return _robot_of(yaml_file.read_document(path, if_missing=remedy))


def find_robot(name_or_path: str) -> RobotDocument:
    """Read a shipped robot by its name, or a file; raises `ConfigInvalid`.

    A mechanism of one's own, `my.py:OWN`, has typical values: those of a shipped robot.
    """
    shipped = shipped_robots()
    if name_or_path in shipped:
        text = shipped[name_or_path].read_text(encoding="utf-8")
        return parse_robot(text, f"{name_or_path}.yaml")
    if name_or_path.rpartition(":")[0].endswith(PYTHON):
        return _typical_of(name_or_path)
    if is_there(Path(name_or_path)):
        return read_robot(Path(name_or_path))
    nearest = nearest_word(name_or_path, shipped)
    raise ConfigInvalid(
        f"robot '{name_or_path}' is neither a shipped robot nor a file",
        remedy=(f"did you mean {nearest}? " if nearest else "") + f"shipped: {', '.join(shipped)}",
    )


def parse_robot(text: str, name: str) -> RobotDocument:
    """Check the text of a robot file; raises `ConfigInvalid`."""
    return _robot_of(yaml_file.parse_document(text, name))


def shipped_of(mechanism: ClosedChain) -> RobotDocument:
    """Return the first shipped robot of a mechanism."""
    robots = map(find_robot, shipped_robots())
    return next(each for each in robots if each.robot.mechanism.name == mechanism.name)


def _typical_of(word: str) -> RobotDocument:
    """Return the first shipped robot that has a mechanism's parameters, as one of that mechanism.

    `word` names the mechanism as `my.py:OWN`. Raise `ConfigInvalid` where no robot has them.
    """
    contents_model(word, Path())  # refuses a word that gives no mechanism
    mechanism = find_mechanism(word)
    assert mechanism is not None, "as contents_model has found it"
    names = mechanism.parameters.names
    for shipped in map(find_robot, shipped_robots()):
        if shipped.robot.mechanism.parameters.names == names:
            tree = shipped.document.editable_tree()
            tree |= {"mechanism": Path(word).name, "name": mechanism.name}
            return parse_robot(yaml_file.yaml_text(tree), word)
    raise ConfigInvalid(
        f"{word}: no shipped robot has its parameters, so nothing says its sizes",
        remedy=f"write a robot file with `mechanism: {word}`, and give that",
    )


def compensated(
    nominal: RobotDocument,
    name: str,
    parameters: Mapping[str, float],
    provenance: Mapping[str, JsonValue] | None = None,
    expansions: Mapping[str, float] | None = None,
    reference_degC: float | None = None,
) -> RobotDocument:
    """Put other parameters, with their 1 σ, into a copy of the nominal's document.

    Its comments stay. Raises `ConfigInvalid` when the set would not make a robot file.
    """
    checked = checked_parameters(nominal.robot.mechanism, parameters, name)
    std = parameters.std if isinstance(parameters, Parameters) else None
    tree = nominal.document.editable_tree()
    _set_values(tree["geometry"], checked)
    tree["name"] = name
    for key in (EXPANSIONS, REFERENCE):
        tree.pop(key, None)  # the nominal's are of other lengths
    if expansions:
        tree[EXPANSIONS] = {key.removesuffix(EXPANSION): ppm for key, ppm in expansions.items()}
        if reference_degC is not None:
            tree[REFERENCE] = reference_degC
    if (
        rate := checked.table.rate.name
    ) in checked and checked.rate != nominal.robot.mechanism.rate:
        tree[rate] = checked.rate
    tree["uncertainty"] = std or {}
    tree["provenance"] = dict(provenance or {})
    tree["sha256"] = checked.digest()
    where = str(Path(nominal.document.name).parent / name)
    return parse_robot(yaml_file.yaml_text(tree), where)


def with_ripples_per_turn(robot: RobotDocument, ripples_per_turn: float) -> RobotDocument:
    """Return the same robot with its gears' rate in the document."""
    tree = robot.document.editable_tree()
    tree["ripples_per_turn"] = ripples_per_turn
    return parse_robot(yaml_file.yaml_text(tree), robot.document.name)


def write_new_robot(path: Path, robot: RobotDocument) -> None:
    """Write a robot file that must not exist yet; raises `OutputExists` or `WriteFailed`."""
    write_new_text(path, robot.document.text)


def _set_values(geometry: CommentedMap, parameters: Parameters) -> None:
    """Replace what differs; what stays equal keeps the form in which it was written.

    What is optional and becomes 0 leaves the file.
    """
    for parameter in map(parameters.table.__getitem__, parameters.table.of_robot):
        holder = geometry if parameter.arm is None else geometry["arms"][parameter.arm]
        value = parameters.get(parameter.name, 0.0)
        if value == holder.get(parameter.field.name, 0.0):
            continue
        if parameter.name in parameters:
            holder[parameter.field.name] = value
        else:
            del holder[parameter.field.name]


def checked_parameters(
    mechanism: ClosedChain,
    values: Mapping[str, float],
    name: str,
    std: Mapping[str, float] | None = None,
) -> Parameters:
    """Parameters of values by name, the optional ones 0 if not given, and 1 σ of some.

    The rate of ripples is the mechanism's unless the values have one. `name` says whose they are.
    Raises `ConfigInvalid` for what is unknown, missing or not finite.
    """
    space = mechanism.parameters
    values = {space.rate.name: mechanism.rate, **values}
    for unknown in values.keys() - {*space.of_robot, space.rate.name}:
        raise ConfigInvalid(
            f"{name}: {unknown} is not a parameter of a robot",
            remedy=suggestion(unknown, space.of_robot),
        )
    for parameter in (*space.names, *(each for each in space.optional if each in values)):
        if not math.isfinite(values.get(parameter, math.nan)):
            raise ConfigInvalid(
                f"{name}: {parameter} is {values.get(parameter, 'missing')}",
                remedy=f"give finite values for all {len(space.names)} parameters",
            )
    return Parameters.of(space, values, std)


def require_millimetres(parameters: Parameters, where: str) -> None:
    """Raise `ConfigInvalid` for a robot whose lengths look like metres: all are a few mm at most.

    No laser tracker's reflector would fit on so small a robot.
    """
    table = parameters.table
    lengths = [name for name in table.of_robot if table[name].field.quantity == "length"]
    longest = max(lengths, key=parameters.__getitem__)
    if parameters[longest] < LONGEST_IN_METRES:
        raise ConfigInvalid(
            f"{where}: {longest} is {parameters[longest]:g}, and no length is above "
            f"{LONGEST_IN_METRES:g} mm: metres?",
            remedy=f"give places and lengths in mm, such as {1000.0 * parameters[longest]:g}",
        )


def shipped_robots() -> dict[str, Traversable]:
    """Return the robot files that come with the software, by name."""
    files = [f for f in resources.files("campaigns.robots").iterdir() if f.name.endswith(".yaml")]
    return {f.name.removesuffix(".yaml"): f for f in sorted(files, key=lambda file: file.name)}


def _robot_of(document: yaml_file.YamlDocument) -> RobotDocument:
    """Check a document; raises `ConfigInvalid`, also when its sha256 is not its geometry's."""
    folder = Path(document.name).parent
    model = contents_model(document.tree.get("mechanism"), folder)
    contents = yaml_file.checked(document, SCHEMA, model)
    mechanism = find_mechanism(contents.mechanism, folder)
    assert mechanism is not None  # the schema has refused other words
    if contents.reflector_half is not None:
        try:
            mechanism = mechanism.seen_from(contents.reflector_half)
        except ValueError as error:
            raise ConfigInvalid(
                f"{document.place_of('reflector_half')}: {error}", remedy="delete the line"
            ) from error
    rate = mechanism.parameters.rate.name
    of_all = contents.geometry.model_dump()
    of_arms = of_all.pop("arms")
    values = {rate: getattr(contents, rate) or 0.0}
    for parameter in map(mechanism.parameters.__getitem__, mechanism.parameters.of_robot):
        holder = of_all if parameter.arm is None else of_arms[parameter.arm]
        values[parameter.name] = holder[parameter.field.name]
    parameters = checked_parameters(mechanism, values, contents.name, contents.uncertainty)
    require_millimetres(parameters, f"{document.place_of('geometry')}")
    robot = RobotFile(
        contents.name,
        _drawn(mechanism, parameters, contents),
        parameters,
        _limits(mechanism, contents.limits),
        contents.provenance,
        contents.workspace_centre_mm,
        contents.tolerance,
        {key: INNER_OF[key.rpartition("_")[2]] * v for key, v in contents.tolerances.items()},
        {f"{n}{EXPANSION}": v for n, v in (contents.expansion_ppm_per_degC or {}).items()},
        contents.reference_temperature_degC,
    )
    if contents.sha256 not in {None, robot.digest()}:
        raise ConfigInvalid(
            f"{document.place_of('sha256')}: sha256 is {contents.sha256}, "
            f"but of the geometry it is {robot.digest()}",
            remedy="somebody changed the geometry: restore the file, or delete the line sha256",
        )
    return RobotDocument(robot, document)


def _drawn(mechanism: ClosedChain, parameters: Parameters, contents: RobotContents) -> ClosedChain:
    """Add the file's plate and drives; raises `ConfigInvalid` for ripples without a rate.

    A ripple needs its period, and no error of a joint may turn its motion round.
    """
    typical = mechanism.geometry(parameters.vector).plate
    plate = replace(
        typical,
        joints_mm=contents.plate_joints_mm or typical.joints_mm,
        reflector_mm=contents.reflector_mm or typical.reflector_mm,
    )
    drawn = mechanism.with_plate(plate).with_ripples(parameters.rate)
    ripples = [
        name for name in parameters.extended_by if parameters.table[name].field.group == "ripple"
    ]
    if ripples and not parameters.rate:
        raise ConfigInvalid(
            f"{contents.name}: {ripples[0]} is {parameters[ripples[0]]:g}, but the file does not "
            "say how often it comes",
            remedy="give ripples_per_turn, or drive_period_mm of robots on rails",
        )
    if (steepest := drawn.steepest_error(parameters.vector)) > STEEPEST_ERROR:
        raise ConfigInvalid(
            f"{contents.name}: the errors of a joint change by {steepest:.2g} of its motion, "
            f"limit {STEEPEST_ERROR:g}",
            remedy="correct the encoder gains, eccentricities and ripples, which are small",
        )
    return drawn


def _limits(mechanism: ClosedChain, limits: yaml_file.FileModel) -> Limits:
    values = limits.model_dump()
    joint = mechanism.joints[0]

    def interval_of(axis: Axis, ends: Interval | None) -> Interval | None:
        return ends and (axis.from_file(ends[0]), axis.from_file(ends[1]))

    of_joints = interval_of(joint, values[f"joint_{joint.unit}"])
    assert of_joints is not None, "the schema requires it"
    of_task = tuple(interval_of(axis, values.get(axis.column)) for axis in mechanism.task)
    return Limits(of_joints, of_task, math.radians(values["forearm_swing_deg"]))


def pose_row(pose: Pose) -> Array:
    """Task coordinates, (t,), mm and rad."""
    return np.array(pose.coordinates, dtype=np.float64)


def pose_of(row: Iterable[float]) -> Pose:
    """Pose of task coordinates (t,)."""
    return Pose(*map(float, row))
