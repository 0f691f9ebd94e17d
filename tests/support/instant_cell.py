"""Devices that take no time, and the work that the engine does with them."""

from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.identification.options import IdentificationOptions
from campaigns.measuring.work import Work
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.planning.steps import joint_steps
from campaigns.robots.robot import find_robot, pose_row
from campaigns.settings.config import new_config
from campaigns.settings.sections import SettleConfig
from drivers.values import Identity, Pose, RobotState, Weather

ROBOT = find_robot("par4-prototype").robot
NOMINAL = ROBOT.kinematics
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
AIR = Weather(20.0, 1013.25, 50.0)
COVARIANCE_MM2 = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))
DEVICE = Identity("none", "instant device", "0", "0", "none")
SETTINGS = {
    "name": "engine",
    "controller": {"url": "sim://none"},
    "tracker": {"url": "sim://none", "reflector": "none"},
}


def work_of(shots: Sequence[PlannedShot]) -> Work:
    return Work(
        stage="run",
        steps=joint_steps(shots),
        plan_digest=plan_digest(shots, ROBOT.mechanism),
        robot_file_digest=ROBOT.digest(),
        configuration={},
        robot=RobotModel(NOMINAL, ROBOT.limits, pose_row(CENTRE)),
        speed_fraction=0.3,
        settle=SettleConfig.model_construct(
            time_s=0.0, still_deg=5e-4, in_place_deg=5e-3, timeout_s=10.0
        ),
        gate=new_config(SETTINGS).gate,
        search_mm=2500.0,
        options=IdentificationOptions(),
    )


@dataclass
class InstantRobot:
    """Is at its target at once."""

    joints: tuple[float, ...]

    def identity(self) -> Identity:
        return DEVICE

    def state(self) -> RobotState:
        return RobotState(self.joints, moving=False, fault="", emergency_stop=False, raw="instant")

    def move_joints(self, joints: Sequence[float], _speed_fraction: float) -> None:
        self.joints = tuple(joints)

    def lacks(self, _names: Sequence[str]) -> tuple[str, ...]:
        return ()
