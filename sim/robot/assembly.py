"""The controller's own inverse kinematics, by triangles in each arm's plane."""

import math
from dataclasses import dataclass

import numpy as np

from sim.errors import AssemblyLost
from sim.geometry import ARMS, Array, Geometry
from sim.robot.rods import SETTLED_MM, EightRods, Plate


class OutOfReach(Exception):
    """The forearm of `arm` cannot be put between its elbow and the plate."""

    def __init__(self, arm: int) -> None:
        super().__init__(f"arm {arm} cannot reach")
        self.arm = arm


def plate_joints_mm(geometry: Geometry, position_mm: Array, theta_rad: float) -> Array:
    """(4, 3): B'_i in the base frame (paper, eq. 9)."""
    h = geometry.plate_mm
    bar_mm = np.array([-h * math.sin(theta_rad), h * math.cos(theta_rad), 0.0])
    return np.array([position_mm, position_mm, position_mm + bar_mm, position_mm + bar_mm])


def joints_for(geometry: Geometry, position_mm: Array, theta_rad: float) -> Array:
    """(4,) encoder angles, rad, with every elbow outward; raises `OutOfReach`."""
    to_plate_mm = plate_joints_mm(geometry, position_mm, theta_rad) - geometry.motors_mm
    return np.array([_joint(geometry, arm, to_plate_mm[arm]) for arm in range(ARMS)])


def _joint(geometry: Geometry, arm: int, to_plate_mm: Array) -> float:
    """The arm's angle is the angle down to the plate joint less the triangle's angle at the motor.

    The triangle is motor, elbow, plate joint in the arm's plane; the forearm counts there with
    what its swing out of the plane leaves of it.
    """
    arm_mm = float(geometry.arms_mm[arm])
    outward_mm = float(to_plate_mm @ geometry.outward[arm])
    swing_mm = float(to_plate_mm @ geometry.sideways[arm])
    squared_in_plane = float(geometry.forearms_mm[arm]) ** 2 - swing_mm**2
    base_mm = math.hypot(outward_mm, float(to_plate_mm[2]))
    if squared_in_plane < 0.0 or base_mm == 0.0:
        raise OutOfReach(arm)
    cosine = (arm_mm**2 + base_mm**2 - squared_in_plane) / (2.0 * arm_mm * base_mm)
    if not -1.0 <= cosine <= 1.0:
        raise OutOfReach(arm)
    down_rad = math.atan2(-float(to_plate_mm[2]), outward_mm)
    angle_rad = down_rad - math.acos(cosine) - float(geometry.joint_offsets_rad[arm])
    return math.remainder(angle_rad, 2.0 * math.pi)


STEP_RAD = math.radians(5.0)
SMALLEST_STEP_RAD = math.radians(0.05)
ON_THE_WAY_MM = 0.1
"""Tolerance of the plate between the ends of a motion, where only the way matters."""
MISFIT_LIMIT_MM = 2.0
"""Rods that miss by more are not strained but torn: the gap is closed by no assembly."""
JUMP_LIMIT_MM = 100.0
"""Jump of the plate beyond any within one assembly at a joint step of `STEP_RAD`."""


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """Solved state of the mechanism. `side` tells two assemblies of the same joints apart."""

    joints: Array
    plate: Plate
    side: float


def assemble(
    rods: EightRods, truth: Geometry, position_mm: Array, theta_rad: float, growth: float
) -> Assembly:
    """Assembly of the robot at a pose by its contracted geometry, |θ| < 90°.

    Raises `sim.robot.assembly.OutOfReach` or `AssemblyLost`.
    """
    joints = joints_for(truth, position_mm, theta_rad)
    guess = Plate(np.array([*position_mm, 0.0, 0.0, 0.0, theta_rad]))
    return restore(rods, joints, guess, growth)


def restore(rods: EightRods, joints: Array, guess: Plate, growth: float) -> Assembly:
    """The assembly at known joints and an almost exactly known plate; raises `AssemblyLost`."""
    plate, misfits_mm, jacobian = rods.settle(joints, growth, guess)
    if not _is_whole(plate, misfits_mm):
        raise _lost(joints, 0.0)
    return Assembly(joints, plate, _side(jacobian))


def follow(rods: EightRods, start: Assembly, target_rad: Array, growth: float) -> Assembly:
    """Move the joints in a straight line to the target, in steps small enough to stay assembled.

    Raises `AssemblyLost` with the part of the line that could be followed.
    """
    change_rad = target_rad - start.joints
    length_rad = float(np.abs(change_rad).max())
    if length_rad == 0.0:
        return restore(rods, target_rad, start.plate, growth)
    here, part, step = start, 0.0, STEP_RAD / length_rad
    while part < 1.0:
        tried = min(part + step, 1.0)
        at_end = tried == 1.0
        joints = target_rad if at_end else start.joints + tried * change_rad
        settled_mm = SETTLED_MM if at_end else ON_THE_WAY_MM
        reached = _step(rods, here, joints, growth, settled_mm)
        if reached is not None:
            here, part, step = reached, tried, STEP_RAD / length_rad
        elif step * length_rad > SMALLEST_STEP_RAD:
            step *= 0.5
        else:
            raise _lost(joints, part)
    return here


def _step(
    rods: EightRods, here: Assembly, joints: Array, growth: float, settled_mm: float
) -> Assembly | None:
    """Assembly after one step of the joints, or nothing when the step may have left it."""
    try:
        plate, misfits_mm, jacobian = rods.settle(joints, growth, here.plate, settled_mm)
    except AssemblyLost:
        return None
    jump_mm = float(np.abs(plate.position_mm - here.plate.position_mm).max())
    is_same = _side(jacobian) == here.side and jump_mm < JUMP_LIMIT_MM
    if not is_same or not _is_whole(plate, misfits_mm):
        return None
    return Assembly(joints, plate, here.side)


def _is_whole(plate: Plate, misfits_mm: Array) -> bool:
    """Whether the rods reach and the bar has not turned over."""
    return bool(np.abs(misfits_mm).max() < MISFIT_LIMIT_MM) and math.cos(plate.theta_rad) > 0.0


def _side(jacobian: Array) -> float:
    """The sign of the forearms' determinant by x, y, z and θ: changes only in a singularity."""
    forearms = jacobian.reshape(ARMS, 2, 7).sum(axis=1)[:, [0, 1, 2, 6]]
    return float(np.sign(np.linalg.det(forearms)))


def _lost(joints: Array, part: float) -> AssemblyLost:
    angles = ", ".join(f"{angle:.2f}°" for angle in np.degrees(joints))
    return AssemblyLost(
        f"no assembly of the robot at joints {angles} ({part:.0%} of the way)",
        remedy="choose a target, and a way to it, inside the robot's workspace",
        part=part,
    )
