"""Names that earlier versions had and this one refuses, each with what to use instead.

CHANGELOG lists them under Removed. Only these tables mention them; sim/scenarios/scenario.py has
a table of its own for the keys of cell files.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

_POINTLINE = (
    "use driver pointline and a server for it (docs/reference/pointline.md), or import its points"
)
_PROGRAM = "use --program csv; a loop in docs/how-to/closed-controllers.md reads it"
_BRIDGE = "use driver robotline with the bridge that runs beside LinuxCNC (docs/how-to/linuxcnc.md)"
_ONE_MODEL = "leave it out: one model has every source of error, each as large as the shots say"
INSTEAD: Mapping[str, str] = {
    "--tracker-driver geocom": _POINTLINE,
    "--anyway": "use --force",
    "--overwrite": "use --force",
    "identify --accept-large-change": "use --force",
    "identify --shots": "use --only-shots",
    "export --shots": "use --format shots",
    "load --file": "use --robot",
    "import --with": "use --robot",
    "devices --spy": "record the connection with tcpdump or Wireshark",
    "check --repair": "use `pkmcal identify DIR --update` after the check",
    "plan --where-tracker": "put the tracker as near as the robot allows, and plan from there",
    "plan --criterion": "leave it out: shots are chosen for positions all over the workspace",
    "plan --candidates": "leave it out",
    "plan --inaccurate": "leave it out; `run` skips poses that the robot cannot take",
    "plan --after-identify": "leave it out: plans are made by the nominal robot",
    "plan --scatter": "leave it out: the scatter of the shots measured is estimated",
    "identify --plot": "the report draws the errors that the fit leaves",
    "history --plot": "draw the table that `history --csv FILE` writes",
    "reproduce": "run `python examples/corbel2006.py` (docs/explanation/reproduction.md)",
    "advise": "read found minus nominal with its uncertainty in the report's table of parameters",
    "driver: geocom": _POINTLINE,
    "driver: linuxcnc": _BRIDGE,
    "--controller-driver linuxcnc": _BRIDGE,
    "export --joint-table": "use --format plain, or correct targets with `pkmcal correct`",
    "export --tolerance": "leave it out: there are no joint tables any more",
    "--format linuxcnc-rotarydelta": "use --format linuxcnc with pkmkins, which loses nothing",
    "--format linuxcnc-lineardelta": "use --format linuxcnc with pkmkins, which loses nothing",
    "--format klipper-rotary-delta": "export a robot file; examples/klipper.py converts it",
    "--format klipper-delta": "use --format klipper",
    "--format urdf": "export a robot file; examples/urdf.py converts it",
    "--format sdf": "export a robot file; examples/urdf.py converts it to URDF",
    "import --check-frame": "use `pkmcal import`: it names swapped joints, units, signs and "
    "mirrored frames, and imports nothing then",
    "correct --gcode": "examples/correct_gcode.py corrects straight moves",
    "correct --program": "use --poses; docs/how-to/closed-controllers.md writes a program of them",
    "correct --format": "leave it out: --poses takes a CSV file",
    "correct --tolerance": "leave it out: poses are not split",
    "correct --rotary": "leave it out: --poses takes a CSV file",
    "correct --margin": "leave it out; position_std_mm says how far the set can be trusted",
    "correct --turn-margin": "leave it out; position_std_mm says how far the set can be trusted",
    "--program gcode": _PROGRAM,
    "--program rapid": _PROGRAM,
    "--program krl": _PROGRAM,
    "--program vplus": _PROGRAM,
    "plan --targets": "leave it out: the table has poses and joints",
    "plan --dwell": "change the column dwell_s, or settle.time_s in campaign.yaml",
    "identify --loss": "leave it out: shots that contradict all others are left out by name",
    "identify --loss-scale": "leave it out: there is no loss to scale",
    "identify --weights": "leave it out; --model paper weighs all pairs alike",
    "study --effects": "add the fault to a cell file and simulate campaigns with `pkmcal dry-run`",
    "study --weights": "leave it out: the campaigns of a study are identified from points",
    "--estimator": "leave it out; `identify --model paper` uses distances, all else coordinates",
    "--model standard": _ONE_MODEL,
    "--model rods": _ONE_MODEL,
    "--model auto": _ONE_MODEL,
    "--model extended": _ONE_MODEL,
    "identify --outliers": "leave it out, or leave shots out with --only-shots",
    "identify --accept-scale": "enter the air's and the reflector's constants in the tracker",
    "plan --model": "leave it out; hold parameters with --fix",
    "plan --free": "leave it out: all parameters are fitted",
    "run --model": _ONE_MODEL,
    "run --free": "leave it out: all parameters are fitted",
    "run --fix": "leave it out, and give it to `pkmcal identify`",
    "dry-run --model": _ONE_MODEL,
    "study --model": _ONE_MODEL,
    "study --free": "leave it out: all parameters are fitted",
    "--temperature": "leave it out: parameters are those at campaign.yaml's reference temperature",
}
"""Remedies by removed name.

Forms of a name: `advise` (a command), `plan --where-tracker` (an option of a command), `--loss` (an
option of any command), `--model rods` (a value), `driver: geocom` (a value in a file)."""

KEYS: Mapping[str, tuple[object, str]] = {
    "controller.linuxcnc": (None, _BRIDGE),
    "mechanics": ({}, "delete it: nothing uses the mechanic's sizes any more"),
    "certificate.measured_by": ("", "write who measured as people.operator"),
}
"""Removed keys of files by dotted path, such as `tracker.two_faces`: former default and remedy.

Older versions wrote the default into each new file: there it is read without effect."""


def removed_in_command(arguments: Sequence[str]) -> tuple[str, str] | None:
    """Find the first removed name in a command line; return it with its remedy."""
    # All forms that a name may have are built from the words, the narrowest first, and looked up:
    # the command, the command with each word, each option, each option with the word after it.
    words = [word for argument in arguments for word in argument.split("=", 1)]
    command = next((word for word in words if not word.startswith("-")), "")
    candidates = [command, *(f"{command} {word}" for word in words)]
    candidates += [word for word in words if word.startswith("-")]
    candidates += [f"{option} {value}" for option, value in pairwise(words)]
    name = next((name for name in candidates if name in INSTEAD), None)
    return None if name is None else (name, INSTEAD[name])


def removed_in_file(path: str, value: object) -> str | None:
    """Return the remedy for a removed key (dotted path from the file's top) or a removed value."""
    if path in KEYS:
        return KEYS[path][1]
    return INSTEAD.get(f"{path.rpartition('.')[2]}: {value}")


def drop_former_defaults(contents: dict[str, Any]) -> None:
    """Delete the removed keys that still have their former default from a file's plain contents."""
    for path, (default, _) in KEYS.items():
        *parents, key = path.split(".")
        section: Any = contents
        for parent in parents:
            section = section.get(parent) if isinstance(section, dict) else None
        if isinstance(section, dict) and key in section and section[key] == default:
            del section[key]
