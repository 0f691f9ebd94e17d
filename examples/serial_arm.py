# %% [markdown]
# # A serial arm with six joints
# Denavit and Hartenberg's parameters, and a small turn `beta` about y, which parallel axes need
# (Hayati 1983): two that are a little out of parallel meet far away, where no `d` is near nominal.
#
# The closures say that the pose is the one to which the joints lead. Sizes are those of a UR10. Its
# flange is turned over by the last `alpha`, so that a tool that points down is not turned at home.

# %%
import numpy as np
from scipy.spatial.transform import Rotation

from pkmcal import (
    POSITION,
    TURNS,
    ImplicitMechanism,
    Limits,
    ParameterField,
    RobotFile,
    Role,
    closures,
    matrices_of,
    plan,
    transmission_fields,
    turn_between,
)

# Joints from which the inverse is searched: shoulder, elbow and wrist bend as here.
READY_DEG = [0.0, -100.0, -100.0, -70.0, 90.0, 0.0]
D_MM, A_MM = [127.3, 0.0, 0.0, 163.9, 115.7, 92.2], [0.0, -612.0, -572.3, 0.0, 0.0, 0.0]
ALPHA_DEG = [90.0, 0.0, 0.0, 90.0, -90.0, 180.0]


class SerialArm(ImplicitMechanism):
    """Links by Rz(q) Tz(d) Tx(a) Rx(alpha) Ry(beta), one after the other."""

    joint_kinds = ("revolute",) * 6
    task_axes = (*POSITION, *TURNS)
    arm_fields = (
        ParameterField("d_mm", "the way along the joint's axis, mm", "place", "plate_joints"),
        ParameterField("a_mm", "the way to the next axis, mm", "place", "plate_joints"),
        ParameterField("alpha_deg", "the next axis turned about x, deg", "angle", "azimuths"),
        ParameterField("beta_deg", "and about y, deg", "small angle", "axes", Role.EXTENSION),
        ParameterField("joint_offset_deg", "angle less reading, deg", "angle", "offsets"),
        *transmission_fields("deg", "gear"),
    )

    def misfit(self, fields, joints, pose):
        place, frame = flange(fields, joints)
        turn = turn_between(frame, matrices_of(pose[..., 3:]))
        return closures(pose[..., :3] - place, self.lever_mm * turn)

    def first_joints(self, fields, poses):
        return np.tile(np.radians(READY_DEG), (len(poses), 1))

    def first_pose(self, fields, joints):
        place, frame = flange(fields, joints)
        return np.hstack([place, Rotation.from_matrix(frame).as_rotvec()])


def flange(fields, joints):
    """Place (…, N, 3) and axes (…, N, 3, 3) of the flange."""
    place, (x, y, z) = np.zeros(3), np.eye(3)
    for k in range(6):
        d, a, alpha, beta = (fields[key][..., k, None] for key in ("d", "a", "alpha", "beta"))
        x, y = _turned(x, y, joints[..., k, None])
        place = place + a * x + d * z
        y, z = _turned(y, z, alpha)
        z, x = _turned(z, x, beta)
    return place, np.stack(np.broadcast_arrays(x, y, z), axis=-1)


# Two axes (…, 3) of a frame that turns by an angle from the first towards the second.
def _turned(first, second, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return cos * first + sin * second, cos * second - sin * first


SERIAL_ARM = SerialArm("serial-arm")

# %% [markdown]
# A box of poses about those of the ready joints, mm and rad.

# %%
sizes = {"d_mm": D_MM, "a_mm": A_MM, "alpha_deg": ALPHA_DEG, "joint_offset_deg": [0.0] * 6}
values = {f"arm{k}.{key}": value for key, each in sizes.items() for k, value in enumerate(each)}
box = ((550.0, 950.0), (-350.0, 50.0), (250.0, 650.0), (-0.5, 0.5), (-0.5, 0.5), (-2.1, -1.0))
robot = RobotFile.of(SERIAL_ARM, values, name="ur10", limits=Limits((-6.3, 6.3), box))
if __name__ == "__main__":
    print(plan(robot, tracker_mm=(2500.0, -300.0, 450.0), shots=60, seed=3))
