"""The controller's own inverse kinematics, by triangles, and assemblies on their way.

1. `joints_for` is what a plain controller computes for a pose: a triangle in each arm's plane. The
   estimator solves an equation in sine and cosine of the joint, and the simulated robot is found
   from its rods: this is a third way.
2. `assemble`, `restore` and `follow` keep the true robot in its assembly. One set of joints has
   several real assemblies; a robot changes from one to another only through a singularity. So the
   joints are moved in small steps, each solved from the one before, and a step is accepted only if
   the plate did not jump, the rods reach, and the sign of the forearms' determinant has stayed.
"""

import math
from dataclasses import dataclass

import numpy as np

from sim.errors import AssemblyLost
from sim.geometry import HINGE, Array, Geometry, Kind
from sim.robot.rods import COLD, SETTLED_MM, Growth, Mechanism, Plate, RodMechanism, Settled


class OutOfReach(Exception):
    """The forearm of `arm` cannot be put between its elbow and the plate."""

    def __init__(self, arm: int) -> None:
        super().__init__(f"arm {arm} cannot reach")
        self.arm = arm


def plate_joints_mm(geometry: Geometry, position_mm: Array, theta_rad: float) -> Array:
    """Return the contracted plate joints B'_i (n, 3) in the base frame (paper, eq. 9)."""
    return np.asarray(position_mm + geometry.plate_joints_apart(theta_rad)[0])


def joints_for(geometry: Geometry, position_mm: Array, theta_rad: float) -> Array:
    """Return (n,) encoder values, elbows outward, carriages above; raises `OutOfReach`."""
    to_plate_mm = plate_joints_mm(geometry, position_mm, theta_rad) - geometry.motors_mm
    joint_for = _carriage if geometry.kind.on_rails else _crank
    return np.array([joint_for(geometry, arm, way) for arm, way in enumerate(to_plate_mm)])


def _carriage(geometry: Geometry, arm: int, to_plate_mm: Array) -> float:
    """Return the joint of a carriage above the plate, or outside it on a nearly level rail."""
    # Right triangle of carriage, plate joint and the foot of its perpendicular on the rail. The
    # carriage stands on either side of the foot: above it, or farther outward where the rail is
    # within 15° of level.
    rail = geometry.rails[arm]
    foot_mm = float(to_plate_mm @ rail)
    squared_off_rail = float(np.sum(np.cross(to_plate_mm, rail) ** 2))
    squared_above = float(geometry.forearms_mm[arm]) ** 2 - squared_off_rail
    if squared_above < 0.0:
        raise OutOfReach(arm)
    is_level = abs(float(rail[2])) < math.sin(math.radians(15.0))
    way = float(rail @ geometry.outward[arm] if is_level else rail[2])
    side = 1.0 if way > -1e-9 else -1.0
    return foot_mm + side * math.sqrt(squared_above) - float(geometry.joint_offsets[arm])


def _crank(geometry: Geometry, arm: int, to_plate_mm: Array) -> float:
    """Return the encoder angle of a crank whose elbow is outward of its plate joint."""
    # Triangle of motor, elbow and plate joint, projected into the arm's plane, where the forearm is
    # shortened by its swing out of that plane. By the law of cosines the crank stands above the
    # line from motor to plate joint by the triangle's angle at the motor.
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
    angle_rad = down_rad - math.acos(cosine) - float(geometry.joint_offsets[arm])
    return math.remainder(angle_rad, 2.0 * math.pi)


STEP_RAD = math.radians(5.0)
"""First step of a path, of cranks; of carriages the travel that compares with it."""
SMALLEST_STEP_RAD = math.radians(0.05)
ON_THE_WAY_MM = 0.1
"""Tolerance of the plate between the ends of a motion, where only the assembly matters."""
MISFIT_LIMIT_MM = 2.0
"""Misfit beyond any strain of rods: the gap is not closed by any assembly."""
JUMP_LIMIT_MM = 100.0
"""Jump of the plate beyond any within one assembly at a joint step of `STEP_RAD`."""


