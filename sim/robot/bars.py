"""Platforms that turn freely or move in a plane: held by bars, or placed by outside equations.

Theory of operation. A robot of bars is bodies with points fixed to them, and distances of points:

1. each joint moves its arm's body: it shifts a carriage along its rail, or turns a crank about z.
   The upper end of the arm's bar is fixed to that body, the lower end to the platform;
2. the platform is a body of six coordinates, of which a `BarKind` leaves some free;
3. each bar's misfit is the distance of its ends less its length: its own, or, of a leg, the joint.
   Gauss-Newton by the unit vectors along the bars finds the platform near a guess. A turn is taken
   after the turns before it, by quaternions; no derivative of a rotation vector occurs.

The estimator closes squares of distances, divided by lengths, with complex steps. With perfect
parts both describe one mechanism, which a test holds to 1e-9 mm; that test is all they share.

A mechanism of which there is no such twin is placed by the `Equations` that the caller hands in. A
campaign on it tests plan, files and σ; it cannot test the equations, which are the estimator's.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from typing_extensions import override

from sim.errors import SimError
from sim.geometry import ON_PLATFORM, PLACES, Array, BarKind, Kind
from sim.robot.assembly import OutOfReach
from sim.robot.rods import (
    COLD,
    MOST_ITERATIONS,
    RADIAN_AS_MM,
    SETTLED_MM,
    Z_INDEX,
    Growth,
    Mechanism,
    Plate,
    Settled,
    turned,
    unsettled,
)

LIFT_STEP = 1e-4
"""Step of a joint for the derivative of the platform's height, rad; of carriages times a scale."""
LEVEL = math.sin(math.radians(5.0))
"""Slope below which a rail has no upper end."""


@dataclass(frozen=True, slots=True, eq=False)
class TurningPlate(Plate):
    """Platform by x, y, z in mm and a rotation vector in rad, of a platform in a plane with 0."""

    @property
    def rotation(self) -> Array:
        """(3, 3): base_from_plate."""
        angle_rad = float(np.linalg.norm(self.unknowns[3:]))
        if angle_rad == 0.0:
            return np.eye(3)
        axes = np.tile(self.unknowns[3:] / angle_rad, (3, 1))
        return np.asarray(turned(np.eye(3), axes, np.full(3, angle_rad)).T)

    def moved(self, shift_mm: Array, turn_rad: Array) -> "TurningPlate":
        """Return the platform after a shift (3,) and a turn (3,) about the base's axes."""
        # the product of two unit quaternions: (s, v)(t, w) = (st - v·w, sw + tv + v×w)
        (s, v), (t, w) = _quaternion(turn_rad), _quaternion(self.unknowns[3:])
        scalar, vector = s * t - v @ w, s * w + t * v + np.cross(v, w)
        length = float(np.linalg.norm(vector))
        factor = 2.0 if length == 0.0 else 2.0 * math.atan2(length, scalar) / length
        return TurningPlate(np.concatenate([self.unknowns[:3] + shift_mm, factor * vector]))


def _quaternion(turn_rad: Array) -> tuple[float, Array]:
    """Return scalar and vector (3,) of the unit quaternion of a rotation vector (3,)."""
    # np.sinc(x) is sin(πx) / πx, and 1 at 0
    half_rad = 0.5 * float(np.linalg.norm(turn_rad))
    return math.cos(half_rad), 0.5 * np.sinc(half_rad / math.pi) * turn_rad


class Equations(Protocol):
    """Equations of one robot, from outside; poses (6,) are x, y, z in mm and a rotation vector."""

    def pose(self, joints: Array, near: Array) -> Array:
        """Return the pose (6,) of joints (n,), close to another one; NaN without an assembly."""

    def joints(self, pose: Array) -> Array:
        """Return the joints (n,) of a pose (6,); NaN out of reach."""


EquationsOf = Callable[[Mapping[str, float]], Equations]
"""Returns the equations of a robot by its parameters, flat names, mm and deg."""


