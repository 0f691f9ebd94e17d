"""Robot files of hexapods, hexaglides and five-bars from their sizes, made by `pkmcal robot`.

The legs of a hexapod come in pairs. On the base the pairs stand at 0°, 120° and 240°, on the
platform between them at 60°, 180° and 300°, and the two legs of a pair on the base go to
neighbouring pairs of the platform, as is usual. A hexapod hangs below its base. Limits of its poses
are a box about the middle of all joints' travel, whose corners need not be reached.
"""

import math
from collections.abc import Callable, Mapping

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ConfigInvalid
from campaigns.kinematics.axes import Interval
from campaigns.kinematics.catalog import FIVE_BAR, HEXAGLIDE, HEXAPOD
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.robots.robot import RobotDocument, require_millimetres
from campaigns.robots.symmetrical import TYPICAL_LIMITS, check_sizes, comment, lines_of, read_lines

SizeByOption = Mapping[str, float]
"""Sizes by the names of their options, mm or deg."""

PAIR_DEG = 5.0
"""Typical half of the angle between the two legs of a pair."""
TURNS_DEG = (15.0, 15.0, 20.0)
"""Typical largest turns of a platform about x, y and z."""
CRANK_DEG = 120.0
"""Typical largest turn of a five-bar's cranks out of the middle."""
NEEDED: Mapping[str, tuple[str, ...]] = {
    HEXAPOD.name: ("base", "platform", "shortest", "longest"),
    HEXAGLIDE.name: ("base", "platform", "forearm", "travel"),
    FIVE_BAR.name: ("base", "arm", "forearm"),
}
"""SizeByOption that each mechanism needs."""


def robot_of_sizes(mechanism: Mechanism, name: str, sizes: SizeByOption) -> RobotDocument:
    """Make a robot of these sizes, with typical limits.

    Raise `ConfigInvalid` for a size that is missing or unknown, and for sizes that do not fit.
    """
    optional = () if mechanism.name == FIVE_BAR.name else ("pair", "first")
    check_sizes(mechanism, [*sizes], NEEDED[mechanism.name], optional)
    flat, limits = MAKERS[mechanism.name](sizes)
    require_millimetres(Parameters.of(mechanism.parameters, flat), f"{name}.yaml")
    middle = np.array([0.5 * sum(ends) for ends in limits.task if ends is not None])
    model = Kinematics.of(mechanism.with_home(middle), flat)
    judged = model.feasibility(limits, middle)
    if not judged.feasible.all():
        raise ConfigInvalid(
            "a robot of these sizes does not reach the middle of its workspace: "
            + "; ".join(judged.describe(0)),
            remedy="check the sizes: the legs must span from the base to the platform",
        )
    stated = ", ".join(f"{size} {value:g}" for size, value in sizes.items())
    origin = f"{name}, made by `pkmcal robot` from its sizes: {stated} (mm and deg)."
    heading = [*comment(origin), "#", *comment(TYPICAL_LIMITS)]
    return read_lines([*heading, *lines_of(mechanism, name, flat, limits)], name)


def _hexapod(sizes: SizeByOption) -> tuple[dict[str, float], Limits]:
    """Return a hexapod's parameters by name, mm and deg, and its limits."""
    shortest, longest = sizes["shortest"], sizes["longest"]
    if not shortest < longest:
        raise ConfigInvalid(
            f"--shortest {shortest:g} is not below --longest {longest:g}",
            remedy="give the lengths between which the legs move",
        )
    stroke = longest - shortest
    box = (0.5 * stroke, 0.5 * stroke, stroke / 3.0)
    limits = _limits_of_turning(sizes, 0.5 * (shortest + longest), (0.0, stroke), box)
    return _values(sizes, {"joint_offset_mm": shortest}), limits


def _hexaglide(sizes: SizeByOption) -> tuple[dict[str, float], Limits]:
    """Return the parameters of a hexaglide on upright rails, mm and deg, and its limits."""
    travel, forearm = sizes["travel"], sizes["forearm"]
    box = (0.25 * forearm, 0.25 * forearm, 0.25 * travel)
    limits = _limits_of_turning(sizes, forearm, (-0.5 * travel, 0.5 * travel), box)
    upright = {"azimuth_deg": 0.0, "elevation_deg": 90.0, "joint_offset_mm": 0.0}
    return _values(sizes, upright | {"forearm_mm": forearm}), limits


