"""Carriages on straight rails, which hold the upper ends of the forearms.

Arrays of all arms lie by component and arm, (3, n, N), as those of `campaigns.mechanisms.arms`.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.arms import Arms, in_frames
from campaigns.mechanisms.mechanism import MM_PER_RAD, Limits
from campaigns.mechanisms.parameters import FOREARM, ParameterField
from campaigns.mechanisms.transmission import OF_CARRIAGES

UPRIGHT = 1e-12
"""A rail that goes less aside than that is upright: no azimuth moves it."""


RAIL_FIELDS = (
    ParameterField("x_mm", "x of the rail's zero in the base frame, mm", "place"),
    ParameterField("y_mm", "y of the rail's zero in the base frame, mm", "place"),
    ParameterField("z_mm", "z of the rail's zero in the base frame, mm", "place"),
    ParameterField("azimuth_deg", "the rail's direction about z, deg", "angle"),
    ParameterField("elevation_deg", "the rail's direction above the horizontal, deg", "angle"),
    ParameterField("joint_offset_mm", "the carriage's place minus the reading, mm", "place"),
    ParameterField(FOREARM, "the forearm's length, mm", "length"),
)
RAIL_TILT = ParameterField(
    "rail_tilt_deg",
    "the rail out of the vertical plane of its azimuth, deg; may be left out",
    "small angle",
)
BAR_TILT = ParameterField(
    "axis_tilt_deg", "the carriage's bar out of the horizontal, deg; may be left out", "small angle"
)


@dataclass(frozen=True, slots=True, eq=False)
class LinearArms(Arms):
    """Carriages on rails: A_i = P_i + (q_i + δq_i) e_i (model.md, family).

    e_i points along azimuth and elevation; beyond that the rail may be tilted by τ_i out of the
    vertical plane of its azimuth. Carriages are above the platform on rails that point upward.
    """

    fields = RAIL_FIELDS
    extensions = (RAIL_TILT, BAR_TILT)
    transmission = OF_CARRIAGES
    joint = "prismatic"
    shows_turn = False
    leaning = ("elevation_deg",)
    azimuth_is_outward = False
    words = ("its carriage's rail", "away from its rail", "carriage")

    rails: Array
    """e_i and its derivatives by azimuth, elevation and tilt, (4, 3, n, 1)."""
    travel_mm: Array
    """q_i + δq_i, (n, N)."""

    @override
    @classmethod
    def at(cls, values: Array, extensions: Array, joints: Array) -> Self:
        """Carriages of (n, 7, 1) fields and (n, 1, 1) rail tilts at (N, n), mm."""
        rails = rail_directions(values, extensions)
        travel = np.ascontiguousarray(joints.T) + values[:, 5]
        elbows = values[:, :3].swapaxes(0, 1) + rails[0] * travel
        return cls(values[:, 6], elbows, rails, travel)

    @override
    def by_fields(self, forearms_mm: Array, *, azimuths: bool = True) -> Array:
        """∂F_i by x, y, z, azimuth, elevation, joint offset, forearm, rail, bar tilt, (…, n, 9, N).

        The last are 0: the bar on a carriage turns about its middle.
        """
        along, aside, upward, across = self._along_rails(forearms_mm)
        _, *of, rows = forearms_mm.shape
        jacobian = np.zeros((*of, len(RAIL_FIELDS) + 2, rows))
        jacobian[..., :3, :] = -2.0 * np.moveaxis(forearms_mm, 0, -2)
        jacobian[..., 3, :] = -2.0 * self.travel_mm * aside
        jacobian[..., 4, :] = -2.0 * self.travel_mm * upward
        jacobian[..., 5, :] = -2.0 * along
        jacobian[..., 6, :] = -2.0 * self.forearm_mm
        jacobian[..., 7, :] = -2.0 * self.travel_mm * across
        return jacobian

    @override
    def swing_rad(self, forearms_mm: Array) -> Array:
        """Angles of forearms (3, n, N) off their rails, (N, n)."""
        along = (self._along_rails(forearms_mm)[0] / self.forearm_mm).T
        return np.asarray(np.arccos(np.clip(-along, -1.0, 1.0)))

    @override
    def leverage(self, forearms_mm: Array) -> Array:
        """|∂F_i/∂q_i| / 2 L_i: cosine of the angle between rail and forearm, (N, n)."""
        return np.asarray(np.abs(self._along_rails(forearms_mm)[0] / self.forearm_mm).T)

    def _along_rails(self, forearms_mm: Array) -> Array:
        """Forearms (3, …, n, N) along e_i and its derivatives, (4, …, n, N)."""
        return in_frames(self.rails, forearms_mm)

    @override
    @staticmethod
    def outward_rad(values: Array) -> Array:
        """Azimuths from the middle of the rails' zeros to each, (n,)."""
        x, y = (values[:, :2] - values[:, :2].mean(axis=0)).T
        return np.asarray(np.arctan2(y, x))

    @override
    @staticmethod
    def inverse(values: Array, extensions: Array, targets_mm: Array) -> tuple[Array, Mask]:
        """Readings (N, n): of the two places on a rail the one further along it."""
        to_target = targets_mm - values[:, :3]
        along = np.einsum("...k,...k->...", to_target, rail_directions(values, extensions)[0].T)
        square = along**2 - np.einsum("...k,...k->...", to_target, to_target) + values[:, 6] ** 2
        found = np.all(square >= 0.0, axis=-1)
        root = np.sqrt(np.where(square >= 0.0, square, np.nan))
        return along + root - values[:, 5], found

    @override
    @staticmethod
    def sensitivity_scale_mm(values: Array) -> Array:
        """A typical travel for angles and the gain, 1 for lengths."""
        scale = np.ones((len(values), len(RAIL_FIELDS) + 2 + len(OF_CARRIAGES)))
        scale[:, [3, 4, 7, 8, 9]] = MM_PER_RAD
        return scale

    @override
    @staticmethod
    def reach_mm(values: Array, extensions: Array, limits: Limits, centre_mm: Array) -> Array:
        """Half size (3,) about a place: forearms within their swing, from carriages in limits."""
        rails = rail_directions(values, extensions)[0].T
        ends = values[:, :3] + rails * (np.array(limits.joint)[:, None, None] + values[:, 5:6])
        off_axis = np.arccos(np.clip(-rails, -1.0, 1.0))
        least = np.cos(np.minimum(off_axis + limits.forearm_swing_rad, np.pi))
        most = np.cos(np.maximum(off_axis - limits.forearm_swing_rad, 0.0))
        forearm_mm = values[:, 6:7]
        # the platform is where all forearms end
        low = (ends.min(axis=0) + forearm_mm * least).max(axis=0)
        high = (ends.max(axis=0) + forearm_mm * most).min(axis=0)
        return np.asarray(np.maximum(np.maximum(high - centre_mm, centre_mm - low), 0.0))


def rail_directions(values: Array, extensions: Array) -> Array:
    """Rails e_i, and ∂e_i by azimuth, elevation and tilt, (4, 3, n, …), of fields (n, 7, …)."""
    azimuth, elevation, tilt = values[:, 3], values[:, 4], extensions[:, 0]
    none = np.zeros_like(azimuth)
    outward = np.stack([np.cos(azimuth), np.sin(azimuth), none])
    aside = np.stack([-np.sin(azimuth), np.cos(azimuth), none])
    up = np.stack([none, none, np.ones_like(azimuth)])
    level, rise = np.cos(elevation), np.sin(elevation)
    level = np.where(np.abs(level) < UPRIGHT, 0.0, level)
    cos, sin = np.cos(tilt), np.sin(tilt)
    untilted = level * outward + rise * up
    return np.stack(
        [
            cos * untilted + sin * aside,
            cos * level * aside - sin * outward,
            cos * (level * up - rise * outward),
            cos * aside - sin * untilted,
        ]
    )
