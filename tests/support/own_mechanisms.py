"""Mechanisms that their closures alone state, as an author of his own would write them."""

import numpy as np

from campaigns.kinematics.axes import PLANE, POSITION, TURN
from campaigns.kinematics.catalog import DELTA
from campaigns.kinematics.implicit import ImplicitMechanism, closures
from campaigns.kinematics.limbs import FOREARM, place_fields, transmission_fields
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import ParameterField
from campaigns.kinematics.rotations import turned_by

OFFSET_MM = ParameterField("joint_offset_mm", "the joint's offset, mm", "place", "offsets")
OFFSET_DEG = ParameterField("joint_offset_deg", "the joint's offset, deg", "angle", "offsets")
ARM = ParameterField("arm_mm", "the arm's length, mm", "length", "lengths")
ON_PLATFORM = tuple(
    ParameterField(f"plate_{c}_mm", f"{c} on the platform, mm", "place", "plate") for c in "xyz"
)


class OneClosureDelta(ImplicitMechanism):
    """A Delta again: |X - elbow_i| = forearm_i, with the parameters of the catalogue's."""

    joint_kinds = ("revolute",) * 3
    task_axes = POSITION
    arm_fields = (*DELTA.parameters.arm_fields(), *transmission_fields("deg", "gear"))

    def misfit(self, fields, joints, pose):
        out = fields["arm"] * np.cos(joints)
        x = fields["x"] + out * np.cos(fields["azimuth"])
        y = fields["y"] + out * np.sin(fields["azimuth"])
        z, forearm = fields["z"] - fields["arm"] * np.sin(joints), fields["forearm"]
        squares = sum((pose[..., k, None] - c) ** 2 for k, c in enumerate((x, y, z)))
        return (squares - forearm**2) / (2.0 * forearm)

    def first_joints(self, fields, poses):
        return np.full((len(poses), 3), 0.3)

    def first_pose(self, fields, joints):
        return self.home_poses(joints)


class ThreeCranks(ImplicitMechanism):
    """3-RRR: three cranks and forearms in a plane, under a platform that turns."""

    joint_kinds = ("revolute",) * 3
    task_axes = (*PLANE, TURN)
    arm_fields = (
        *place_fields("the motor")[:2], OFFSET_DEG, ARM, FOREARM, *ON_PLATFORM[:2],
        *transmission_fields("deg", "gear"),
    )  # fmt: skip

    def misfit(self, fields, joints, pose):
        x, y = self.to_motors(fields, pose)
        x, y = x - fields["arm"] * np.cos(joints), y - fields["arm"] * np.sin(joints)
        return (x**2 + y**2 - fields["forearm"] ** 2) / (2.0 * fields["forearm"])

    def first_joints(self, fields, poses):
        x, y = self.to_motors(fields, poses)
        far, arm, forearm = np.hypot(x, y), fields["arm"], fields["forearm"]
        return np.arctan2(y, x) + np.arccos((far**2 + arm**2 - forearm**2) / (2.0 * far * arm))

    def first_pose(self, fields, joints):
        return self.home_poses(joints)

    def to_motors(self, fields, pose):
        c, s, (u, v) = np.cos(pose[..., 2:]), np.sin(pose[..., 2:]), self.plate(fields)
        return (
            pose[..., :1] + c * u - s * v - fields["x"],
            pose[..., 1:2] + s * u + c * v - fields["y"],
        )

    def plate(self, fields):
        return fields["plate_x"], fields["plate_y"]


