"""Robot files: one robot's parameter set with its limits, read from and written to YAML.

A file names a mechanism, and the mechanism decides which keys the geometry and the limits have
(`schema.py`). From a checked file comes a `RobotFile`: the mechanism with the plate and drives of
this robot, the parameters by name (mm, deg, ppm as in the file), the limits in mm and rad. It
travels with its `RobotDocument`, the text it was read from.

An identified set is written by putting its numbers into a copy of the nominal robot's document, so
people's comments and the form of unchanged numbers stay, and a comparison of the two files shows
the calibration alone. The copy also holds 1 σ, where the numbers come from, and the SHA-256 of its
geometry. Reading refuses a file whose numbers no longer match it, for σ and origin would then stand
beside numbers that no identification has given.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Self

import numpy as np
from pydantic import JsonValue
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from campaigns.arrays import Array
from campaigns.errors import ConfigInvalid
from campaigns.files import yaml_file
from campaigns.files.text_file import read_text, write_new_text
from campaigns.files.wording import shown, suggestion
from campaigns.fit.error_sources import SOURCES
from campaigns.kinematics.axes import Axis, Interval
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.implicit import ImplicitMechanism
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Parameters, stated_rates
from campaigns.kinematics.transmission import STEEPEST_ERROR
from campaigns.robots.printer_config import PRINTER, PrinterConfig
from campaigns.robots.program import PYTHON, find_mechanism
from campaigns.robots.reach import middle_of_reach_mm
from campaigns.robots.schema import SCHEMA, RobotContents, Tolerance, contents_model
from drivers.bounded_files import is_there
from drivers.texts import nearest_word
from drivers.values import Pose, Vector3, vector

FOR_SOME_CONTROLLERS = (
    "only a controller that computes plate tilt takes axis tilts and skews, as LinuxCNC with "
    "pkmkins does; for any other, and for errors of gears and encoders: export --format plain, or "
    "`pkmcal correct`"
)
"""Remark on a set with tilts and skews, for the user who writes it to a file."""
FOR_CONTROLLERS_WITH_ALL = (
    "only a controller that computes with errors of gears and encoders takes them; for any other: "
    "`pkmcal correct`"
)
"""The same of a mechanism whose plain form is not known."""
INNER_OF = {"mm": 1.0, "deg": math.pi / 180.0, "ppm": 1e-6}
"""Factors from the units of tolerances in the file to mm, rad and ratios."""
EXPANSION, EXPANSIONS = "_expansion_ppm", "expansion_ppm_per_degC"
REFERENCE = "reference_temperature_degC"
STATED_REFLECTOR_MM = 3.0
"""1 σ of a reflector's place that a file states without its own σ: measured by a ruler."""
LONGEST_IN_METRES = 5.0
"""No robot is longer than this in m, and none is this short in mm."""


