"""The controller's place in a cell whose joints a real controller moves: it only follows."""

from collections.abc import Mapping, Sequence

import numpy as np

from drivers.values import RobotState
from sim.errors import AssemblyLost
from sim.geometry import PAR4, Array, Kind
from sim.random_streams import WorkedTime, target_key
from sim.robot.driven_robot import DrivenRobot, Standing


class FollowingController:
    """Controller of a robot that is where a real controller's joints are. It takes no orders.

    Whoever drives the real controller tells the joints each time that it stands. Until then the
    robot stands where it was.
    """

    def __init__(
        self,
        robot: DrivenRobot,
        *,
        geometry: Mapping[str, float],
        speed_per_s: float,
        worked: WorkedTime,
        kind: Kind = PAR4,
    ) -> None:
        self.kind = kind
        self._robot = robot
        self._first: Standing = robot.standing
        self._geometry = dict(geometry)
        self._speed_per_s = speed_per_s
        self._worked = worked

    def tell(self, joints: Sequence[float]) -> None:
        """The real robot stands at these joints, rad or mm. Where they have changed, it arrives."""
        if not np.array_equal(joints, self._robot.standing.encoders):
            self._arrive(np.array(joints))

    def state(self, now_s: float) -> RobotState:
        """Readings of the joints now."""
        joints = self.encoders(now_s)
        return RobotState(
            joints=tuple(map(float, joints)), moving=False, fault="", emergency_stop=False
        )

    def is_moving(self, now_s: float) -> bool:  # noqa: ARG002 - joints are told at rest
        """Whether the joints move."""
        return False

    def encoders(self, now_s: float) -> Array:  # noqa: ARG002 - the joints have their time
        """(n,): the joints now."""
        return self._robot.standing.encoders

    def geometry(self) -> dict[str, float]:
        """Geometry that the scenario says; the real controller's is its own."""
        return dict(self._geometry)

    def _arrive(self, joints: Array) -> None:
        """Come to rest there, by the straight joint path or, after a jump, from the first place.

        A controller that is started anew tells other joints at once; no way leads to them.
        """
        travel = float(np.abs(joints - self._robot.standing.encoders).max())
        if self._robot.passable_part(joints) < 1.0:
            self._robot.standing = self._first
            if self._robot.passable_part(joints) < 1.0:
                listed = ", ".join(f"{self.kind.outer(joint):.2f}" for joint in joints)
                raise AssemblyLost(
                    f"the simulated robot cannot be at joints {listed} {self.kind.unit}",
                    remedy="keep the real controller's joints inside its workspace",
                )
        self._robot.arrive(joints, target_key(joints.tolist()))
        self._worked.seconds += travel / self._speed_per_s
