"""Robot files of symmetrical robots, made from the sizes that people have measured, and explained.

Data sheets and rulers give the radii of base and platform and the lengths of parts. Only the
difference of the radii counts for a platform that keeps its direction, so a mechanism's parameters
have the platform contracted into the arms' places: P_i less b_i (see
docs/explanation/model.md). The file states this above its numbers, for a reader who looks for the
radius of the base will not find it there. The text is written line by line, not dumped from a
tree: each arm stands on one line, and comments stand where they are needed. It is then read like
any robot file, so that wrong sizes are refused before a file exists.
"""

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from campaigns.errors import ConfigInvalid
from campaigns.kinematics.axes import Interval
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.robots.reach import middle_of_reach_mm
from campaigns.robots.robot import RobotDocument, parse_robot, require_millimetres, shipped_of
from campaigns.robots.schema import SCHEMA

CONTRACTED = (
    "The platform keeps its direction, so where its joints sit on it cannot be told from where the "
    "arms stand: the platform is contracted. x_mm and y_mm below are the arm's place on the base "
    "less its joint's place on the platform, and the platform is a point."
)
TYPICAL_LIMITS = (
    "Limits are typical ones: correct them, and the centre of the workspace, by the robot's data "
    "sheet."
)


@dataclass(frozen=True, slots=True)
class Sizes:
    """Sizes of a robot whose arms stand evenly around its base."""

    base_mm: float
    """Radius on which motors or rails stand."""
    platform_mm: float
    """Radius of the forearms' lower ends; of two parts, half the way between the two on a part."""
    lengths_mm: Mapping[str, float]
    """Lengths of arms and platform, by field: `arm_mm`, `forearm_mm` …"""
    first_deg: float | None = None
    """Direction of the first arm about z; None: the usual one of its kind of platform."""


def symmetrical_robot(
    mechanism: ClosedChain, name: str, sizes: Sizes, joint: Interval | None = None
) -> RobotDocument:
    """Make a robot of these sizes, with the limits of the shipped robot but for `joint`, rad or mm.

    Raise `ConfigInvalid` for a length that is missing or unknown, and for sizes that do not fit.
    """
    fields = (*mechanism.parameters.arm_fields(), *mechanism.parameters.platform_fields())
    needed = [field.stem for field in fields if field.quantity == "length"]
    check_sizes(mechanism, [name.removesuffix("_mm") for name in sizes.lengths_mm], needed)
    flat = _parameters_of(mechanism, sizes)
    require_millimetres(Parameters.of(mechanism.parameters, flat), f"{name}.yaml")
    like = shipped_of(mechanism).robot
    limits = like.limits if joint is None else replace(like.limits, joint=joint)
    kinematics = Kinematics.of(mechanism, flat)
    centre_mm = list(middle_of_reach_mm(kinematics, limits))
    return read_lines(
        [
            *_heading(mechanism, name, sizes),
            *lines_of(mechanism, name, flat, limits),
            f"  forearm_swing_deg: {round(math.degrees(limits.forearm_swing_rad), 9)}",
            "# where the forearms' bars sit on their part of the platform: for its tilt alone",
            f"plate_joints_mm: {_joints_on_platform(mechanism, sizes)}",
            f"workspace_centre_mm: {centre_mm}",
        ],
        name,
    )


def check_sizes(
    mechanism: Mechanism, sizes: Sequence[str], needed: Sequence[str], optional: Sequence[str] = ()
) -> None:
    """Raise `ConfigInvalid` for the name of a size's option that is missing or unknown."""
    for size in needed:
        if size not in sizes:
            raise ConfigInvalid(
                f"--{size} is missing", remedy=f"give it in mm: {mechanism.name} has it"
            )
    for size in sizes:
        if size not in (*needed, *optional):
            raise ConfigInvalid(f"{mechanism.name} has no --{size}", remedy="leave it out")


def _heading(mechanism: ClosedChain, name: str, sizes: Sizes) -> list[str]:
    """Return the lines of the comment that explains the file."""
    lengths = ", ".join(
        f"{field.removesuffix('_mm')} {value:g} mm" for field, value in sizes.lengths_mm.items()
    )
    stand = "motor centres" if mechanism.joints[0].is_revolute else "rails"
    joints = "the radius of its joints"
    if mechanism.parameters.platform_fields():
        joints = "half of the way between the two joints of each of its parts"
    origin = (
        f"{name}, made by `pkmcal robot` from its sizes: base {sizes.base_mm:g} mm (the radius of "
        f"{stand}), platform {sizes.platform_mm:g} mm ({joints}), {lengths}."
    )
    return [*comment(origin), "#", *comment(CONTRACTED), "#", *comment(TYPICAL_LIMITS)]


