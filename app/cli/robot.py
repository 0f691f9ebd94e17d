"""pkmcal robot: make a robot file from the sizes of a symmetrical robot."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, cast

import typer

from app.console import Terminal
from app.options import REFLECTOR_HELP, REFLECTOR_METAVAR, ask_reflector, read_place
from campaigns.errors import OptionsInvalid
from campaigns.files.text_file import refuse_existing
from campaigns.files.wording import suggestion
from campaigns.kinematics.catalog import FAMILY, MECHANISMS
from campaigns.kinematics.mechanism import Mechanism
from campaigns.next_step import NextStep
from campaigns.robots.bar_robots import PAIR_DEG, robot_of_sizes
from campaigns.robots.robot import RobotDocument, with_reflector, write_new_robot
from campaigns.robots.symmetrical import Sizes, symmetrical_robot
from drivers.texts import as_word

LONGEST_MM = 100_000.0
NO_LENGTHS = ("base", "platform", "travel", "first")
"""Sizes that are no length of a part."""


def _length(text: str) -> typer.models.OptionInfo:
    return cast("typer.models.OptionInfo", typer.Option(metavar="MM", help=text))


Kind = Annotated[str, typer.Argument(metavar="MECHANISM", help=f"One of {', '.join(MECHANISMS)}.")]
Base = Annotated[
    float,
    _length("Radius on which motors, rails or legs stand; of a five-bar: its motors' distance."),
]
Platform = Annotated[
    float | None,
    _length(
        "Radius of the platform's joints; if it has two parts: half the distance between the two "
        "joints of a part."
    ),
]
Forearm = Annotated[float | None, _length("Length of the forearms (rods), or legs on carriages.")]
Arm = Annotated[float | None, _length("Length of the cranks.")]
Plate = Annotated[float | None, _length("Distance of the platform's hinged parts.")]
Pinion = Annotated[float | None, _length("Travel of the platform's bars for a turn of 1 rad.")]
Travel = Annotated[float | None, _length("Travel of the carriages, half of it each way from 0.")]
First = Annotated[
    float | None,
    typer.Option(
        metavar="DEG",
        help="Direction of the first arm from x towards y.",
        show_default="0; 225 where the platform has two parts",
    ),
]
Shortest = Annotated[float | None, _length("Shortest length of a hexapod's legs.")]
Longest = Annotated[float | None, _length("Longest length of a hexapod's legs.")]
Pair = Annotated[
    float | None,
    typer.Option(
        metavar="DEG",
        help="Half of the angle between the two legs of a pair, on base and platform.",
        show_default=f"{PAIR_DEG:g}",
    ),
]
Reflector = Annotated[
    str | None,
    typer.Option(metavar=REFLECTOR_METAVAR, help=f"{REFLECTOR_HELP} Left out: asked for."),
]


@dataclass(frozen=True, slots=True)
class RobotAnswer:
    """Answer of `robot`: the file and its robot."""

    file: Path
    mechanism: str
    geometry: Mapping[str, float]
    workspace_centre_mm: Sequence[float]


def command(
    terminal: Terminal,
    mechanism: Kind,
    *,
    base: Base,
    platform: Platform = None,
    forearm: Forearm = None,
    arm: Arm = None,
    plate: Plate = None,
    pinion: Pinion = None,
    travel: Travel = None,
    first: First = None,
    shortest: Shortest = None,
    longest: Longest = None,
    pair: Pair = None,
    reflector: Reflector = None,
    to: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Default: my-MECHANISM.yaml here.")
    ] = None,
) -> None:
    """Make a robot file from the sizes of a symmetrical robot.

    The file explains how base and platform become the parameters of a campaign. Its limits are
    typical values: replace them by those of the data sheet, then: pkmcal new DIR --robot FILE

    pkmcal robot delta --base 200 --platform 45 --arm 300 --forearm 800
    pkmcal robot linear-delta --base 295 --platform 45 --forearm 520 --travel 900
    pkmcal robot hexapod --base 400 --platform 150 --shortest 450 --longest 750
    pkmcal robot five-bar --base 200 --arm 200 --forearm 250
    """
    # which sizes a mechanism needs, and which it has not, the makers of its file decide
    kind = _find_mechanism(mechanism)
    typed = {
        "base": base, "platform": platform, "forearm": forearm, "arm": arm, "plate": plate,
        "pinion": pinion, "travel": travel, "first": first, "shortest": shortest,
        "longest": longest, "pair": pair,
    }  # fmt: skip
    sizes = {name: value for name, value in typed.items() if value is not None}
    _check(sizes)
    path = to or Path(f"my-{kind.name}.yaml")
    refuse_existing(path)  # before a question is asked
    place = ask_reflector(terminal) if reflector is None else read_place(reflector)
    document = _document(kind, path.stem, sizes)
    if place is not None:
        document = with_reflector(document, place)
    write_new_robot(path, document)
    terminal.say(f"made: {path}, mechanism {kind.name}")
    step = NextStep(("new", "DIR", "--robot", as_word(str(path))), "correct its limits")
    for line in step.lines:
        terminal.note(line)
    robot = document.robot
    answer = RobotAnswer(path, kind.name, dict(robot.parameters), robot.workspace_centre_mm or ())
    terminal.conclude(answer, step)


def _find_mechanism(word: str) -> Mechanism:
    """Return the mechanism of a name; raise `OptionsInvalid` for an unknown one."""
    if word in MECHANISMS:
        return MECHANISMS[word]
    raise OptionsInvalid(f"mechanism '{word}' is not known", remedy=suggestion(word, MECHANISMS))


def _document(kind: Mechanism, name: str, sizes: Mapping[str, float]) -> RobotDocument:
    """Make the robot of a mechanism and sizes by the names of their options.

    Raise `OptionsInvalid` or `ConfigInvalid` for a size that is missing, unknown or does not fit.
    """
    if kind.name not in FAMILY:
        return robot_of_sizes(kind, name, sizes)
    if "platform" not in sizes:
        raise OptionsInvalid("--platform is missing", remedy=f"give it in mm: {kind.name} has it")
    lengths = {f"{key}_mm": sizes[key] for key in sizes if key not in NO_LENGTHS}
    travel = sizes.get("travel")
    if travel is not None and kind.joints[0].is_revolute:
        raise OptionsInvalid(f"{kind.name} has cranks, and no --travel", remedy="leave it out")
    joint = None if travel is None else (-0.5 * travel, 0.5 * travel)
    of_arms = Sizes(sizes["base"], sizes["platform"], lengths, sizes.get("first"))
    return symmetrical_robot(FAMILY[kind.name], name, of_arms, joint)


def _check(sizes: Mapping[str, float]) -> None:
    """Raise `OptionsInvalid` for a size that is not a number or out of bounds."""
    for name, value in sizes.items():
        if name == "first":
            if not abs(value) <= 360.0:
                raise OptionsInvalid(f"--first is {value:g}°", remedy="give -360 to 360")
            continue
        # all forearms may meet in one point; only the difference of the radii counts
        may_be_zero = name in {"platform", "pair"}
        unit, most = ("°", 60.0) if name == "pair" else (" mm", LONGEST_MM)
        if not (0.0 < value <= most) and not (may_be_zero and value == 0.0):
            raise OptionsInvalid(
                f"--{name} is {value:g}{unit}",
                remedy=f"give {'0 or more' if may_be_zero else 'more than 0'}, up to "
                f"{most:g}{unit}",
            )