@dataclass(frozen=True, slots=True)
class RobotFile:
    """Parameter set of one robot, and the robot's limits.

    An identified set also has standard deviations and says where it comes from.
    """

    name: str
    mechanism: Mechanism
    parameters: Parameters
    limits: Limits
    provenance: Mapping[str, JsonValue] | None = None
    workspace_centre_mm: Vector3 | None = None
    tolerance: Tolerance = field(default_factory=Tolerance)
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """1 σ of parts about their nominal values by group and unit (`rods_deg`): mm, rad or ratios."""
    expansions: Mapping[str, float] = field(default_factory=dict)
    """Expansions by the names of `parameters.thermal`, ppm/°C; empty if the file states none."""
    reference_degC: float | None = None
    """Temperature of the parts for which the parameters are stated, °C; None if not stated."""
    document: yaml_file.YamlDocument | None = field(default=None, compare=False)
    """Document that it was read from; None of a robot made in memory."""

    def __repr__(self) -> str:
        kind = "identified" if self.provenance else "nominal"
        return f"<RobotFile: {self.name}, {kind} {self.mechanism.name}>"

    @classmethod
    def of(
        cls, mechanism: Mechanism, values: Mapping[str, float], *, name: str, limits: Limits
    ) -> Self:
        """Make a robot of values by name.

        Args:
            mechanism: Its kind.
            values: Parameters by name (`arm0.x_mm`), mm, deg and ppm; optional ones may be missing.
            name: Its name.
            limits: Limits of its joints and poses, mm and rad; their middle is home.

        Returns:
            The robot, without a file.

        Raises:
            ConfigInvalid: A value is missing, unknown or not finite.
        """
        checked = checked_parameters(mechanism, values, name)
        homed = mechanism.with_ripples(checked.rates).with_home(_home(limits, None))
        return cls(name, homed, checked, limits)

    def save(self, path: Path | str) -> None:
        """Write the robot to a file that must not exist yet, as `find_robot` reads it.

        Args:
            path: The file. A mechanism of a Python file is named without a folder: copy it beside.

        Raises:
            ConfigInvalid: No document states this robot.
            OutputExists: The file exists.
            WriteFailed: The file cannot be written.

        Example:
            >>> result.robot.save("cell-7-identified.yaml")
        """
        if (source := self.source) is None:
            raise ConfigInvalid(
                f"{self.name} was made or changed in memory, and no document states it",
                remedy="save a robot as find_robot or an identification of such a one returned it",
            )
        write_new_robot(Path(path), source)

    @property
    def source(self) -> "RobotDocument | None":
        """This robot with its document; None if it was made or changed in memory."""
        # `dataclasses.replace` changes a field and keeps the document, which then states another
        # robot. What the document states is what reading it gives.
        if self.document is None:
            return None
        read = _parse_document(self.document).robot
        stated = (
            "name", "limits", "workspace_centre_mm", "tolerance", "tolerances", "expansions",
            "reference_degC",
        )  # fmt: skip
        same = all(getattr(read, each) == getattr(self, each) for each in stated)
        is_same = same and read.digest() == self.digest()
        return RobotDocument(self, self.document) if is_same else None

    @property
    def kinematics(self) -> Kinematics:
        """Kinematic model of the robot."""
        return Kinematics(self.mechanism, self.parameters.vector)

    # A controller turns its plate about the controlled point. The fitted place of a reflector on
    # another part would move that point by the tilt times the place.
    @property
    def for_controller(self) -> Parameters:
        """Parameters that a controller is given: without a place that its point does not have."""
        values = self.parameters
        if not self.mechanism.is_elsewhere:
            return values
        elsewhere = values.table.select(group="reflector")
        kept = {name: value for name, value in values.items() if name not in elsewhere}
        return Parameters.of(values.table, kept)

    @property
    def is_extended(self) -> bool:
        """Whether a parameter beyond those that every controller has is not 0."""
        return bool(self.parameters.extended_by)

    @property
    def remark(self) -> str:
        """Which controllers take the set, and what to do for others; "" if all take it."""
        if not self.is_extended:
            return ""
        return FOR_SOME_CONTROLLERS if self.mechanism.has_forearms else FOR_CONTROLLERS_WITH_ALL

    def require_known(self, lacking: Collection[str], remedy: str) -> None:
        """Raise `ConfigInvalid` where a parameter that a controller lacks is not 0."""
        values = self.parameters
        beyond = [name for name in lacking if name in values]
        if beyond:
            has_no = f"has no {values.table[beyond[0]].field.words}s"
            if beyond[0] in values.table.rates:
                has_no = f"has no {values.table.rate.name} of single joints"
            raise ConfigInvalid(
                f"{self.name}: {beyond[0]} is {values[beyond[0]]:g}, but the controller's "
                f"kinematics {has_no}",
                remedy=remedy,
            )

    @property
    def workspace_centre(self) -> Array:
        """Pose well inside the workspace, (t,), mm and rad: the file's, or the middle of its reach.

        Raise `ConfigInvalid` for a robot that reaches nothing.
        """
        if self.workspace_centre_mm is None and not self.mechanism.has_forearms:
            return _home(self.limits, None)
        centre = np.zeros(len(self.mechanism.task))
        centre[:3] = self.workspace_centre_mm or middle_of_reach_mm(self.kinematics, self.limits)
        return centre

    def digest(self) -> str:
        """Return the SHA-256 of the geometry: equal exactly when all its doubles are."""
        return self.parameters.digest()