def comment(text: str) -> list[str]:
    """Return the lines of a comment."""
    return [f"# {line}" for line in textwrap.wrap(text, 97)]


def lines_of(
    mechanism: Mechanism, name: str, flat: Mapping[str, float], limits: Limits
) -> list[str]:
    """Return a robot file's lines of keys and values, up to its limits of joints and poses.

    `flat` holds the parameters by name, mm and deg.
    """
    space = mechanism.parameters
    arms = [
        ", ".join(f"{field.name}: {flat[f'arm{arm}.{field.name}']!r}" for field in fields)
        for arm in range(space.arms)
        if (fields := space.arm_fields(arm=arm))
    ]
    ranges = {f"joint_{mechanism.joints[0].unit}": (mechanism.joints[0], limits.joint_range)}
    for axis, interval in zip(mechanism.task, limits.task, strict=True):
        if interval is not None and not axis.is_fixed:
            ranges[axis.column] = (axis, interval)
    return [
        f"schema: {SCHEMA}",
        f"mechanism: {mechanism.name}",
        f"name: {name}",
        "geometry:",
        "  arms:",
        *(f"    - {{{arm}}}" for arm in arms),
        *(f"  {field.name}: {flat[field.name]!r}" for field in space.platform_fields()),
        "limits:",
        *(
            f"  {key}: {[round(axis.to_file(end), 9) for end in interval]}"
            for key, (axis, interval) in ranges.items()
        ),
    ]


def read_lines(lines: list[str], name: str) -> RobotDocument:
    """Read the lines of a robot file as a robot; raise `ConfigInvalid`."""
    return parse_robot("".join(f"{line}\n" for line in lines), f"{name}.yaml")


def _joints_on_platform(mechanism: ClosedChain, sizes: Sizes) -> list[list[float]]:
    return [
        [*(round(place, 9) for place in _joint_mm(direction_deg, mechanism, sizes)), 0.0]
        for direction_deg in _directions_deg(mechanism, sizes)
    ]


def _parameters_of(mechanism: ClosedChain, sizes: Sizes) -> dict[str, float]:
    """Return the parameters by name, mm and deg; raise `KeyError` for a missing length."""
    space = mechanism.parameters
    flat: dict[str, float] = {}
    for arm, direction_deg in enumerate(_directions_deg(mechanism, sizes)):
        x, y = math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))
        aside_mm, ahead_mm = _joint_mm(direction_deg, mechanism, sizes)
        # a rail stands upright (elevation 90°), so its azimuth makes no difference
        on_rail = mechanism.joints[arm].unit == "mm"
        values = {
            "x_mm": round(sizes.base_mm * x - aside_mm, 9),
            "y_mm": round(sizes.base_mm * y - ahead_mm, 9),
            "azimuth_deg": 0.0 if on_rail else direction_deg,
            "elevation_deg": 90.0,
        } | dict(sizes.lengths_mm)
        for field in space.arm_fields():
            is_needed = field.quantity == "length"
            value = values[field.name] if is_needed else values.get(field.name, 0.0)
            flat[f"arm{arm}.{field.name}"] = value
    lengths = {field.name: sizes.lengths_mm[field.name] for field in space.platform_fields()}
    return flat | lengths


def _directions_deg(mechanism: ClosedChain, sizes: Sizes) -> list[float]:
    """Return the directions of the arms about z."""
    # Arms stand evenly around z. The first arm of a Delta points along x; the arms of a platform
    # with a length of its own begin at 225°, as those of the shipped Par4 do.
    space = mechanism.parameters
    usual = 225.0 if space.platform_fields() else 0.0
    first = usual if sizes.first_deg is None else sizes.first_deg
    return [(first + 360.0 * arm / space.arms) % 360.0 for arm in range(space.arms)]


def _joint_mm(direction_deg: float, mechanism: ClosedChain, sizes: Sizes) -> tuple[float, float]:
    """Return x and y of an arm's joint on its part of the platform, mm."""
    # The joints of a platform of two parts lie on lines along x, one at each end of a part, and
    # count from the part's middle: the way between the parts is the platform's own length.
    x, y = math.cos(math.radians(direction_deg)), math.sin(math.radians(direction_deg))
    if mechanism.parameters.platform_fields():
        return math.copysign(sizes.platform_mm, x), 0.0
    return sizes.platform_mm * x, sizes.platform_mm * y
