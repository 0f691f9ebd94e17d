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
from campaigns.kinematics.catalog import FAMILY
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.next_step import NextStep
from campaigns.robots.robot import with_reflector, write_new_robot
from campaigns.robots.symmetrical import Sizes, symmetrical_robot
from drivers.texts import quoted

LONGEST_MM = 100_000.0


def _length(text: str) -> typer.models.OptionInfo:
    return cast("typer.models.OptionInfo", typer.Option(metavar="MM", help=text))


Kind = Annotated[str, typer.Argument(metavar="MECHANISM", help=f"One of {', '.join(FAMILY)}.")]
Base = Annotated[float, _length("Radius on which the motors or rails stand.")]
Platform = Annotated[
    float,
    _length(
        "Radius of the platform's joints; if it has two parts: half the distance between the two "
        "joints of a part."
    ),
]
Forearm = Annotated[float, _length("Length of the forearms (rods).")]
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
    platform: Platform,
    forearm: Forearm,
    arm: Arm = None,
    plate: Plate = None,
    pinion: Pinion = None,
    travel: Travel = None,
    first: First = None,
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
    """
    # which lengths a mechanism needs, and which it has not, `symmetrical_robot` decides
    kind = _find_mechanism(mechanism)
    typed = {"arm": arm, "forearm": forearm, "plate": plate, "pinion": pinion}
    lengths = {f"{name}_mm": value for name, value in typed.items() if value is not None}
    sizes = Sizes(base, platform, lengths, first)
    _check(sizes, travel, kind)
    path = to or Path(f"my-{kind.name}.yaml")
    refuse_existing(path)  # before a question is asked
    place = ask_reflector(terminal) if reflector is None else read_place(reflector)
    joint = None if travel is None else (-0.5 * travel, 0.5 * travel)
    document = symmetrical_robot(kind, path.stem, sizes, joint)
    if place is not None:
        document = with_reflector(document, place)
    write_new_robot(path, document)
    terminal.say(f"made: {path}, mechanism {kind.name}")
    step = NextStep(f"pkmcal new DIR --robot {quoted(str(path))}", "correct its limits")
    for line in step.lines:
        terminal.note(line)
    robot = document.robot
    answer = RobotAnswer(path, kind.name, dict(robot.parameters), robot.workspace_centre_mm or ())
    terminal.conclude(answer, step)


def _find_mechanism(word: str) -> ClosedChain:
    """Return the mechanism of a name; raise `OptionsInvalid` for an unknown one."""
    if word in FAMILY:
        return FAMILY[word]
    raise OptionsInvalid(f"mechanism '{word}' is not known", remedy=suggestion(word, FAMILY))


def _check(sizes: Sizes, travel: float | None, kind: ClosedChain) -> None:
    """Raise `OptionsInvalid` for a size that is not a number or out of bounds."""
    lengths = dict(sizes.lengths_mm) | {"base_mm": sizes.base_mm, "platform_mm": sizes.platform_mm}
    lengths |= {} if travel is None else {"travel_mm": travel}
    for name, value in lengths.items():
        # all forearms may meet in one point; only the difference of the radii counts
        may_be_zero = name == "platform_mm"
        if not (0.0 < value <= LONGEST_MM) and not (may_be_zero and value == 0.0):
            raise OptionsInvalid(
                f"--{name.removesuffix('_mm')} is {value:g} mm",
                remedy=f"give {'0 or more' if may_be_zero else 'more than 0'}, up to "
                f"{LONGEST_MM:g} mm",
            )
    if sizes.first_deg is not None and not abs(sizes.first_deg) <= 360.0:
        raise OptionsInvalid(f"--first is {sizes.first_deg:g}°", remedy="give -360 to 360")
    if travel is not None and kind.joints[0].is_revolute:
        raise OptionsInvalid(f"{kind.name} has cranks, and no --travel", remedy="leave it out")
