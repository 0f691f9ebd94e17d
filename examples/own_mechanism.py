# %% [markdown]
# # A mechanism of one's own
# A planar robot with three cranks, forearms and a platform that turns (3-RRR), stated by its
# closures alone. Kinematics, Jacobians, plan and identification follow. Every step of it:
# docs/how-to/own-mechanism.md.

# %%
import numpy as np

from pkmcal import (
    PLANE,
    TURN,
    ImplicitMechanism,
    Limits,
    ParameterField,
    RobotFile,
    place_fields,
    plan,
    study,
    transmission_fields,
)


class ThreeCranks(ImplicitMechanism):
    """Three forearms between elbows and a platform: |X + R b_i - elbow_i| = forearm_i."""

    joint_kinds = ("revolute",) * 3
    task_axes = (*PLANE, TURN)
    arm_fields = (
        *place_fields("the motor, mm")[:2],
        ParameterField("joint_offset_deg", "crank less reading, deg", "angle", "offsets"),
        ParameterField("arm_mm", "the crank's length, mm", "length", "lengths"),
        ParameterField("forearm_mm", "the forearm's length, mm", "length", "lengths"),
        ParameterField("plate_x_mm", "x of the joint on the platform, mm", "place", "plate"),
        ParameterField("plate_y_mm", "y of the joint on the platform, mm", "place", "plate"),
        *transmission_fields("deg", "gear"),
    )

    def misfit(self, fields, joints, pose):
        x, y = self.from_motors(fields, pose)
        x, y = x - fields["arm"] * np.cos(joints), y - fields["arm"] * np.sin(joints)
        return (x**2 + y**2 - fields["forearm"] ** 2) / (2.0 * fields["forearm"])

    def first_joints(self, fields, poses):
        x, y = self.from_motors(fields, poses)
        far, arm, forearm = np.hypot(x, y), fields["arm"], fields["forearm"]
        return np.arctan2(y, x) + np.arccos((far**2 + arm**2 - forearm**2) / (2.0 * far * arm))

    def first_pose(self, fields, joints):
        return self.home_poses(joints)

    def from_motors(self, fields, pose):
        c, s, u, v = (
            np.cos(pose[..., 2:]),
            np.sin(pose[..., 2:]),
            fields["plate_x"],
            fields["plate_y"],
        )
        x, y = pose[..., :1] + c * u - s * v, pose[..., 1:2] + s * u + c * v
        return x - fields["x"], y - fields["y"]


THREE_CRANKS = ThreeCranks("3-rrr")

# %% [markdown]
# In a robot file it is `mechanism: my.py:THREE_CRANKS`, or the word of a package's entry point:
#
#     [project.entry-points."pkmcal.mechanisms"]
#     3-rrr = "my_package:THREE_CRANKS"
#
# Limits are of joints, and of x, y, z and theta; z never moves.

# %%
values = {}
for arm, direction in enumerate(np.radians([90.0, 210.0, 330.0])):
    x, y = np.cos(direction), np.sin(direction)
    sizes = {"x_mm": 300.0 * x, "y_mm": 300.0 * y, "plate_x_mm": 60.0 * x, "plate_y_mm": 60.0 * y}
    sizes |= {"joint_offset_deg": 0.0, "arm_mm": 150.0, "forearm_mm": 180.0}
    values |= {f"arm{arm}.{key}": value for key, value in sizes.items()}
limits = Limits(
    (-2.0 * np.pi, 2.0 * np.pi), ((-40.0, 40.0), (-40.0, 40.0), (0.0, 0.0), (-0.2, 0.2))
)
robot = RobotFile.of(THREE_CRANKS, values, name="my 3-RRR", limits=limits)
pose = [30.0, -20.0, 0.0, 0.2]
print(np.degrees(robot.kinematics.inverse(pose).values_or_raise()))

# %%
tracker_mm = (1500.0, -300.0, 200.0)
made = plan(robot, tracker_mm, shots=24, validation_pairs=4, seed=3)
print(made)
print(study(robot, made.shots, tracker_mm, campaigns=8, seed=1))
made.plot().savefig("plan.svg")