@dataclass(frozen=True, slots=True)
class RobotDocument:
    """A robot with the document from which it was read, comments included."""

    robot: RobotFile
    document: yaml_file.YamlDocument

    def files_in(self, folder: Path, name: str) -> dict[Path, str]:
        """Return the files of a copy of this robot in a folder: their paths and texts."""
        # A mechanism `my.py:OWN` is code beside the robot file. The code is copied too, and the
        # copy names it without a folder, so that the campaign can move to another computer.
        file, colon, mechanism = str(self.document.tree["mechanism"]).rpartition(":")
        if not colon:
            return {folder / name: self.document.text}
        module, tree = Path(self.document.name).parent / file, self.document.editable_tree()
        tree["mechanism"] = f"{module.name}:{mechanism}"
        code = read_text(module, ConfigInvalid, if_missing="give the mechanism's file again")
        return {folder / module.name: code, folder / name: yaml_file.yaml_text(tree)}


def read_robot(path: Path) -> RobotDocument:
    """Read and check a robot file; raise `ConfigInvalid`."""
    remedy = "give a robot file, or the name of a shipped robot"
    return _parse_document(yaml_file.read_document(path, if_missing=remedy))


def find_robot(name_or_path: str) -> RobotDocument:
    """Read a shipped robot by its name, or a file; raise `ConfigInvalid`.

    Of a printer.cfg return the Delta printer of its nominal sizes. For a mechanism in a Python
    file, `my.py:OWN`, return typical values: those of a shipped robot.
    """
    # the shipped names come first: a file of such a name can still be given as ./NAME
    shipped = shipped_robots()
    if name_or_path in shipped:
        text = shipped[name_or_path].read_text(encoding="utf-8")
        return parse_robot(text, f"{name_or_path}.yaml")
    if name_or_path.rpartition(":")[0].endswith(PYTHON):
        return _find_typical(name_or_path)
    if name_or_path.endswith(PRINTER):
        return parse_robot(PrinterConfig.read(Path(name_or_path)).robot_text, name_or_path)
    if is_there(Path(name_or_path)):
        return read_robot(Path(name_or_path))
    nearest = nearest_word(name_or_path, shipped)
    raise ConfigInvalid(
        f"robot '{name_or_path}' is neither a shipped robot nor a file",
        remedy=(f"did you mean {nearest}? " if nearest else "") + f"shipped: {', '.join(shipped)}",
    )


def parse_robot(text: str, name: str) -> RobotDocument:
    """Check the text of a robot file; raise `ConfigInvalid`."""
    return _parse_document(yaml_file.parse_document(text, name))


def shipped_of(mechanism: Mechanism) -> RobotDocument:
    """Return the first shipped robot of a mechanism."""
    robots = map(find_robot, shipped_robots())
    return next(robot for robot in robots if robot.robot.mechanism.name == mechanism.name)


def _find_typical(word: str) -> RobotDocument:
    """Return the first shipped robot with the parameters of a mechanism, as a robot of it.

    `word` names the mechanism as `my.py:OWN`. Raise `ConfigInvalid` if no robot has its parameters.
    """
    folder, local = Path(word).parent, Path(word).name
    contents_model(local, folder)  # refuses a word that gives no mechanism
    mechanism = find_mechanism(local, folder)
    assert mechanism is not None, "as contents_model has found it"
    names = mechanism.parameters.names
    for shipped in map(find_robot, shipped_robots()):
        if shipped.robot.mechanism.parameters.names == names:
            tree = shipped.document.editable_tree()
            tree |= {"mechanism": local, "name": mechanism.name}
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
    """Put other parameters, with their 1 σ, into a copy of the nominal robot's document.

    Raise `ConfigInvalid` when the set would not make a robot file.
    """
    checked = checked_parameters(nominal.robot.mechanism, parameters, name)
    std = parameters.std if isinstance(parameters, Parameters) else None
    tree = nominal.document.editable_tree()
    _set_values(tree["geometry"], checked)
    tree["name"] = name
    for key in (EXPANSIONS, REFERENCE):
        tree.pop(key, None)  # those of the nominal file belong to its own lengths
    if expansions:
        tree[EXPANSIONS] = {key.removesuffix(EXPANSION): ppm for key, ppm in expansions.items()}
        if reference_degC is not None:
            tree[REFERENCE] = reference_degC
    old_rates = nominal.robot.mechanism.rates
    # a rate means nothing without a ripple: there the document keeps what it states
    if any(checked.rates[arm] != old_rates[arm] for arm in checked.rippling_arms):
        tree[checked.table.rate.name] = _rates_in_file(checked.rates)
    tree["uncertainty"] = std or {}
    tree["provenance"] = dict(provenance or {})
    tree["sha256"] = checked.digest()
    # Reading the text back checks the new set as any file of a user. It is read as if it lay beside
    # the nominal file, from where a mechanism `my.py:OWN` is found.
    where = str(Path(nominal.document.name).parent / name)
    return parse_robot(yaml_file.yaml_text(tree), where)


