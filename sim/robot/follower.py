"""The controller's place in a cell whose joints somebody else moves: it only follows."""

import math
import time
from collections.abc import Callable, Mapping

import numpy as np

from drivers.values import RobotState
from sim.errors import AssemblyLost
from sim.geometry import PAR4, Array, Kind
from sim.random_streams import WorkedTime, target_key
from sim.robot.driven_robot import DrivenRobot, Standing
from sim.robot.linuxcnc_joints import JointsLost, JointSource

SAME_RAD = math.radians(2e-6)
"""Joints are told with six decimals of a degree."""
LOOK_AGAIN_S = 0.003
"""Real seconds after which joints that move read differently."""


class FollowingController:
    """Controller of a robot that is where a joint source says. It takes no orders: another does.

    Wherever the joints come to rest, the robot arrives. While they cannot be read it stands where
    it was: drives without orders hold.
    """

    def __init__(
        self,
        source: JointSource,
        robot: DrivenRobot,
        *,
        geometry: Mapping[str, float],
        speed_per_s: float,
        worked: WorkedTime,
        sleep_s: Callable[[float], None] = time.sleep,
        kind: Kind = PAR4,
    ) -> None:
        self.kind = kind
        self._source = source
        self._robot = robot
        self._first: Standing = robot.standing
        self._geometry = dict(geometry)
        self._speed_per_s = speed_per_s
        self._worked = worked
        self._sleep_s = sleep_s

    def state(self, now_s: float) -> RobotState:  # noqa: ARG002 - the joints have their time
        """Readings of the joints now."""
        joints, moving = self._follow()
        return RobotState(
            joints=tuple(map(float, joints)), moving=moving, fault="", emergency_stop=False
        )

    def is_moving(self, now_s: float) -> bool:  # noqa: ARG002 - as in `state`
        """Whether the joints move."""
        return self._follow()[1]

    def encoders(self, now_s: float) -> Array:  # noqa: ARG002 - as in `state`
        """(n,): the joints now."""
        return self._follow()[0]

    def close(self) -> None:
        """Let go of the joints' source."""
        self._source.close()

    def geometry(self) -> dict[str, float]:
        """Geometry that the scenario says; the real controller's is its own."""
        return dict(self._geometry)

    def _follow(self) -> tuple[Array, bool]:
        """Joints (n,), and whether they move; what has come to rest arrives."""
        joints = self._read()
        if _is_same(joints, self._standing):
            return self._standing, False
        self._sleep_s(LOOK_AGAIN_S)
        again = self._read()
        if not _is_same(again, joints):
            return again, True
        self._arrive(again)
        return again, False

    @property
    def _standing(self) -> Array:
        return self._robot.standing.encoders

    def _read(self) -> Array:
        try:
            return self._source.read()
        except JointsLost:
            return self._standing

    def _arrive(self, joints: Array) -> None:
        """Come to rest there, by the straight joint path or, after a jump, from the first place.

        A controller that is started anew tells other joints at once; no way leads to them.
        """
        travel = float(np.abs(joints - self._standing).max())
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


def _is_same(a: Array, b: Array) -> bool:
    return bool(np.abs(a - b).max() <= SAME_RAD)
