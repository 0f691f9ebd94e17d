"""Inverse kinematics of a controller that computes how its plate tilts, sags and yields: by rods.

Unequal rods, tilted axes and turned bars tilt the plate and move the reflector; a frame that bends
and drives that yield lower it. Such a controller aims its plain kinematics a little beside the
wanted pose, until the rods put the reflector where it is wanted:

1. plain inverse kinematics of the aim (assembly.py) gives joints;
2. a mechanism of single rods, built from the parameters that were loaded, is settled at them, and
   a second time with what its drives yield under the weight;
3. what the reflector and the turn miss is taken from the aim, and the rounds begin again.

The misses are tenths of a millimetre and change little with the aim, so a few rounds are enough.
The estimator, and the module for LinuxCNC, compute with sums and differences of rods instead; a
test holds that both ways agree (docs/adr/0016-controllers-that-compute-plate-tilt.md).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from sim.errors import AssemblyLost
from sim.geometry import CRANK_MM, ON_PLATE, REFLECTOR, SAG, Array, Geometry, PlateKind, geometry_of
from sim.robot.assembly import OutOfReach, joints_for
from sim.robot.rods import Build, Plate, RodMechanism, turned

MOST_ROUNDS = 20
CLOSE_MM = 1e-8
"""Distance of the reflector from its wanted place at which the rounds end."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownPlate:
    """Sizes of a platform by its drawing, to which parameters are added."""

    joints_mm: Array
    """(n, 3): the bars' middles on the plate, from the contracted plate joints."""
    rod_spacing_mm: float
    reflector_mm: Array
    """(3,): from the controlled point."""

    def with_parameters(self, flat: Mapping[str, float]) -> Self:
        """Return the sizes with what flat parameters add to them."""
        beyond_mm = [
            [flat.get(f"arm{arm}.{name}", 0.0) for name in ON_PLATE]
            for arm in range(len(self.joints_mm))
        ]
        reflector_mm = self.reflector_mm + [flat.get(name, 0.0) for name in REFLECTOR]
        return replace(self, joints_mm=self.joints_mm + beyond_mm, reflector_mm=reflector_mm)


def is_level(flat: Mapping[str, float], kind: PlateKind) -> bool:
    """Whether no parameter tilts or lowers the plate, or tilts a rail."""
    return not any(flat.get(name, 0.0) for name in kind.extensions)


def tilted_joints_for(
    flat: Mapping[str, float],
    kind: PlateKind,
    sizes: KnownPlate,
    position_mm: Array,
    turn_rad: float,
) -> Array:
    """Find encoder values (n,), rad or mm, that put the reflector where a level plate has it.

    Raises `OutOfReach`.
    """
    # Each round settles from the plate of the round before, which is close: so the assembly stays.
    sizes = sizes.with_parameters(flat)
    geometry, rods = _build_mechanism(flat, kind, sizes)
    compliance = _compliance(flat, kind)
    level = Plate.level(kind, position_mm, turn_rad)
    wanted_mm = rods.reflector_mm(level, sizes.reflector_mm)
    aim_mm, aim_rad, plate = position_mm, turn_rad, level
    for _ in range(MOST_ROUNDS):
        joints = joints_for(geometry, aim_mm, aim_rad)
        try:
            plate = rods.settle(joints, plate).plate
            if compliance.any():
                _, lifts = rods.heights_by_joints(joints, plate)
                plate = rods.settle(joints - compliance * lifts, plate).plate
        except AssemblyLost as lost:
            raise OutOfReach(0) from lost  # no single arm is to blame: the first one is named
        error_mm = rods.reflector_mm(plate, sizes.reflector_mm) - wanted_mm
        error_mm[2] += _rise_mm(flat, position_mm + error_mm)
        error_rad = plate.theta_rad - level.theta_rad
        if float(np.abs([*error_mm, geometry.apart_mm * error_rad]).max()) < CLOSE_MM:
            return joints
        aim_mm, aim_rad = aim_mm - error_mm, aim_rad - error_rad
    raise OutOfReach(0)


def _rise_mm(flat: Mapping[str, float], position_mm: Array) -> float:
    """Return the plate's rise by a bending frame at a position, mm."""
    # the parameters are stated over 400 mm sideways and 200 mm of height
    x, y, z = position_mm[0] / 400.0, position_mm[1] / 400.0, position_mm[2] / 200.0
    parts = zip(SAG, (x, y, x * x + y * y, z), strict=True)
    return float(sum(flat.get(name, 0.0) * by for name, by in parts))


def _compliance(flat: Mapping[str, float], kind: PlateKind) -> Array:
    """Return the motion of joints (n,) for 1 mm of the plate's rise by 1 rad or mm of the joint."""
    # The parameter is the yielding of a drive whose joint lifts the plate by 300 mm a rad, or of a
    # carriage that lifts it by its own travel (docs/explanation/model.md, transmission).
    values = [flat.get(f"arm{arm}.compliance_{kind.unit}", 0.0) for arm in range(kind.arms)]
    return kind.inner(values) * kind.scales / CRANK_MM


def _build_mechanism(
    flat: Mapping[str, float], kind: PlateKind, sizes: KnownPlate
) -> tuple[Geometry, RodMechanism]:
    """Build the contracted robot and its single rods from flat parameters."""

    def column(field: str) -> Array:
        values = [flat.get(f"arm{arm}.{field}", 0.0) for arm in range(kind.arms)]
        return np.radians(values)

    tilts = column("axis_tilt_deg")
    geometry = geometry_of(flat, kind)
    if kind.on_rails:
        geometry = _tilt_rails(geometry, column("rail_tilt_deg"))
    # the rod on the side of the bar's direction is the longer one of a positive skew
    half_mm = 0.5 * sizes.rod_spacing_mm * column("parallelogram_skew_deg")
    build = Build(
        plate_joints_mm=sizes.joints_mm,
        rod_spacing_mm=sizes.rod_spacing_mm,
        rod_errors_mm=np.column_stack([-half_mm, half_mm]),
        axis_tilts_rad=tilts,
        bar_turns_rad=column("bar_turn_deg"),
    )
    if not kind.on_rails:
        return geometry, RodMechanism(geometry, build)
    # `RodMechanism` tilts a rail together with its bar, but this parameter tilts the bar alone: the
    # rails are turned back first, so that they end where their own parameters have them
    untilted = _with_rails(geometry, turned(geometry.rails, geometry.outward, -tilts))
    return geometry, RodMechanism(untilted, build)


def _tilt_rails(geometry: Geometry, tilts_rad: Array) -> Geometry:
    """Turn rails out of the vertical plane of their azimuth."""
    azimuths = geometry.azimuths_rad
    aside = np.column_stack([-np.sin(azimuths), np.cos(azimuths), np.zeros_like(azimuths)])
    tilted = np.cos(tilts_rad)[:, None] * geometry.rails + np.sin(tilts_rad)[:, None] * aside
    return _with_rails(geometry, tilted)


def _with_rails(geometry: Geometry, rails: Array) -> Geometry:
    """Return the geometry with rails of these directions, (n, 3)."""
    level = np.hypot(rails[:, 0], rails[:, 1])
    return replace(
        geometry,
        azimuths_rad=np.arctan2(rails[:, 1], rails[:, 0]),
        elevations_rad=np.arctan2(rails[:, 2], level),
    )