def with_ripples_per_turn(
    robot: RobotDocument, ripples_per_turn: float | Sequence[float]
) -> RobotDocument:
    """Return a robot with its gears' rate in the document: one for all arms, or one for each."""
    tree = robot.document.editable_tree()
    if isinstance(ripples_per_turn, Sequence):
        tree["ripples_per_turn"] = _rates_in_file(tuple(ripples_per_turn))
    else:
        tree["ripples_per_turn"] = ripples_per_turn
    return parse_robot(yaml_file.yaml_text(tree), robot.document.name)


def with_reflector(robot: RobotDocument, reflector_mm: Vector3) -> RobotDocument:
    """Return a robot with the measured place of its reflector in the document."""
    tree = robot.document.editable_tree()
    tree["reflector_mm"] = CommentedSeq(reflector_mm)
    tree["reflector_mm"].fa.set_flow_style()
    return parse_robot(yaml_file.yaml_text(tree), robot.document.name)


def states_reflector(robot: RobotDocument) -> bool:
    """Return whether the document holds the place of the reflector."""
    return robot.document.tree.get("reflector_mm") is not None


def write_new_robot(path: Path, robot: RobotDocument) -> None:
    """Write a robot file that must not exist yet; raise `OutputExists` or `WriteFailed`."""
    write_new_text(path, robot.document.text)


def _set_values(geometry: CommentedMap, parameters: Parameters) -> None:
    """Replace the values that differ, and delete optional values that become 0."""
    # an equal value keeps the form in which it was written, such as 350 or 350.00
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
    mechanism: Mechanism,
    values: Mapping[str, float],
    name: str,
    std: Mapping[str, float] | None = None,
) -> Parameters:
    """Make parameters of values by name, the optional ones 0 if not given, and of 1 σ by name.

    Rates of ripples that the values do not state are the mechanism's. `name` is the robot's, for
    errors. Raise `ConfigInvalid` for a value that is unknown, missing or not finite.
    """
    space = mechanism.parameters
    for unknown in values.keys() - {*space.of_robot, space.rate.name, *space.rates}:
        raise ConfigInvalid(
            f"{name}: {unknown} is not a parameter of a robot",
            remedy=suggestion(unknown, space.of_robot),
        )
    optional = [parameter for parameter in space.optional if parameter in values]
    for parameter in (*space.names, *optional):
        if not math.isfinite(values.get(parameter, math.nan)):
            raise ConfigInvalid(
                f"{name}: {parameter} is {values.get(parameter, 'missing')}",
                remedy=f"give finite values for all {len(space.names)} parameters",
            )
    rates = stated_rates(space, values, mechanism.rates)
    return replace(Parameters.of(space, values, std), rates=rates)


def require_millimetres(parameters: Parameters, where: str) -> None:
    """Raise `ConfigInvalid` if the longest length is a few mm, and so probably written in m."""
    # no real robot is refused: a laser tracker's reflector would not fit on one of a few mm
    table = parameters.table
    lengths = [name for name in table.of_robot if table[name].field.quantity == "length"]
    # a mechanism of one's own may have places alone, or lengths that count against an axis
    longest = max(lengths, key=lambda name: abs(parameters[name]), default=None)
    if longest is not None and 0.0 < abs(parameters[longest]) < LONGEST_IN_METRES:
        raise ConfigInvalid(
            f"{where}: {longest} is {parameters[longest]:g}, and no length is above "
            f"{LONGEST_IN_METRES:g} mm: metres?",
            remedy=f"give places and lengths in mm, such as {1000.0 * parameters[longest]:g}",
        )


