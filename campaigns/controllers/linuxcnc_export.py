"""LinuxCNC's HAL file of a robot: one `setp` a parameter, for our kinematics module pkmkins.

Its pins are named after the parameters. The heading says whose they are: a file of another robot
or another kinematics, with a parameter missing, or changed by hand without saying so, is refused.
What is optional (axis tilts, skews, transmission) is in the file where it is not 0; the drawing of
the plate, which tilts need, always is. Backlashes are LinuxCNC's own, and their pins do not exist
yet when HAL files are read: they are comments, which the bridge sets when it starts.
"""

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import ConfigInvalid
from campaigns.files.csv_file import number_text
from campaigns.files.text_file import read_text, replace_text, write_text_unless_there
from campaigns.files.wording import shown
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.robots.robot import RobotFile
from campaigns.version import VERSION

FILE_NAME = "calib.hal"
SCHEMA = "pkmcal/linuxcnc/1"
MODULE = "pkmkins"
MODULE_BEFORE = "par4kins"
"""Name under which earlier versions wrote their files, of a Par4 alone."""
LONGEST_NOTE = 160
"""halcmd takes lines of some 250 characters."""
REMEDY = "restore the file, or write it anew with `pkmcal export --format linuxcnc`"

_HEADING = re.compile(r"#\s*(robot|sha256):\s*(\S.*)")
_BACKLASH = re.compile(r"#\s*(?:\[JOINT_|setp ini\.)(\d+)(?:\]BACKLASH =|\.backlash) (\S+)")
_SETTING = re.compile(r"setp\s+(\S+)\s+(\S+)")


def pin_of(name: str) -> str:
    """Pin of a parameter or of a value of the plate's drawing."""
    return f"{MODULE}.{name}"


def drawing_flat(mechanism: ClosedChain) -> dict[str, float]:
    """Values of the plate's drawing by name, mm and deg."""
    plate = mechanism.seen_from(None).plate
    assert plate is not None, "a robot file's mechanism has its plate"
    flat = {
        f"arm{arm}.plate_{axis}_mm": value
        for arm, place in enumerate(plate.joints_mm)
        for axis, value in zip("xyz", place, strict=True)
    }
    for arm, outward_rad in enumerate(plate.outward_rad or ()):
        flat[f"arm{arm}.bar_azimuth_deg"] = math.degrees(outward_rad)
    reflector = zip("xyz", plate.reflector_mm, strict=True)
    return flat | {f"reflector_{axis}_mm": value for axis, value in reflector}


@dataclass(frozen=True, slots=True)
class RobotIdentity:
    """The robot that a HAL file must be of: its serial number, or the nominal's name."""

    identity: str
    nominal: RobotFile

    def having(self, geometry: Mapping[str, float], name: str) -> RobotFile:
        """Robot of this identity with other parameters; raises `ConfigInvalid` unless it is all."""
        nominal = self.nominal
        return RobotFile.of(nominal.mechanism, geometry, name=name, limits=nominal.limits)


def hal_text(robot: RobotFile, identity: str) -> str:
    """Write a parameter set as a HAL file: full doubles, and where they come from."""
    heading = [
        f"{SCHEMA}: parameters of a {robot.mechanism.name}, written by pkmcal {VERSION}",
        f"robot: {identity}",
        f"sha256: {robot.digest()}",
        f"set: {robot.name}",
        *_notes(robot),
        *_backlashes(robot),
        "",
        "In the INI file, after the HALFILE that loads the kinematics: HALFILE = calib.hal",
        "Set these pins only while the machine is off: with power, the joints would jump.",
    ]
    values = dict(robot.parameters) | drawing_flat(robot.mechanism)
    for name in robot.mechanism.parameters.select(group="backlash"):
        values.pop(name, None)
    settings = [f"setp {pin_of(name)} {number_text(value)}" for name, value in values.items()]
    return "\n".join([*(f"# {line}".rstrip() for line in heading), *settings, ""])


def parse_hal(text: str, name: str, whose: RobotIdentity) -> RobotFile:
    """Read a HAL file of this robot; raises `ConfigInvalid` naming the line that is wrong."""
    headings: dict[str, str] = {}
    values: dict[str, float] = {}
    mechanism = whose.nominal.mechanism
    for number, line in enumerate(text.splitlines(), start=1):
        if backlash := _BACKLASH.fullmatch(line.strip()):
            values |= _backlash(mechanism, int(backlash[1]), backlash[2], f"{name}:{number}")
        elif heading := _HEADING.fullmatch(line.strip()):
            headings[heading[1]] = heading[2]
        elif line.strip() and not line.lstrip().startswith("#"):
            parameter, value = _setting(line, f"{name}:{number}", mechanism)
            if parameter in values:
                raise ConfigInvalid(f"{name}:{number}: {parameter} is set twice", remedy=REMEDY)
            values[parameter] = value
    return _checked(name, headings, values, whose)


