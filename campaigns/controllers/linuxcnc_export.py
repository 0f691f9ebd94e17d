"""LinuxCNC's HAL file of a robot: one `setp` a parameter, for our kinematics module par4kins.

The 29 pins are named after the parameters. The heading says whose they are: a file of another
robot or another kinematics, with a parameter missing, or changed by hand without saying so, is
refused.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import ConfigInvalid
from campaigns.files.csv_file import number_text
from campaigns.files.text_file import read_text, replace_text, write_text_unless_there
from campaigns.files.wording import shown
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import RobotFile
from campaigns.version import VERSION

FILE_NAME = "calib.hal"
SCHEMA = "pkmcal/linuxcnc/1"
MODULE = "par4kins"
PIN_OF: Mapping[str, str] = {name: f"{MODULE}.{name}" for name in PAR4.parameters.names}
LENGTHS = ("arm_mm", "forearm_mm", "plate_mm")
LAST_GOOD = ".last-good"
LONGEST_NOTE = 160
"""halcmd takes lines of some 250 characters."""
REMEDY = "restore the file, or write it anew with `pkmcal export --format linuxcnc`"

_HEADING = re.compile(r"#\s*(robot|sha256):\s*(\S.*)")
_SETTING = re.compile(r"setp\s+(\S+)\s+(\S+)")
_PARAMETER_OF = {pin: name for name, pin in PIN_OF.items()}


@dataclass(frozen=True, slots=True)
class RobotIdentity:
    """The robot that a HAL file must be of: its serial number, or the nominal's name."""

    identity: str
    nominal: RobotFile

    def having(self, geometry: Mapping[str, float], name: str) -> RobotFile:
        """Robot of this identity with other parameters; raises `ConfigInvalid` unless it is all."""
        nominal = self.nominal
        return RobotFile.from_flat(nominal.mechanism, geometry, name=name, limits=nominal.limits)


def hal_text(robot: RobotFile, identity: str) -> str:
    """Write a parameter set as a HAL file: full doubles, and where they come from.

    Raises `ConfigInvalid` for another mechanism and for a set with axis tilts.
    """
    if robot.mechanism.name != PAR4.name:
        raise ConfigInvalid(
            f"{robot.name}: a {robot.mechanism.name}, but {MODULE} is for a {PAR4.name}",
            remedy="export a robot file, without --format linuxcnc",
        )
    heading = [
        f"{SCHEMA}: parameters of a Par4, written by pkmcal {VERSION}",
        f"robot: {identity}",
        f"sha256: {robot.digest()}",
        f"set: {robot.name}",
        *_notes(robot),
        "",
        "In the INI file, after the HALFILE that loads the kinematics: HALFILE = calib.hal",
        "Set these pins only while the machine is off: with power, the joints would jump.",
    ]
    settings = [
        f"setp {PIN_OF[name]} {number_text(value)}"
        for name, value in robot.controller_flat().items()
    ]
    return "\n".join([*(f"# {line}".rstrip() for line in heading), *settings, ""])


def parse_hal(text: str, name: str, whose: RobotIdentity) -> RobotFile:
    """Read a HAL file of this robot; raises `ConfigInvalid` naming the line that is wrong."""
    headings: dict[str, str] = {}
    geometry: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), start=1):
        if heading := _HEADING.fullmatch(line.strip()):
            headings[heading[1]] = heading[2]
        elif line.strip() and not line.lstrip().startswith("#"):
            parameter, value = _setting(line, f"{name}:{number}")
            if parameter in geometry:
                raise ConfigInvalid(f"{name}:{number}: {parameter} is set twice", remedy=REMEDY)
            geometry[parameter] = value
    return _checked(name, headings, geometry, whose)