class FreeMechanism(Mechanism):
    """Mechanism whose platform is one body, and its inverse."""

    def __init__(self, kind: Kind) -> None:
        self.kind = kind

    @abstractmethod
    def joints_for(self, pose: Array) -> Array:
        """Return the joints (n,) of a pose (6,); raises `OutOfReach`."""

    @override
    def side(self, jacobian: Array) -> float:
        # the sign of the misfits' determinant; 1 where there is none
        rows, columns = jacobian.shape
        return float(np.sign(np.linalg.det(jacobian))) if rows == columns else 1.0

    @override
    def plate_of(self, unknowns: Array) -> Plate:
        return TurningPlate(unknowns)

    @override
    def reflector_mm(self, plate: Plate, offset_mm: Array, half: int | None = None) -> Array:
        return np.asarray(plate.position_mm + plate.rotation @ offset_mm)

    @override
    def heights_by_joints(self, joints: Array, plate: Plate) -> tuple[Array, Array]:
        near, whole = np.empty(len(joints)), np.empty(len(joints))
        for joint, step in enumerate(LIFT_STEP * self.kind.scales):
            change = step * np.eye(len(joints))[joint]
            up, down = (self.settle(joints + way, plate).plate for way in (change, -change))
            rise_mm = up.position_mm[Z_INDEX] - down.position_mm[Z_INDEX]
            whole[joint] = rise_mm / (2.0 * step)
            ends_mm = [self._ends_mm(joints + way)[joint, Z_INDEX] for way in (change, -change)]
            near[joint] = (ends_mm[0] - ends_mm[1]) / (2.0 * step)
        return near, whole

    def _ends_mm(self, joints: Array, growth: Growth = COLD) -> Array:  # noqa: ARG002 - none known
        """Return the points (n, 3) that joints move."""
        return np.zeros((len(joints), 3))