def _five_bar(sizes: SizeByOption) -> tuple[dict[str, float], Limits]:
    """Return a five-bar's parameters by name, mm and deg, and its limits.

    Its motors are on x, the point is on the side of y, and cranks point there at reading 0.
    """
    half, arm, forearm = 0.5 * sizes["base"], sizes["arm"], sizes["forearm"]
    reach = arm + forearm
    middle = _rounded(math.sqrt(max((0.6 * reach) ** 2 - half**2, 0.0)))
    same = {"joint_offset_deg": 90.0, "arm_mm": arm, "forearm_mm": forearm}
    flat = {
        f"arm{k}.{key}": value
        for k, x in enumerate((-half, half))
        for key, value in ({"x_mm": x, "y_mm": 0.0} | same).items()
    }
    aside, ahead = _rounded(reach / 3.0), _rounded(0.28 * reach)
    task = ((-aside, aside), (middle - ahead, middle + ahead), (0.0, 0.0))
    crank = math.radians(CRANK_DEG)
    return flat, Limits((-crank, crank), task)


MAKERS: Mapping[str, Callable[[SizeByOption], tuple[dict[str, float], Limits]]] = {
    HEXAPOD.name: _hexapod,
    HEXAGLIDE.name: _hexaglide,
    FIVE_BAR.name: _five_bar,
}


def _values(sizes: SizeByOption, same: Mapping[str, float]) -> dict[str, float]:
    """Return the parameters of six legs by name: their places, and values that all have."""
    flat: dict[str, float] = {}
    for leg, (base, platform) in enumerate(zip(*_places_mm(sizes), strict=True)):
        places = dict(zip(("x_mm", "y_mm", "z_mm"), base, strict=True))
        ends = dict(zip(("plate_x_mm", "plate_y_mm", "plate_z_mm"), platform, strict=True))
        of_leg = {key: round(float(value), 6) + 0.0 for key, value in (places | ends).items()}
        flat |= {f"arm{leg}.{key}": value for key, value in (of_leg | dict(same)).items()}
    return flat


def _places_mm(sizes: SizeByOption) -> tuple[Array, Array]:
    """Return the legs' joints on the base and on the platform, (6, 3) each, mm."""
    pair, first = sizes.get("pair", PAIR_DEG), sizes.get("first", 0.0)
    signs, third = np.tile([1.0, -1.0], 3), np.repeat([0.0, 120.0, 240.0], 2)
    base_deg = first + np.roll(third, -1) + signs * pair
    platform_deg = first + 60.0 + third - signs * pair
    both = ((sizes["base"], base_deg), (sizes["platform"], platform_deg))
    on_base, on_platform = (
        np.column_stack([r * np.cos(np.radians(a)), r * np.sin(np.radians(a)), 0.0 * a])
        for r, a in both
    )
    return on_base, on_platform


def _limits_of_turning(
    sizes: SizeByOption, leg_mm: float, joint: Interval, box_mm: tuple[float, float, float]
) -> Limits:
    """Return limits about the pose at which all legs have a length, or carriages are at 0."""
    base, platform = _places_mm(sizes)
    down2 = leg_mm**2 - float(((base - platform)[0] ** 2).sum())
    middle = (0.0, 0.0, -_rounded(math.sqrt(max(down2, 0.0))))
    places = [(m - _rounded(h), m + _rounded(h)) for m, h in zip(middle, box_mm, strict=True)]
    turns = [(-turn, turn) for turn in np.radians(TURNS_DEG).tolist()]
    return Limits(joint, (*places, *turns))


def _rounded(length_mm: float) -> float:
    """Return a length for people: in 10 mm, or less of small robots."""
    digits = min(1, math.floor(math.log10(max(length_mm, 1.0))) - 1)
    return round(length_mm, -digits)