def shipped_robots() -> dict[str, Traversable]:
    """Return the robot files that come with the software, by name."""
    files = [f for f in resources.files("campaigns.robots").iterdir() if f.name.endswith(".yaml")]
    return {f.name.removesuffix(".yaml"): f for f in sorted(files, key=lambda file: file.name)}


# 1. The word of the mechanism gives the model of the keys; the model checks each key by itself.
# 2. `reflector_half` names the part of the platform that is measured: another mechanism.
# 3. The values of arms and platform become one table by name (`arm0.x_mm`, `plate_mm`).
# 4. What only the values together show is checked: units, and drives whose errors are too steep.
# 5. A stated sha256 must be that of the geometry.
def _parse_document(document: yaml_file.YamlDocument) -> RobotDocument:
    """Check a document and return its robot; raise `ConfigInvalid`."""
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
    of_all = contents.geometry.model_dump()
    of_arms = of_all.pop("arms")
    values = _rates_by_name(document, contents, mechanism)
    for parameter in map(mechanism.parameters.__getitem__, mechanism.parameters.of_robot):
        holder = of_all if parameter.arm is None else of_arms[parameter.arm]
        values[parameter.name] = holder[parameter.field.name]
    parameters = checked_parameters(mechanism, values, contents.name, contents.uncertainty)
    require_millimetres(parameters, f"{document.place_of('geometry')}")
    limits = _limits(mechanism, contents.limits)
    complete = _add_plate_and_drives(mechanism, parameters, contents)
    complete = complete.with_home(_home(limits, contents.workspace_centre_mm))
    _check_closures(complete, parameters)
    robot = RobotFile(
        contents.name,
        complete,
        parameters,
        limits,
        contents.provenance,
        contents.workspace_centre_mm,
        contents.tolerance,
        _tolerances(contents, document),
        {f"{n}{EXPANSION}": v for n, v in (contents.expansion_ppm_per_degC or {}).items()},
        contents.reference_temperature_degC,
        document,
    )
    if contents.sha256 not in {None, robot.digest()}:
        raise ConfigInvalid(
            f"{document.place_of('sha256')}: sha256 is {contents.sha256}, "
            f"but of the geometry it is {robot.digest()}",
            remedy="somebody changed the geometry: restore the file, or delete the line sha256",
        )
    return RobotDocument(robot, document)


# A stated place of the reflector is a measured one: its tolerance is narrower than that of a place
# of which nothing is known. The section `tolerances` may widen or narrow either.
def _tolerances(contents: RobotContents, document: yaml_file.YamlDocument) -> dict[str, float]:
    """Return the file's tolerances by group and unit, mm, rad or ratios.

    Raise `ConfigInvalid` for a σ of a place that is not stated.
    """
    stated = dict(contents.tolerances)
    if contents.reflector_mm is not None:
        std_mm = contents.reflector_std_mm or STATED_REFLECTOR_MM
        stated = {"reflector_mm": std_mm} | stated
    elif contents.reflector_std_mm is not None:
        raise ConfigInvalid(
            f"{document.place_of('reflector_std_mm')}: reflector_std_mm is the σ of reflector_mm, "
            "which is missing",
            remedy="give reflector_mm, or delete the line",
        )
    return {key: INNER_OF[key.rpartition("_")[2]] * value for key, value in stated.items()}


def _rates_by_name(
    document: yaml_file.YamlDocument, contents: RobotContents, mechanism: Mechanism
) -> dict[str, float]:
    """Return the rates of ripples that a file states; raise `ConfigInvalid` for a wrong number."""
    table = mechanism.parameters
    rates = getattr(contents, table.rate.name)
    if not isinstance(rates, tuple):
        return {table.rate.name: rates or 0.0}
    if len(rates) != table.arms:
        raise ConfigInvalid(
            f"{document.place_of(table.rate.name)}: {table.rate.name} holds {len(rates)} numbers, "
            f"must hold {table.arms}",
            remedy="give one number for all arms, or one for each arm",
        )
    return dict(zip(table.rates, rates, strict=True))


def _rates_in_file(rates: tuple[float, ...]) -> float | CommentedSeq:
    """Return rates as a file has them: one number if they are equal, else a list in one line."""
    if len({*rates}) == 1:
        return rates[0]
    entries = CommentedSeq(rates)
    entries.fa.set_flow_style()
    return entries