def write_hal(path: Path, robot: RobotFile, identity: str, *, overwrite: bool) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`."""
    write_text_unless_there(path, hal_text(robot, identity), overwrite=overwrite)


def _notes(robot: RobotFile) -> Iterator[str]:
    """Notes on the set's origin, as far as they fit: the robot file has all of it."""
    for key, value in (robot.provenance or {}).items():
        note = f"{key}: {json.dumps(value)}"
        yield note if len(note) <= LONGEST_NOTE else f"{note[:LONGEST_NOTE]}..."


def _setting(line: str, where: str) -> tuple[str, float]:
    """The parameter and value of a line `setp PIN VALUE`."""
    setting = _SETTING.fullmatch(line.strip())
    if setting is None:
        raise ConfigInvalid(
            f"{where}: '{shown(line)}' is no line `setp PIN VALUE`",
            remedy="keep other HAL commands in a file of their own",
        )
    pin, word = setting[1], setting[2]
    if pin not in _PARAMETER_OF:
        raise ConfigInvalid(
            f"{where}: {shown(pin)} is no pin of {MODULE}",
            remedy="a file of another kinematics, or a misspelt parameter: " + REMEDY,
        )
    return _PARAMETER_OF[pin], _number(word, where, pin)


def _number(word: str, where: str, pin: str) -> float:
    try:
        value = float(word)
    except ValueError as error:
        raise ConfigInvalid(f"{where}: '{shown(word)}' is no number", remedy=REMEDY) from error
    if pin.endswith(LENGTHS) and value <= 0.0:
        raise ConfigInvalid(f"{where}: a length of {value:g} mm", remedy=REMEDY)
    return value


def _checked(
    name: str, headings: Mapping[str, str], geometry: Mapping[str, float], whose: RobotIdentity
) -> RobotFile:
    if headings.get("robot") != whose.identity:
        found = shown(headings.get("robot", "nobody said"))
        raise ConfigInvalid(
            f"{name}: is of robot '{found}', this campaign is of '{whose.identity}'",
            remedy="connect the right robot or take the right file; "
            f"a file written by hand needs a line '# robot: {whose.identity}'",
        )
    robot = whose.having(geometry, name)
    if headings.get("sha256", robot.digest()) != robot.digest():
        raise ConfigInvalid(
            f"{name}: its sha256 is not that of its parameters",
            remedy=f"somebody changed it: {REMEDY}; or delete the line sha256",
        )
    return robot


class CalibrationFile:
    """The HAL file that LinuxCNC reads when it starts. The last good one before it is kept beside.

    `otherwise` is what counts as long as there is no file.
    """

    def __init__(
        self, path: Path, whose: RobotIdentity, *, otherwise: RobotFile | None = None
    ) -> None:
        self._path = path
        self._whose = whose
        self._otherwise = otherwise
        self._replaced: str | None = None

    @property
    def last_good(self) -> Path:
        """Path of the kept file before this one."""
        return self._path.with_name(self._path.name + LAST_GOOD)

    def read(self) -> Mapping[str, float]:
        """Parameters, all of them; raises `ConfigInvalid`, also for another robot's file."""
        if self._otherwise is not None and not self._path.exists():
            return self._otherwise.controller_flat()
        return parse_hal(self._text(), str(self._path), self._whose).geometry_flat()

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace the file whole; raises `ConfigInvalid`, `WriteFailed`."""
        text = hal_text(self._whose.having(geometry, self._whose.identity), self._whose.identity)
        self._replaced = self._text() if self._path.exists() else None
        if self._replaced is not None:
            parse_hal(self._replaced, str(self._path), self._whose)
            replace_text(self.last_good, self._replaced)
        replace_text(self._path, text)

    def take_back(self) -> None:
        """Put back what the last `write` replaced; raises `WriteFailed`."""
        if self._replaced is not None:
            replace_text(self._path, self._replaced)
        else:
            self._path.unlink(missing_ok=True)

    def _text(self) -> str:
        remedy = f"`pkmcal export --format linuxcnc --to {self._path}`, then restart LinuxCNC"
        return read_text(self._path, ConfigInvalid, if_missing=remedy)
