"""Convert a robot file of a delta or linear-delta to the keys of Klipper's configuration.

    python klipper.py robot-compensated.yaml > delta.cfg

For printers `pkmcal export DIR --format klipper` does it, level to the bed; this is for robot files
without a campaign, and for Deltas with cranks.

Klipper knows fewer parameters: its values are those that leave the least mean square error of
position over the workspace, its frame being wherever it fits best. Switches are taken to be at the
end of the joints' range where arms or carriages are highest, z = 0 at the lowest pose.
"""

import math
import sys

import numpy as np
from scipy.optimize import least_squares

from pkmcal import Kinematics, find_robot, fit_transform, sample_workspace

ROTARY = {"delta": True, "linear-delta": False}
HELD = {True: [7], False: [1, 2, 3, 7, 10]}  # the frame's turn; of carriages cranks and height


def symmetric(mechanism, values):
    """Return the robot of Klipper's values: radius; cranks, forearms, angles, offsets by arm."""
    flat = dict.fromkeys(mechanism.parameters.of_robot, 0.0)
    for arm, (crank, forearm, angle, offset) in enumerate(values[1:].reshape(4, 3).T.tolist()):
        own = {"x_mm": values[0] * math.cos(angle), "y_mm": values[0] * math.sin(angle)}
        own |= {"azimuth_deg": math.degrees(angle), "forearm_mm": forearm}
        if ROTARY[mechanism.name]:
            own |= {"arm_mm": crank, "joint_offset_deg": math.degrees(offset)}
        else:
            own |= {"elevation_deg": 90.0, "joint_offset_mm": offset}
        flat |= {f"arm{arm}.{name}": float(value) for name, value in own.items()}
    return Kinematics.of(mechanism, flat)


def klipper_keys(robot):
    """Return the configuration, and the mean error of position that its values leave, mm."""
    rotary, own = ROTARY[robot.mechanism.name], robot.parameters
    poses = sample_workspace(robot, 300)
    joints = robot.kinematics.inverse(poses).values_or_raise()
    x, y, cranks, forearms = (
        np.array([own.get(f"arm{arm}.{name}_mm", 0.0) for arm in range(3)])
        for name in ("x", "y", "arm", "forearm")
    )
    values = np.hstack([np.hypot(x, y).mean(), cranks, forearms, np.arctan2(y, x), np.zeros(3)])
    free = np.setdiff1d(np.arange(len(values)), HELD[rotary])

    def errors(some):
        values[free] = some
        points = symmetric(robot.mechanism, values).forward(joints, poses).values_or_raise()
        return fit_transform(points[:, :3], poses[:, :3]).apply(points[:, :3]) - poses[:, :3]

    found = least_squares(lambda some: errors(some).ravel(), values[free], x_scale="jac")
    left_mm = float(np.linalg.norm(errors(found.x), axis=1).mean())
    lowest = symmetric(robot.mechanism, values).forward(joints, poses).values[:, 2].min()
    radius, endstop = values[0], robot.limits.joint[0 if rotary else 1]
    lines = ["[printer]", f"kinematics: {'rotary_delta' if rotary else 'delta'}"]
    if rotary:
        lines += [f"shoulder_radius: {radius:.6f}", f"shoulder_height: {-lowest:.6f}"]
    else:
        lines += [f"delta_radius: {radius:.6f}"]
    for arm, (crank, forearm, angle, offset) in enumerate(values[1:].reshape(4, 3).T):
        lines += ["", f"[stepper_{'abc'[arm]}]", f"angle: {math.degrees(angle) % 360:.6f}"]
        if rotary:
            reading = endstop + offset
            out, height = radius + crank * math.cos(reading), -lowest - crank * math.sin(reading)
            lines += [f"upper_arm_length: {crank:.6f}", f"lower_arm_length: {forearm:.6f}"]
        else:
            out, height = radius, endstop + offset - lowest
            lines += [f"arm_length: {forearm:.6f}"]
        lines += [f"position_endstop: {height - math.sqrt(forearm**2 - out**2):.6f}"]
    return "\n".join([*lines, ""]), left_mm


if __name__ == "__main__":
    text, mean_mm = klipper_keys(find_robot(sys.argv[1]))
    sys.stdout.write(f"# left of position over the workspace: {mean_mm:.4f} mm on average\n{text}")