def _add_plate_and_drives(
    mechanism: Mechanism, parameters: Parameters, contents: RobotContents
) -> Mechanism:
    """Return the mechanism with the file's plate and drives.

    Raise `ConfigInvalid` for ripples without a rate, and for errors of a joint that are too steep.
    """
    placed = mechanism.placed(parameters.vector, contents.plate_joints_mm, contents.reflector_mm)
    complete = placed.with_ripples(parameters.rates)
    # a ripple's amplitude means nothing without its period
    ripples = [
        name
        for name in parameters.table.select(group="ripple")
        if name in parameters and not complete.has_ripple(parameters.table[name].arm)
    ]
    if ripples:
        raise ConfigInvalid(
            f"{contents.name}: {ripples[0]} is {parameters[ripples[0]]:g}, but the file does not "
            "say how often it comes",
            remedy="give ripples_per_turn, or drive_period_mm of robots on rails: a number, or "
            "one for each arm",
        )
    # joint angles become encoder readings in rounds, which converge only below this steepness
    if (steepest := complete.steepest_error(parameters.vector)) > STEEPEST_ERROR:
        raise ConfigInvalid(
            f"{contents.name}: the errors of a joint change by {steepest:.2g} of its motion, "
            f"limit {STEEPEST_ERROR:g}",
            remedy="correct the encoder gains, eccentricities and ripples, which are small",
        )
    return complete


def _check_closures(mechanism: Mechanism, parameters: Parameters) -> None:
    """Raise `ConfigInvalid` for a mechanism that its own file states wrongly."""
    remedy = "correct sizes and limits, or the mechanism's file (docs/how-to/own-mechanism.md)"
    for row in parameters.table.rows:
        if (group := row.field.group) not in SOURCES:
            raise ConfigInvalid(
                f"{mechanism.name}: {row.field.name} has the group {shown(group)}, which is no "
                f"group of error sources ({suggestion(group, SOURCES)})",
                remedy=remedy,
            )
    if not isinstance(mechanism, ImplicitMechanism):
        return
    try:
        fault = mechanism.fault_of_closures(parameters.vector)
    except (Exception, SystemExit) as error:  # other people's code may raise anything
        fault = f"{type(error).__name__} in its functions: {error}"
        raise ConfigInvalid(f"{mechanism.name}: {fault}", remedy=remedy) from error
    if fault:
        raise ConfigInvalid(f"{mechanism.name}: {fault}", remedy=remedy)


def _limits(mechanism: Mechanism, limits: yaml_file.FileModel) -> Limits:
    """Return the limits of a file in mm and rad."""
    values = limits.model_dump()

    def ends(axis: Axis, key: str) -> Interval:
        low, high = values[key]
        return axis.from_file(low), axis.from_file(high)

    of_joints = [ends(axis, f"joint_{axis.unit}") for axis in mechanism.joints]
    low, high = zip(*of_joints, strict=True)
    of_all = of_joints[0] if len({*of_joints}) == 1 else (low, high)
    values |= {axis.column: (0.0, 0.0) for axis in mechanism.task if axis.is_fixed}
    of_task = tuple(
        ends(axis, axis.column) if values.get(axis.column) else None for axis in mechanism.task
    )
    return Limits(of_all, of_task, math.radians(values.get("forearm_swing_deg", 0.0)))


def _home(limits: Limits, centre_mm: Vector3 | None) -> Array:
    """Return a pose (t,) well inside the workspace: its stated centre, or the limits' middle."""
    middle = np.array([0.0 if ends is None else 0.5 * (ends[0] + ends[1]) for ends in limits.task])
    if centre_mm is not None:
        middle[:3] = centre_mm
    return middle


def pose_row(pose: Pose) -> Array:
    """Return the task coordinates of a pose, (t,), mm and rad."""
    return np.array(pose.coordinates, dtype=np.float64)


def pose_of(row: Iterable[float]) -> Pose:
    """Return the pose of task coordinates (t,), mm and rad."""
    x_mm, y_mm, z_mm, *turns = map(float, row)
    if len(turns) == 3:
        return Pose(x_mm, y_mm, z_mm, rotation_rad=vector(turns))
    return Pose(x_mm, y_mm, z_mm, turns[0] if turns else None)
