"""Convert a robot file to URDF: platform and arms as a tree, in m and rad.

    python urdf.py robot-compensated.yaml > robot.urdf

The platform hangs on joints of its own; loops are comments, tilts and gears are left out.
"""

import sys
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from pkmcal import find_robot

OF_ARM = "x_mm y_mm z_mm azimuth_deg joint_offset_deg joint_offset_mm elevation_deg"
ANY_M, ANY_RAD = (-10.0, 10.0), (-np.pi, np.pi)
STILL, (X, Y, Z) = np.zeros(3), np.eye(3)


def numbers(values):
    """Return numbers as URDF writes them."""
    return " ".join(f"{value + 0.0:.9g}" for value in values)


def joint(name, parent, kind="fixed", place_mm=STILL, rpy=STILL, axis=X, limits=ANY_RAD, more=""):
    """Return the text of a link, and of the joint that holds it."""
    moves = f'<axis xyz="{numbers(axis)}"/><limit lower="{limits[0]:.9g}" upper="{limits[1]:.9g}" '
    return f"""  <link name="{name}"/>
  <joint name="{name}_joint" type="{kind}">
    <parent link="{parent}"/><child link="{name}"/>
    <origin xyz="{numbers(1e-3 * place_mm)}" rpy="{numbers(rpy)}"/>
    {"" if kind == "fixed" else moves + f'effort="0" velocity="0"/>{more}'}
  </joint>"""


def arm_joint(arm, own, robot):
    """Return the text of a motor's or a carriage's joint."""
    x, y, z, azimuth, offset_deg, offset_mm, elevation = (
        own.get(f"arm{arm}.{name}", 0.0) for name in OF_ARM.split()
    )
    name, place_mm, limits = f"arm{arm}", np.array([x, y, z]), robot.limits.joint
    if robot.mechanism.joints[arm].is_revolute:
        turn = Rotation.from_euler("ZY", [azimuth, offset_deg], degrees=True)
        return joint(name, "base", "revolute", place_mm, turn.as_euler("xyz"), Y, limits)
    rail = Rotation.from_euler("ZY", [azimuth, -elevation], degrees=True).apply(X)
    place_mm, limits = place_mm + offset_mm * rail, np.multiply(limits, 1e-3)
    return joint(name, "base", "prismatic", place_mm, axis=rail, limits=limits)


def urdf(robot):
    """Return the robot's description."""
    mechanism, own = robot.mechanism, robot.kinematics.controlled.parameters
    parts = [f'<?xml version="1.0"?>\n<robot name={quoteattr(robot.name)}>\n  <link name="base"/>']
    for name, parent, axis in (("x", "base", X), ("y", "x", Y), ("z", "y", Z)):
        parts.append(joint(name, parent, "prismatic", axis=axis, limits=ANY_M))
    if len(mechanism.task) > 3:
        limits = robot.limits.task[3] or ANY_RAD
        parts.append(joint("theta", "z", "revolute", axis=Z, limits=limits))
    length = np.array([[sum(own[field.name] for field in mechanism.parameters.platform_fields())]])
    turns = np.array([[0.0], [1.0]])  # rad: joints of the platform turn with it, or slide along x
    places = mechanism.platform.offsets(length, turns)
    stills, turned = np.broadcast_to(places, (3, 2, len(mechanism.joints))).transpose(1, 2, 0)
    for arm, still in enumerate(stills):
        parent = "theta" if still.any() else "z"
        if turned[arm].any() and not still.any():
            parent, slide = f"bar{arm}", f'multiplier="{1e-3 * turned[arm, 0]}"'
            follows = f'<mimic joint="theta_joint" {slide}/>'
            parts.append(joint(parent, "z", "prismatic", limits=ANY_M, more=follows))
        parts += [joint(f"plate{arm}", parent, place_mm=still), arm_joint(arm, own, robot)]
        crank_mm, forearm_mm = own.get(f"arm{arm}.arm_mm", 0.0), own[f"arm{arm}.forearm_mm"]
        parts.append(joint(f"lift{arm}", f"arm{arm}", "revolute", crank_mm * X, axis=Y))
        parts.append(joint(f"forearm{arm}", f"lift{arm}", "revolute", axis=Z))
        parts.append(joint(f"end{arm}", f"forearm{arm}", place_mm=forearm_mm * X))
        parts.append(f"  <!-- loop closure: end{arm} is in plate{arm} -->")
    return "\n".join([*parts, "</robot>", ""])


if __name__ == "__main__":
    sys.stdout.write(urdf(find_robot(sys.argv[1])))
