"""LinuxCNC's HAL file of a robot: one `setp` a parameter, for our kinematics module pkmkins.

Its pins are named after the parameters; the heading says whose they are. What is optional (axis
tilts, skews, transmission) is in the file where it is not 0; the drawing of the plate, which tilts
need, always is. Backlashes are LinuxCNC's own, and their pins do not exist yet when HAL files are
read: they are comments, which the bridge sets when it starts.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path

from campaigns.files.csv_file import number_text
from campaigns.files.text_file import write_text_unless_there
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.robots.robot import RobotFile
from campaigns.version import VERSION

FILE_NAME = "calib.hal"
SCHEMA = "pkmcal/linuxcnc/1"
MODULE = "pkmkins"
LONGEST_NOTE = 160
"""halcmd takes lines of some 250 characters."""


def pin_of(name: str) -> str:
    """Return the pin of a parameter or of a value of the plate's drawing."""
    return f"{MODULE}.{name}"


def drawing_flat(mechanism: ClosedChain) -> dict[str, float]:
    """Return values of the plate's drawing by name, mm and deg."""
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


def write_hal(path: Path, robot: RobotFile, identity: str, *, overwrite: bool) -> None:
    """Write the file; raises `OutputExists` unless `overwrite`, or `WriteFailed`."""
    write_text_unless_there(path, hal_text(robot, identity), overwrite=overwrite)


def _notes(robot: RobotFile) -> Iterator[str]:
    """Return notes on the set's origin, as far as they fit: the robot file has all of it."""
    for key, value in (robot.provenance or {}).items():
        note = f"{key}: {json.dumps(value)}"
        yield note if len(note) <= LONGEST_NOTE else f"{note[:LONGEST_NOTE]}..."


def _backlashes(robot: RobotFile) -> Iterator[str]:
    """Return pins that exist only after HAL files were read, one a joint with backlash."""
    space, values = robot.mechanism.parameters, robot.parameters
    for name in space.select(group="backlash"):
        if name in values:
            yield f"setp ini.{space[name].arm}.backlash {number_text(values[name])}"
