"""The way to joints on a controller that goes straight in world coordinates.

Between two poses within the joints' limits, the straight line of poses can leave them, above all
near the workspace's boundary, and LinuxCNC notices that only on the way. The straight way of the
joints never leaves them: so it is followed by as few poses as it takes.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

from drivers.errors import LimitViolation
from drivers.linuxcnc.motion import JointLimits
from drivers.linuxcnc.settings import Kinematics
from drivers.values import Pose

PARTS = (1, 2, 4, 8, 16)
LOOKS_A_PART = 8
REMEDY = "jog the robot towards the workspace's centre, or allow the joints more on their way"


def way_to(
    kinematics: Kinematics, passing: JointLimits, from_rad: Sequence[float], to_rad: Sequence[float]
) -> tuple[Pose, ...]:
    """Poses to pass, the last being that of `to_rad`; raises `LimitViolation`."""
    start, end = kinematics.pose(from_rad), kinematics.pose(to_rad)
    for parts in PARTS:
        between = (_between(from_rad, to_rad, part / parts) for part in range(1, parts))
        poses = (*map(kinematics.pose, between), end)
        if all(_is_within(kinematics, passing, *leg) for leg in pairwise((start, *poses))):
            return poses
    raise LimitViolation(
        f"no way to its target keeps the joints within "
        f"{passing.text()} on {PARTS[-1]} straight parts",
        remedy=REMEDY,
        code="WAY",
    )


def _is_within(kinematics: Kinematics, passing: JointLimits, start: Pose, end: Pose) -> bool:
    try:
        for pose in _along(start, end):
            passing.check(kinematics.joints_rad(pose))
    except LimitViolation:
        return False
    return True


def _along(start: Pose, end: Pose) -> Iterator[Pose]:
    """Poses on the straight line, without its ends."""
    first = (start.x_mm, start.y_mm, start.z_mm, start.theta_rad)
    last = (end.x_mm, end.y_mm, end.z_mm, end.theta_rad)
    for look in range(1, LOOKS_A_PART):
        yield Pose(*_between(first, last, look / LOOKS_A_PART))


def _between(
    first: Sequence[float], last: Sequence[float], part: float
) -> tuple[float, float, float, float]:
    a, b, c, d = (one + part * (other - one) for one, other in zip(first, last, strict=True))
    return a, b, c, d