class Tricept(ImplicitMechanism):
    """Three legs around a passive one, that hangs on a universal joint and carries the tool."""

    joint_kinds = ("prismatic",) * 3
    task_axes = POSITION
    arm_fields = (*place_fields("the leg's joint"), OFFSET_MM, *ON_PLATFORM)

    def misfit(self, fields, joints, pose):
        return (self.squares(fields, pose) - joints**2) / (2.0 * fields["joint_offset"])

    def first_joints(self, fields, poses):
        return np.sqrt(self.squares(fields, poses))

    def first_pose(self, fields, joints):
        return self.home_poses(joints)

    # the passive leg points from the origin to X; it turns about the base's x, then about its own y
    def squares(self, fields, pose):
        x, y, z = (pose[..., k, None] for k in range(3))
        aside = np.sqrt(y**2 + z**2)
        far, (u, v, w) = np.sqrt(x**2 + aside**2), (fields[f"plate_{c}"] for c in "xyz")
        sine, cosine, sin_x, cos_x = -x / far, aside / far, y / aside, -z / aside
        ahead, down = cosine * u + sine * w, cosine * w - sine * u
        ends = (x + ahead, y + cos_x * v - sin_x * down, z + sin_x * v + cos_x * down)
        return sum((e - fields[c]) ** 2 for e, c in zip(ends, "xyz", strict=True))


class Polar(ImplicitMechanism):
    """An arm that turns and grows, in a plane: joints of two kinds, and a redundant third one."""

    joint_kinds = ("revolute", "prismatic", "revolute")
    task_axes = PLANE
    arm_fields = (OFFSET_MM, OFFSET_DEG, *transmission_fields("deg", "gear"),
                  *transmission_fields("mm", "drive"))  # fmt: skip
    platform_fields = (ParameterField("hand_mm", "the hand's length, mm", "length", "lengths"),)

    def misfit(self, fields, joints, pose):
        turn, far, wrist = (joints[..., k : k + 1] for k in range(3))
        x = far * np.cos(turn) + fields["hand"] * np.cos(turn + wrist)
        y = far * np.sin(turn) + fields["hand"] * np.sin(turn + wrist)
        return closures(pose[..., :1] - x, pose[..., 1:] - y)

    def first_joints(self, fields, poses):
        return np.tile([0.0, 200.0, 0.0], (len(poses), 1))

    def first_pose(self, fields, joints):
        return self.home_poses(joints)


def around(radius_mm, directions_deg):
    """Places (n, 2) on a circle."""
    turns = np.radians(directions_deg)
    return radius_mm * np.column_stack([np.cos(turns), np.sin(turns)])


def robot_of(mechanism, arms, home, **platform):
    """Model of values by key, (n,), and of the platform's, with a home pose."""
    values = {f"arm{k}.{key}": v for key, each in arms.items() for k, v in enumerate(each)}
    return Kinematics.of(mechanism.with_home(np.array(home)), values | platform)


def three_cranks():
    """A 3-RRR on a circle of 300 mm."""
    base, plate = around(300.0, [90, 210, 330]), around(60.0, [90, 210, 330])
    arms = {"x_mm": base[:, 0], "y_mm": base[:, 1], "joint_offset_deg": [5.0, -3.0, 2.0]}
    arms |= {"arm_mm": [150.0, 152.0, 149.0], "forearm_mm": [180.0, 181.0, 179.0]}
    arms |= {"plate_x_mm": plate[:, 0], "plate_y_mm": plate[:, 1]}
    return robot_of(ThreeCranks("3-rrr"), arms, [0.0, 0.0, 0.0, 0.1])


def tricept():
    """A Tricept that hangs on a circle of 300 mm."""
    base, plate = around(300.0, [90, 210, 330]), around(120.0, [92, 211, 329])
    arms = {"x_mm": base[:, 0], "y_mm": base[:, 1], "z_mm": [0.0, 3.0, -2.0]}
    arms |= {"joint_offset_mm": [400.0, 402.0, 399.0], "plate_z_mm": [90.0, 92.0, 88.0]}
    arms |= {"plate_x_mm": plate[:, 0], "plate_y_mm": plate[:, 1]}
    return robot_of(Tricept("tricept"), arms, [0.0, 0.0, -700.0])


def polar():
    """A polar arm with a hand of 80 mm."""
    table = {"arm0.joint_offset_deg": 2.0, "arm1.joint_offset_mm": 30.0}
    table |= {"arm2.joint_offset_deg": -1.0, "hand_mm": 80.0}
    return Kinematics.of(Polar("polar").with_home(np.array([250.0, 20.0, 0.0])), table)


def turned(turns, places):
    """Places (n, 3) turned by rotation vectors (N, 3), (N, n, 3)."""
    return np.stack(turned_by(turns, list(places.T)), axis=-1)