class BarMechanism(FreeMechanism):
    """Platform that arms hold by one bar each."""

    def __init__(self, kind: BarKind, flat: Mapping[str, float]) -> None:
        super().__init__(kind)

        def column(field: str) -> Array:
            return np.array([flat.get(f"arm{arm}.{field}", 0.0) for arm in range(kind.arms)])

        units = enumerate(kind.units)
        self._free, self._limbs = list(kind.free), kind.limbs
        self._offsets = kind.inner([flat[f"arm{arm}.joint_offset_{unit}"] for arm, unit in units])
        self._places_mm = np.column_stack([column(field.key) for field in PLACES])
        self._anchors_mm = np.column_stack([column(field.key) for field in ON_PLATFORM])
        self._arms_mm, self._bars_mm = column("arm_mm"), column("forearm_mm")
        azimuth, elevation = np.radians([column("azimuth_deg"), column("elevation_deg")])
        level = np.cos(elevation)
        rails = [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)]
        moves = np.array([limb.moves for limb in kind.limbs])
        self._is_leg = moves == "leg"
        self._rails = np.column_stack(rails) * (moves == "carriage")[:, None]

    @override
    def joints_for(self, pose: Array) -> Array:
        plate = TurningPlate(pose)
        ways_mm = pose[:3] + self._anchors_mm @ plate.rotation.T - self._places_mm
        joints = np.array([self._joint(arm, way_mm) for arm, way_mm in enumerate(ways_mm)])
        return joints - self._offsets

    # A leg is as long as the way. A carriage stands on either side of the foot of the platform's
    # perpendicular on the rail. A crank is beside the way by the angle at the motor of the triangle
    # of crank, bar and way, where the bar is shortened by its rise out of the crank's plane.
    def _joint(self, arm: int, way_mm: Array) -> float:
        """Return the joint, with its offset, by the way from an arm's place to the platform."""
        limb, bar_mm = self._limbs[arm], float(self._bars_mm[arm])
        if limb.moves == "leg":
            return float(np.linalg.norm(way_mm))
        if limb.moves == "carriage":
            rail = self._rails[arm]
            foot_mm = float(way_mm @ rail)
            squared_mm = bar_mm**2 - float(np.sum(np.cross(way_mm, rail) ** 2))
            if squared_mm < 0.0:
                raise OutOfReach(arm)
            upward = -1.0 if rail[Z_INDEX] < -LEVEL else 1.0
            return foot_mm + limb.side * upward * math.sqrt(squared_mm)
        arm_mm, base_mm = float(self._arms_mm[arm]), math.hypot(way_mm[0], way_mm[1])
        squared_mm = arm_mm**2 + base_mm**2 - bar_mm**2 + float(way_mm[Z_INDEX]) ** 2
        if abs(squared_mm) >= 2.0 * arm_mm * base_mm:
            raise OutOfReach(arm)
        beside_rad = math.acos(squared_mm / (2.0 * arm_mm * base_mm))
        return math.atan2(way_mm[1], way_mm[0]) + limb.side * beside_rad

    @override
    def settle(
        self, joints: Array, guess: Plate, growth: Growth = COLD, settled_mm: float = SETTLED_MM
    ) -> Settled:
        # turns are scaled to mm of motion, as for plates of rods
        ends_mm = self._ends_mm(joints, growth)
        spindles_mm = (1.0 + growth.arms) * (joints + self._offsets)
        lengths_mm = np.where(self._is_leg, spindles_mm, (1.0 + growth.forearms) * self._bars_mm)
        plate, per_mm = TurningPlate(guess.unknowns), np.array([1.0] * 3 + [RADIAN_AS_MM] * 3)
        for _ in range(MOST_ITERATIONS):
            anchors_mm = self._anchors_mm @ plate.rotation.T
            gaps_mm = plate.position_mm + anchors_mm - ends_mm
            distances_mm = np.linalg.norm(gaps_mm, axis=1)
            along = gaps_mm / distances_mm[:, None]
            # a turn δ moves a joint at r by δ × r, and along a bar by δ · (r × its unit vector)
            by_pose = np.hstack([along, np.cross(anchors_mm, along)])[:, self._free]
            misfits_mm, step = distances_mm - lengths_mm, np.zeros(6)
            scaled = by_pose / per_mm[self._free]
            step[self._free] = np.linalg.lstsq(scaled, -misfits_mm, rcond=None)[0]
            largest_mm = float(np.abs(step).max())
            step /= per_mm
            plate = plate.moved(step[:3], step[3:])
            if largest_mm < settled_mm:
                return Settled(plate, misfits_mm, by_pose)
        raise unsettled(self.kind, joints)

    @override
    def _ends_mm(self, joints: Array, growth: Growth = COLD) -> Array:
        ways = joints + self._offsets
        cranks = np.column_stack([np.cos(ways), np.sin(ways), np.zeros_like(ways)])
        moved_mm = self._arms_mm[:, None] * cranks + ways[:, None] * self._rails
        return np.asarray((1.0 + growth.frame) * self._places_mm + (1.0 + growth.arms) * moved_mm)


class StatedMechanism(FreeMechanism):
    """Platform that equations from outside place; its parts do not grow warm."""

    def __init__(self, kind: Kind, equations: Equations) -> None:
        super().__init__(kind)
        self._equations = equations

    @override
    def joints_for(self, pose: Array) -> Array:
        joints = self._equations.joints(pose)
        if not np.isfinite(joints).all():
            raise OutOfReach(0)  # no single arm is to blame: the first one is named
        return joints

    @override
    def settle(
        self, joints: Array, guess: Plate, growth: Growth = COLD, settled_mm: float = SETTLED_MM
    ) -> Settled:
        pose = self._equations.pose(joints, guess.unknowns)
        if not np.isfinite(pose).all():
            raise unsettled(self.kind, joints)
        return Settled(TurningPlate(pose), np.zeros(1), np.zeros((0, 6)))


def free_mechanism(
    kind: Kind, flat: Mapping[str, float], equations: EquationsOf | None
) -> FreeMechanism:
    """Make a robot whose platform is one body; raises `SimError` without equations of its kind."""
    if isinstance(kind, BarKind):
        return BarMechanism(kind, flat)
    if equations is None:
        raise SimError(
            f"nothing here simulates a {kind.name}: its equations are in the campaign's robot file",
            remedy="make a campaign with `pkmcal new DIR --robot FILE`, or dry-run it",
        )
    # without errors of gears and encoders, which the cell adds before and its controller after
    names = (*kind.names, *kind.extensions)
    return StatedMechanism(kind, equations({name: flat[name] for name in names if name in flat}))
