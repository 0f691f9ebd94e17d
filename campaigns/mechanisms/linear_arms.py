"""Carriages on straight rails, which hold the upper ends of the forearms.

Arrays of all arms lie by component and arm, (3, n, N), as those of `campaigns.mechanisms.arms`.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.arms import ArmValues
from campaigns.mechanisms.frames import (
    UP,
    about_x,
    about_z,
    rotation_to,
    tilting,
    upright_seen_from,
)
from campaigns.mechanisms.mechanism import MM_PER_RAD, ArmWords, Axis, Limits
from campaigns.mechanisms.parameters import ParameterField
from campaigns.mechanisms.plate_tilt import PlateDrawing

LEVEL = 1e-9
"""A rail that rises less than that leads to no other height."""
UPRIGHT = 1e-12
"""A rail that goes less aside than that is upright: no azimuth moves it."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearArms:
    """Carriages on rails: A_i = P_i + (q_i + δq_i) e_i (model.md, family).

    e_i points along azimuth and elevation; beyond that the rail may be tilted by τ_i out of the
    vertical plane of its azimuth.
    """

    forearm_mm: Array
    """L_i, (n,)."""
    rails: Array
    """e_i and its derivatives by azimuth, elevation and tilt, (4, n, 3)."""
    travel_mm: Array
    """q_i + δq_i, (n, N)."""
    elbows_mm: Array
    """A_i in the base frame, (3, n, N)."""

    @classmethod
    def at(cls, values: Array, extensions: Array, joints: Array) -> Self:
        """Carriages of (n, 7) fields and (n, 1) rail tilts at readings (N, n), mm."""
        rails = rail_directions(values, extensions)
        travel = np.ascontiguousarray(joints.T) + values[:, 5:6]
        elbows = values[:, :3].T[..., None] + rails[0].T[..., None] * travel
        return cls(values[:, 6], rails, travel, elbows)

    def by_fields(self, forearms_mm: Array) -> Array:
        """∂F_i by x, y, z, azimuth, elevation, joint offset, forearm, rail, bar tilt, (n, 9, N).

        The last are 0: the bar on a carriage turns about its middle.
        """
        along, aside, upward, across = self._along_rails(forearms_mm)
        _, arms, rows = forearms_mm.shape
        jacobian = np.zeros((arms, len(RAIL_FIELDS) + 2, rows))
        jacobian[:, :3] = -2.0 * forearms_mm.swapaxes(0, 1)
        jacobian[:, 3] = -2.0 * self.travel_mm * aside
        jacobian[:, 4] = -2.0 * self.travel_mm * upward
        jacobian[:, 5] = -2.0 * along
        jacobian[:, 6] = -2.0 * self.forearm_mm[:, None]
        jacobian[:, 7] = -2.0 * self.travel_mm * across
        return jacobian

    def swing_rad(self, forearms_mm: Array) -> Array:
        """Angles of forearms (3, n, N) off their rails, (N, n)."""
        along = self._along_rails(forearms_mm)[0].T
        return np.asarray(np.arccos(np.clip(-along / self.forearm_mm, -1.0, 1.0)))

    def leverage(self, forearms_mm: Array) -> Array:
        """|∂F_i/∂q_i| / 2 L_i: cosine of the angle between rail and forearm, (N, n)."""
        return np.asarray(np.abs(self._along_rails(forearms_mm)[0].T / self.forearm_mm))

    def _along_rails(self, forearms_mm: Array) -> Array:
        """Forearms (3, n, N) along e_i and its derivatives, (4, n, N)."""
        return np.asarray(np.einsum("fik,kin->fin", self.rails, forearms_mm))


RAIL_FIELDS = (
    ParameterField("x_mm", "x of the rail's zero in the base frame, mm", "place"),
    ParameterField("y_mm", "y of the rail's zero in the base frame, mm", "place"),
    ParameterField("z_mm", "z of the rail's zero in the base frame, mm", "place"),
    ParameterField("azimuth_deg", "the rail's direction about z, deg", "angle"),
    ParameterField("elevation_deg", "the rail's direction above the horizontal, deg", "angle"),
    ParameterField("joint_offset_mm", "the carriage's place minus the reading, mm", "place"),
    ParameterField("forearm_mm", "the forearm's length, mm", "length"),
)
RAIL_TILT = ParameterField(
    "rail_tilt_deg",
    "the rail out of the vertical plane of its azimuth, deg; may be left out",
    "small angle",
)
BAR_TILT = ParameterField(
    "axis_tilt_deg", "the carriage's bar out of the horizontal, deg; may be left out", "small angle"
)


