"""Moves of a LinuxCNC machine: ways whose joints keep their limits, and the G-code of each part."""

from collections.abc import Sequence
from itertools import pairwise
from math import isfinite

from drivers.errors import LimitViolation
from drivers.linuxcnc.settings import LinuxcncSettings, PosesOfJoints
from drivers.values import Pose

DECIMALS = 6
"""Of mm and deg, as LinuxCNC tells positions: what was sent is read back to the digit."""
MINUTE_S = 60.0
SHORTEST_S = 0.05
OVERLONG_MM = 1e6
PARTS = (1, 2, 4, 8, 16)
LOOKS_A_PART = 8
REMEDY = "jog the robot towards the workspace's centre, or allow the joints more on their way"

MachinePlace = tuple[float, ...]
"""Numbers by the machine's own letters, mm and deg."""


def rounded(place: Sequence[float]) -> MachinePlace:
    """Numbers as they are sent; raises `LimitViolation` for what is no place."""
    if not all(isfinite(value) and abs(value) < OVERLONG_MM for value in place):
        raise LimitViolation(f"{list(place)} is no place", remedy="check the plan")
    return tuple(round(value, DECIMALS) + 0.0 for value in place)


def block(letters: str, place: MachinePlace, duration_s: float | None) -> str:
    """The block of G-code for a move, such as `… G53 G0 X12.345679 Y…`.

    Without a duration it is the machine's own rapid (G0). Below full speed it is given one: a rapid
    does not follow the feed override in all versions, and a feed would not count the rotary letter.
    Millimetres and absolute positions are said each time: somebody may have changed them by hand.
    """
    words = " ".join(f"{a}{value:.{DECIMALS}f}" for a, value in zip(letters, place, strict=True))
    if duration_s is None:
        return f"G21 G90 G94 G53 G0 {words}"
    return f"G21 G90 G93 G53 G1 {words} F{MINUTE_S / max(duration_s, SHORTEST_S):.{DECIMALS}f}"


def way_to(
    poses_of: PosesOfJoints,
    settings: LinuxcncSettings,
    here: Sequence[float],
    there: Sequence[float],
) -> tuple[Pose, ...]:
    """Poses to pass, the last being that of the joints `there`; raises `LimitViolation`."""
    start, end = poses_of.pose(here), poses_of.pose(there)
    for parts in PARTS:
        between = (_between(here, there, part / parts) for part in range(1, parts))
        poses = (*map(poses_of.pose, between), end)
        if all(_is_within(poses_of, settings, *leg) for leg in pairwise((start, *poses))):
            return poses
    raise LimitViolation(
        f"no way to its target keeps the joints within "
        f"{settings.limits_text(settings.passing_slack)} on {PARTS[-1]} straight parts",
        remedy=REMEDY,
        code="WAY",
    )


def _is_within(poses_of: PosesOfJoints, settings: LinuxcncSettings, start: Pose, end: Pose) -> bool:
    """True where joints keep their limits on the straight line; its ends are not looked at."""
    try:
        for look in range(1, LOOKS_A_PART):
            there = Pose(*_between(start.coordinates, end.coordinates, look / LOOKS_A_PART))
            settings.check(poses_of.joints(there), slack=settings.passing_slack)
    except LimitViolation:
        return False
    return True


def _between(first: Sequence[float], last: Sequence[float], part: float) -> tuple[float, ...]:
    return tuple(one + part * (other - one) for one, other in zip(first, last, strict=True))