def write_hal(path: Path, robot: RobotFile, identity: str, *, overwrite: bool) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`."""
    write_text_unless_there(path, hal_text(robot, identity), overwrite=overwrite)


def _notes(robot: RobotFile) -> Iterator[str]:
    """Notes on the set's origin, as far as they fit: the robot file has all of it."""
    for key, value in (robot.provenance or {}).items():
        note = f"{key}: {json.dumps(value)}"
        yield note if len(note) <= LONGEST_NOTE else f"{note[:LONGEST_NOTE]}..."


def _backlashes(robot: RobotFile) -> Iterator[str]:
    """Pins that exist only after HAL files were read, one for each joint that has a backlash."""
    space, values = robot.mechanism.parameters, robot.parameters
    for name in space.select(group="backlash"):
        if name in values:
            yield f"setp ini.{space[name].arm}.backlash {number_text(values[name])}"


def _backlash(mechanism: ClosedChain, arm: int, word: str, where: str) -> dict[str, float]:
    space = mechanism.parameters
    own = [name for name in space.select(group="backlash") if space[name].arm == arm]
    return {name: _number(word, where, is_length=False) for name in own}


def _setting(line: str, where: str, mechanism: ClosedChain) -> tuple[str, float]:
    """The parameter and value of a line `setp PIN VALUE`."""
    setting = _SETTING.fullmatch(line.strip())
    if setting is None:
        raise ConfigInvalid(
            f"{where}: '{shown(line)}' is no line `setp PIN VALUE`",
            remedy="keep other HAL commands in a file of their own",
        )
    pin, word = setting[1], setting[2]
    module, _, name = pin.partition(".")
    if module not in {MODULE, MODULE_BEFORE} or not _is_known(name, mechanism):
        raise ConfigInvalid(
            f"{where}: {shown(pin)} is no pin of {MODULE} for a {mechanism.name}",
            remedy="a file of another kinematics, or a misspelt parameter: " + REMEDY,
        )
    space = mechanism.parameters
    known = (*space.of_robot, space.rate.name)
    is_length = name in known and space[name].field.quantity == "length"
    return name, _number(word, where, is_length=is_length)


def _is_known(name: str, mechanism: ClosedChain) -> bool:
    space = mechanism.parameters
    return name in {*space.of_robot, space.rate.name} or name in drawing_flat(mechanism)


def _number(word: str, where: str, *, is_length: bool) -> float:
    try:
        value = float(word)
    except ValueError as error:
        raise ConfigInvalid(f"{where}: '{shown(word)}' is no number", remedy=REMEDY) from error
    if is_length and value <= 0.0:
        raise ConfigInvalid(f"{where}: a length of {value:g} mm", remedy=REMEDY)
    return value


def _checked(
    name: str, headings: Mapping[str, str], values: Mapping[str, float], whose: RobotIdentity
) -> RobotFile:
    if headings.get("robot") != whose.identity:
        found = shown(headings.get("robot", "nobody said"))
        raise ConfigInvalid(
            f"{name}: is of robot '{found}', this campaign is of '{whose.identity}'",
            remedy="connect the right robot or take the right file; "
            f"a file written by hand needs a line '# robot: {whose.identity}'",
        )
    mechanism = whose.nominal.mechanism
    drawing = drawing_flat(mechanism)
    geometry = {key: value for key, value in values.items() if key not in drawing}
    robot = whose.having(geometry, name)
    _check_drawing(name, robot, values, drawing)
    if headings.get("sha256", robot.digest()) != robot.digest():
        raise ConfigInvalid(
            f"{name}: its sha256 is not that of its parameters",
            remedy=f"somebody changed it: {REMEDY}; or delete the line sha256",
        )
    return robot


def _check_drawing(
    name: str, robot: RobotFile, values: Mapping[str, float], drawing: Mapping[str, float]
) -> None:
    """Raise `ConfigInvalid` where a plate that tilts is not the nominal robot's."""
    if not robot.is_extended:
        return
    for key, expected in drawing.items():
        if values.get(key) != expected:
            raise ConfigInvalid(
                f"{name}: {key} is {values.get(key, 'missing')}, of the nominal robot's plate it "
                f"is {expected:g}",
                remedy="a file of another plate: bring plate_joints_mm and reflector_mm of the "
                "robot file back, or " + REMEDY,
            )


class CalibrationFile:
    """The HAL file of a robot's parameters; until there is one, they are the nominal robot's."""

    def __init__(self, path: Path, whose: RobotIdentity) -> None:
        self._path = path
        self._whose = whose

    def read(self) -> Mapping[str, float]:
        """Parameters, all of them; raises `ConfigInvalid`, also for another robot's file."""
        if not self._path.exists():
            return self._whose.nominal.parameters
        remedy = f"`pkmcal export --format linuxcnc --to {self._path}`"
        text = read_text(self._path, ConfigInvalid, if_missing=remedy)
        return parse_hal(text, str(self._path), self._whose).parameters

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace the file whole, unless it is another robot's; raises as `read`, `WriteFailed`."""
        self.read()
        text = hal_text(self._whose.having(geometry, self._whose.identity), self._whose.identity)
        replace_text(self._path, text)

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:  # noqa: ARG002 - it has them all
        """Nothing: poses are converted by all of them."""
        return ()
