"""Five-bar: two cranks in a plane, whose forearms meet in the controlled point."""

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array
from campaigns.kinematics.axes import PLANE
from campaigns.kinematics.implicit import ImplicitMechanism
from campaigns.kinematics.limbs import FOREARM, Fields, transmission_fields
from campaigns.kinematics.parameters import ParameterField


class FiveBar(ImplicitMechanism):
    """Two cranks and two forearms: |X - elbow_i| = forearm_i in the plane of the base's x and y.

    The first crank's elbow is on the left of the way to the point, the second's on the right, and
    the point on the left of the way from elbow 0 to elbow 1.
    """

    joint_kinds = ("revolute", "revolute")
    task_axes = PLANE
    arm_fields = (
        ParameterField("x_mm", "x of the motor in the base frame, mm", "place", "places"),
        ParameterField("y_mm", "y of the motor in the base frame, mm", "place", "places"),
        ParameterField(
            "joint_offset_deg", "the crank's direction less the encoder's reading, deg", "angle",
            "offsets",
        ),
        ParameterField("arm_mm", "the crank's length, mm", "length", "lengths"),
        FOREARM,
        *transmission_fields("deg", "gear"),
    )  # fmt: skip

    @override
    def misfit(self, fields: Fields, joints: Array, pose: Array) -> Array:
        (x, y), forearm = _elbows(fields, joints), fields["forearm"]
        squares = (pose[..., :1] - x) ** 2 + (pose[..., 1:] - y) ** 2
        return np.asarray((squares - forearm**2) / (2.0 * forearm))

    # The triangle of motor, elbow and point: the angle at the motor by the law of cosines.
    @override
    def first_joints(self, fields: Fields, poses: Array) -> Array:
        dx, dy = poses[:, :1] - fields["x"], poses[:, 1:] - fields["y"]
        apart, arm = np.hypot(dx, dy), fields["arm"]
        at_motor = np.arccos((apart**2 + arm**2 - fields["forearm"] ** 2) / (2.0 * apart * arm))
        return np.asarray(np.arctan2(dy, dx) + np.array([1.0, -1.0]) * at_motor)

    # With m the middle of the elbows, d between them and forearms of length L on both sides, the
    # point is √(L² - d²/4) beside m.
    @override
    def first_pose(self, fields: Fields, joints: Array) -> Array:
        x, y = _elbows(fields, joints)
        dx, dy = x[:, 1] - x[:, 0], y[:, 1] - y[:, 0]
        apart, forearm = np.hypot(dx, dy), fields["forearm"].mean()
        aside = np.sqrt(np.maximum(forearm**2 - apart**2 / 4.0, 1e-4 * forearm**2)) / apart
        return np.stack([x.mean(axis=1) - dy * aside, y.mean(axis=1) + dx * aside], axis=1)


def _elbows(fields: Fields, joints: Array) -> tuple[Array, Array]:
    """Return x and y (…, N, 2) of the elbows."""
    arm = fields["arm"]
    return fields["x"] + arm * np.cos(joints), fields["y"] + arm * np.sin(joints)
