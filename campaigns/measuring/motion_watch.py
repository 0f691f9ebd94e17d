"""Motion watch: sees by the readings of a leg whether a controller reports what its robot does.

Two mistakes of a controller's server make a program measure a robot that still moves: it reports
the commanded joints as those of its encoders, and it reports rest during a motion. With both at
once nothing else in a run notices it. Two readings cannot be of a robot:

1. It is at the end of a leg sooner than any robot could be.
2. Between the ends of a leg it stands, and later it stands elsewhere, without motion meanwhile.
"""

from collections.abc import Sequence
from math import inf, radians

from campaigns.kinematics.axes import Axis
from campaigns.planning.paths import Joints
from drivers.errors import ImplausibleAnswer
from drivers.values import RobotState

LONG_LEG_RAD = radians(2.0)
"""Travel of a joint, of a crank or what compares, from which a leg is watched."""
FASTEST_RAD_S = radians(1000.0)
"""Speed that no joint has on average over a leg, from rest to rest, at full speed."""
AWAY_RAD = radians(0.5)
"""Least distance of readings that are of two places."""
REMEDY = (
    "correct the server: STATE in docs/reference/robotline.md. Nothing that is measured through it "
    "can be trusted"
)


class MotionWatch:
    """Watch of one leg, which is given each reading of the robot on it."""

    def __init__(
        self,
        ends: tuple[Joints, Joints],
        axes: Sequence[Axis],
        speed_fraction: float,
        begun_s: float,
    ) -> None:
        """Take the leg's `ends`, where it begins and leads, and the time of its command."""
        self._ends, self._axes, self._begun_s = ends, axes, begun_s
        travel_rad = self._apart_rad(*ends)
        self.is_long = travel_rad >= LONG_LEG_RAD
        """Whether it is long enough to be watched."""
        self._least_s = travel_rad / (FASTEST_RAD_S * speed_fraction)
        self._stood: Joints | None = None
        """Joints between the ends at which the robot was first said to stand; None: it moves."""
        self.passed = False
        """Whether joints between the ends were read."""
        self.moved = False
        """Whether motion was reported."""

    def see(self, state: RobotState, now_s: float) -> None:
        """Take a reading; raise `ImplausibleAnswer` for one that no robot can give."""
        if not self.is_long:
            return
        here, (start, end) = state.joints, self._ends
        self.moved |= state.moving
        is_between = (
            self._apart_rad(here, start) > AWAY_RAD and self._apart_rad(here, end) > AWAY_RAD
        )
        self.passed |= is_between
        after_s = now_s - self._begun_s
        if after_s < self._least_s and self._apart_rad(here, end) <= AWAY_RAD:
            raise ImplausibleAnswer(
                f"the controller reports its target {after_s:.2f} s after the command, sooner than "
                f"any robot is there (limit {self._least_s:.2f} s): these are no encoders",
                remedy=REMEDY,
            )
        if state.moving:
            self._stood = None
        elif self._stood is None:
            self._stood = here if is_between else None
        elif self._apart_rad(here, self._stood) > AWAY_RAD:
            raise ImplausibleAnswer(
                "the controller reports that the robot stands (moving 0) while its joints change",
                remedy=REMEDY,
            )

    def _apart_rad(self, here: Joints, there: Joints) -> float:
        """Return the largest distance of a joint; infinite where the controller has others."""
        if len(here) != len(there):
            return inf
        joints = zip(self._axes, here, there, strict=True)
        return max(abs(one - other) / axis.scale for axis, one, other in joints)