class LinearArmKind:
    """Carriages driven along rails, above the platform on a rail that points upward."""

    fields = RAIL_FIELDS
    extensions = (RAIL_TILT, BAR_TILT)
    lost_motion = ParameterField("backlash_mm", "the drive's lost motion, mm", "place")
    shows_turn = False
    tilt_fields = ("elevation_deg",)
    azimuth_is_outward = False
    words = ArmWords("its carriage's rail", "away from its rail", "carriage")

    def outward_rad(self, values: Array) -> Array:
        """Azimuths from the middle of the rails' zeros to each, (n,)."""
        x, y = (values[:, :2] - values[:, :2].mean(axis=0)).T
        return np.asarray(np.arctan2(y, x))

    def joint(self, number: int) -> Axis:
        """Place of a carriage along its rail."""
        return Axis(f"q{number}", "prismatic")

    def at(self, values: Array, extensions: Array, joints: Array) -> LinearArms:
        """Carriages at readings (N, n)."""
        return LinearArms.at(values, extensions, joints)

    def inverse(self, values: Array, extensions: Array, targets_mm: Array) -> tuple[Array, Mask]:
        """Readings (N, n): of the two places on a rail the one further along it."""
        to_target = targets_mm - values[:, :3]
        along = np.einsum("...k,...k->...", to_target, rail_directions(values, extensions)[0])
        square = along**2 - np.einsum("...k,...k->...", to_target, to_target) + values[:, 6] ** 2
        found = np.all(square >= 0.0, axis=-1)
        root = np.sqrt(np.where(square >= 0.0, square, np.nan))
        return along + root - values[:, 5], found

    def levers_mm(self, values: Array) -> Array:
        """A typical travel for angles, 1 for lengths: of fields, tilts and backlash, (n, 10)."""
        levers = np.ones((len(values), len(RAIL_FIELDS) + 3))
        levers[:, [3, 4, 7, 8]] = MM_PER_RAD
        return levers

    def reach_mm(self, values: Array, extensions: Array, limits: Limits, centre_mm: Array) -> Array:
        """Half size (3,) about a place: forearms within their swing, from carriages in limits."""
        rails = rail_directions(values, extensions)[0]
        ends = values[:, :3] + rails * (np.array(limits.joint)[:, None, None] + values[:, 5:6])
        off_axis = np.arccos(np.clip(-rails, -1.0, 1.0))
        least = np.cos(np.minimum(off_axis + limits.forearm_swing_rad, np.pi))
        most = np.cos(np.maximum(off_axis - limits.forearm_swing_rad, 0.0))
        forearm_mm = values[:, 6:7]
        # the platform is where all forearms end
        low = (ends.min(axis=0) + forearm_mm * least).max(axis=0)
        high = (ends.max(axis=0) + forearm_mm * most).min(axis=0)
        return np.asarray(np.maximum(np.maximum(high - centre_mm, centre_mm - low), 0.0))

    def in_frame_of(
        self, nominal: ArmValues, own: ArmValues, plate: PlateDrawing, *, may_turn: bool
    ) -> ArmValues:
        """Fields (n, 7) and tilts (n, 2) from a base that sees the first rail as it is nominally.

        Its carriage at a reading of 0 is put where it is nominally, and a turn about z gives the
        second rail its nominal x. Then zeros are moved along their rails to their nominal heights.
        Before that the base is tilted to make the first rail's direction nominal, or its tilt where
        the base may not turn, and the platform to make the first two bars' tilts so.
        """
        (wanted, _), (values, tilts) = nominal, own
        places, rails, bars = _levelled(nominal, own, plate, may_turn=may_turn)
        places += _at_zero(*nominal)[0] - places[0]
        rises = np.abs(rails[:, 2]) > LEVEL
        lift = (wanted[:, 2] - places[:, 2]) / np.where(rises, rails[:, 2], np.inf)
        zeros = places + lift[:, None] * rails
        if may_turn:
            turn = about_z(_turn_to(zeros[1] - zeros[0], (wanted[1] - wanted[0])[:2]))
            zeros, rails = zeros[0] + (zeros - zeros[0]) @ turn.T, rails @ turn.T
        seen, seen_tilts = values.copy(), tilts.copy()
        seen[:, :3], seen[:, 3], seen[:, 5] = zeros, wanted[:, 3], -lift
        seen[:, 4], seen_tilts[:, 0] = _angles(rails, wanted[:, 3])
        seen_tilts[:, 1] = np.arcsin(bars[:, 2])
        return seen, seen_tilts


