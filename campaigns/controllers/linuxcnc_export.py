"""LinuxCNC's HAL file of a robot: one `setp` a parameter, for our kinematics module pkmkins.

Pins are named after the parameters, and the heading names the robot. Optional parameters (axis
tilts, skews, transmission) are in the file where they are not 0; the drawing of the plate, which
tilts need, always is. The module adds the fitted places on the plate to those of the drawing.
"""

# LinuxCNC compensates backlash itself, by a pin of each joint (`ini.N.backlash`). These pins do
# not exist yet when HAL files are read, so that a `setp` of them would fail. They are therefore
# written as comments; the bridge, which runs later, reads and sets them when it starts.

import json
import math
from collections.abc import Iterator
from pathlib import Path

from campaigns.errors import ConfigInvalid
from campaigns.files.csv_file import number_text
from campaigns.files.text_file import write_text_unless_there
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.platforms import REFLECTOR
from campaigns.robots.robot import RobotFile
from campaigns.version import VERSION

FILE_NAME = "calib.hal"
SCHEMA = "pkmcal/linuxcnc/1"
MODULE = "pkmkins"
REFLECTOR_NAMES = tuple(field.name for field in REFLECTOR)
LONGEST_NOTE = 160
"""Characters of a note after which it is cut: halcmd takes lines of some 250 characters."""


def pin_of(name: str) -> str:
    """Return the pin of a parameter."""
    # without a word of their own these pins would have the names of the drawing's
    fitted = "fitted." if name in REFLECTOR_NAMES else ""
    return f"{MODULE}.{fitted}{name}"


def drawing_pins(mechanism: ClosedChain) -> dict[str, float]:
    """Return the values of the plate's drawing by pin, mm and deg: joints, bars, reflector."""
    # of the point that the controller commands, wherever the reflector sits on the plate
    plate = mechanism.seen_from(None).plate
    assert plate is not None, "a robot file's mechanism has its plate"
    values = {
        f"arm{arm}.plate_{axis}_mm": value
        for arm, place in enumerate(plate.joints_mm)
        for axis, value in zip("xyz", place, strict=True)
    }
    for arm, outward_rad in enumerate(plate.outward_rad or ()):
        values[f"arm{arm}.bar_azimuth_deg"] = math.degrees(outward_rad)
    reflector = zip("xyz", plate.reflector_mm or (0.0, 0.0, 0.0), strict=True)
    values |= {f"reflector_{axis}_mm": value for axis, value in reflector}
    return {f"{MODULE}.{name}": value for name, value in values.items()}


def hal_text(robot: RobotFile, identity: str) -> str:
    """Return a parameter set as the text of a HAL file.

    Values are written so that they read back as the very same doubles. `identity` is the robot's
    serial number or name, for the heading. Raise `ConfigInvalid` for a mechanism that pkmkins does
    not compute, and for ripples of unlike rates, as it has one rate for all joints.
    """
    if not isinstance(robot.mechanism, ClosedChain):
        raise ConfigInvalid(
            f"{robot.name}: {MODULE}, our kinematics module for LinuxCNC, computes no "
            f"{robot.mechanism.name}",
            remedy="`pkmcal export DIR` writes a robot file, `pkmcal correct` corrects poses",
        )
    robot.require_known(
        robot.mechanism.parameters.rates,
        "`pkmcal export DIR --format plain` leaves ripples out, and `pkmcal correct` loses nothing",
    )
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
    values, space = dict(robot.for_controller), robot.mechanism.parameters
    for name in space.select(group="backlash"):
        values.pop(name, None)
    pins = {pin_of(name): value for name, value in values.items()} | drawing_pins(robot.mechanism)
    settings = [f"setp {pin} {number_text(value)}" for pin, value in pins.items()]
    return "\n".join([*(f"# {line}".rstrip() for line in heading), *settings, ""])


def write_hal(path: Path, robot: RobotFile, identity: str, *, overwrite: bool) -> None:
    """Write the HAL file.

    Raise `ConfigInvalid` as `hal_text`, `OutputExists` unless `overwrite`, or `WriteFailed`.
    """
    write_text_unless_there(path, hal_text(robot, identity), overwrite=overwrite)


def _notes(robot: RobotFile) -> Iterator[str]:
    """Yield notes on the set's origin, cut to a length: the robot file has the whole text."""
    for key, value in (robot.provenance or {}).items():
        note = f"{key}: {json.dumps(value)}"
        yield note if len(note) <= LONGEST_NOTE else f"{note[:LONGEST_NOTE]}..."


def _backlashes(robot: RobotFile) -> Iterator[str]:
    """Yield a setting for each joint with backlash, to be made after HAL files are read."""
    space, values = robot.mechanism.parameters, robot.parameters
    for name in space.select(group="backlash"):
        if name in values:
            yield f"setp ini.{space[name].arm}.backlash {number_text(values[name])}"