@dataclass(frozen=True, slots=True, eq=False)
class Assembly:
    """Solved state of the mechanism; `side` distinguishes two assemblies of the same joints."""

    joints: Array
    """(n,) rad or mm"""
    plate: Plate
    side: float


def assemble(
    mechanism: RodMechanism,
    truth: Geometry,
    position_mm: Array,
    theta_rad: float,
    growth: Growth = COLD,
) -> Assembly:
    """Assemble the robot at a pose by its contracted geometry, |θ| < 90°.

    Raises `sim.robot.assembly.OutOfReach` or `AssemblyLost`.
    """
    joints = joints_for(truth, position_mm, theta_rad)
    guess = Plate.level(mechanism.kind, position_mm, theta_rad)
    return restore(mechanism, joints, guess, growth)


def restore(mechanism: Mechanism, joints: Array, guess: Plate, growth: Growth = COLD) -> Assembly:
    """Solve the assembly at joints near a plate's guess; raises `AssemblyLost`."""
    settled = mechanism.settle(joints, guess, growth)
    if not _is_whole(mechanism.kind, settled):
        raise _assembly_lost(mechanism.kind, joints, 0.0)
    return Assembly(joints, settled.plate, mechanism.side(settled.jacobian))


def follow(mechanism: Mechanism, start: Assembly, target: Array, growth: Growth = COLD) -> Assembly:
    """Move the joints in a straight line to the target, in steps small enough to stay assembled.

    Raises `AssemblyLost` with the part of the line that could be followed.
    """
    # A step that fails is halved, since a long one may have jumped to another assembly; below
    # `SMALLEST_STEP_RAD` the way is closed. After a success the full step is tried again.
    change = target - start.joints
    length_rad = float((np.abs(change) / mechanism.kind.scales).max())
    if length_rad == 0.0:
        return restore(mechanism, target, start.plate, growth)
    assembly, part, step = start, 0.0, STEP_RAD / length_rad
    while part < 1.0:
        tried = min(part + step, 1.0)
        at_end = tried == 1.0
        joints = target if at_end else start.joints + tried * change
        settled_mm = SETTLED_MM if at_end else ON_THE_WAY_MM
        candidate = _step(mechanism, assembly, joints, growth, settled_mm)
        if candidate is not None:
            assembly, part, step = candidate, tried, STEP_RAD / length_rad
        elif step * length_rad > SMALLEST_STEP_RAD:
            step *= 0.5
        else:
            raise _assembly_lost(mechanism.kind, joints, part)
    return assembly


def _step(
    mechanism: Mechanism, here: Assembly, joints: Array, growth: Growth, settled_mm: float
) -> Assembly | None:
    """Return the assembly after one step of the joints; None when the step may have left it."""
    try:
        settled = mechanism.settle(joints, here.plate, growth, settled_mm)
    except AssemblyLost:
        return None
    jump_mm = float(np.abs(settled.plate.position_mm - here.plate.position_mm).max())
    is_same = mechanism.side(settled.jacobian) == here.side and jump_mm < JUMP_LIMIT_MM
    if not is_same or not _is_whole(mechanism.kind, settled):
        return None
    return Assembly(joints, settled.plate, here.side)


def _is_whole(kind: Kind, settled: Settled) -> bool:
    """Whether the rods reach and a hinged platform has not turned over."""
    turned_over = kind.turn is HINGE and math.cos(settled.plate.theta_rad) <= 0.0
    return bool(np.abs(settled.misfits_mm).max() < MISFIT_LIMIT_MM) and not turned_over


def _assembly_lost(kind: Kind, joints: Array, part: float) -> AssemblyLost:
    """Return the error of joints without assembly, after a part of the way to them."""
    return AssemblyLost(
        f"no assembly of the robot at joints {kind.listed(joints, '.2f')} ({part:.0%} of the way)",
        remedy="choose a target, and a way to it, inside the robot's workspace",
        part=part,
    )