def _levelled(
    nominal: ArmValues, own: ArmValues, plate: PlateDrawing, *, may_turn: bool
) -> tuple[Array, Array, Array]:
    """Places at a reading of 0, rails and bars, (n, 3) each, the first ones as they are nominally.

    The base and the platform are tilted for it, where the platform has a direction of the base's
    only about that one, x.
    """
    (wanted_values, wanted_tilts), (values, tilts) = nominal, own
    joints_mm, tilted = np.array(plate.joints_mm), tilts[:, 1, None]
    outward_rad = np.array(plate.outward_rad)
    level = np.stack([-np.sin(outward_rad), np.cos(outward_rad), 0.0 * outward_rad], axis=1)
    bars, rails = np.cos(tilted) * level + np.sin(tilted) * UP, rail_directions(values, tilts)[0]
    rises = np.sin(wanted_tilts[:2, 1])
    if may_turn:
        base = rotation_to(rails[0], rail_directions(*nominal)[0][0])
        platform = tilting(upright_seen_from(bars[:2] @ base.T, rises))
    else:
        both = tilting(upright_seen_from(bars[:2], rises))
        platform = about_x(_turn_about_x(both @ rails[0], wanted_values[0, 3], wanted_tilts[0, 0]))
        base = platform.T @ both
    places = (_at_zero(values, tilts) + joints_mm) @ base.T - joints_mm
    places += joints_mm @ (platform - np.eye(3)).T
    return places, rails @ base.T, bars @ (platform @ base).T


def _turn_about_x(rail: Array, azimuth_rad: float, tilt_rad: float) -> float:
    """Angle by which a rail was turned about x from where it has a tilt by its azimuth."""
    x, y, z = rail
    aside = np.cos(azimuth_rad)
    if abs(aside) < LEVEL:
        return 0.0
    wanted = (np.sin(tilt_rad) + np.sin(azimuth_rad) * x) / aside
    return float(np.arcsin(wanted / np.hypot(y, z)) - np.arctan2(y, z))


def _angles(rails: Array, azimuths: Array) -> tuple[Array, Array]:
    """Elevations and tilts (n,) of rails (n, 3) by their azimuths."""
    cos, sin = np.cos(azimuths), np.sin(azimuths)
    outward, aside = rails[:, 0] * cos + rails[:, 1] * sin, rails[:, 1] * cos - rails[:, 0] * sin
    return np.arctan2(rails[:, 2], outward), np.arcsin(aside)


def rail_directions(values: Array, extensions: Array) -> Array:
    """e_i of fields (n, 7) and tilts (n, 1), and ∂e_i by azimuth, elevation, tilt, (4, n, 3)."""
    azimuth, elevation, tilt = values[:, 3], values[:, 4], extensions[:, 0]
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros_like(azimuth)], axis=-1)
    aside = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros_like(azimuth)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    level, rise = np.cos(elevation)[:, None], np.sin(elevation)[:, None]
    level = np.where(np.abs(level) < UPRIGHT, 0.0, level)
    cos, sin = np.cos(tilt)[:, None], np.sin(tilt)[:, None]
    untilted = level * outward + rise * up
    return np.stack(
        [
            cos * untilted + sin * aside,
            cos * level * aside - sin * outward,
            cos * (level * up - rise * outward),
            cos * aside - sin * untilted,
        ]
    )


def _at_zero(values: Array, tilts: Array) -> Array:
    """Carriages at a reading of 0, (n, 3)."""
    return np.asarray(values[:, :3] + values[:, 5:6] * rail_directions(values, tilts)[0])


def _turn_to(place: Array, wanted: Array) -> float:
    """Turn about z that gives a place the x of the wanted one (2,), on the same side of it."""
    across = np.sqrt(max(float(place[0] ** 2 + place[1] ** 2 - wanted[0] ** 2), 0.0))
    there = np.arctan2(np.copysign(across, wanted[1]), wanted[0])
    return float(there - np.arctan2(place[1], place[0]))
