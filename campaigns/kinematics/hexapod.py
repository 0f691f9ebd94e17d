"""Hexapods: six legs between joints of the base and joints of a platform that turns freely.

The platform hangs below its base or stands above it: the search for poses begins at the home pose.
"""

import numpy as np
from typing_extensions import override

from campaigns.arrays import AXES, Array
from campaigns.kinematics.axes import POSITION, TURNS
from campaigns.kinematics.implicit import ImplicitMechanism
from campaigns.kinematics.limbs import (
    FOREARM,
    Fields,
    place_fields,
    rail_directions,
    transmission_fields,
)
from campaigns.kinematics.parameters import ParameterField
from campaigns.kinematics.rotations import turned_by

ON_PLATFORM = tuple(
    ParameterField(
        f"plate_{c}_mm", f"{c} of the leg's joint on the platform, seen from the controlled point,"
        " mm", "place", "plate",
    )
    for c in AXES
)  # fmt: skip


class Hexapod(ImplicitMechanism):
    """Legs of variable length on joints of the base: |X + R b_i - a_i| = q_i.

    a_i and b_i are a leg's joints on base and platform. The joint's offset is the leg's length at
    reading 0.
    """

    joint_kinds = ("prismatic",) * 6
    task_axes = (*POSITION, *TURNS)
    arm_fields = (
        *place_fields("the leg's joint on the base, in the base frame"),
        *ON_PLATFORM,
        ParameterField(
            "joint_offset_mm", "the leg's length less its reading, mm", "length", "offsets"
        ),
        *transmission_fields("mm", "drive"),
    )

    @override
    def misfit(self, fields: Fields, joints: Array, pose: Array) -> Array:
        squares = _squared(_from_base(fields, pose))
        return np.asarray((squares - joints**2) / (2.0 * fields["joint_offset"]))

    @override
    def first_joints(self, fields: Fields, poses: Array) -> Array:
        return np.sqrt(_squared(_from_base(fields, poses)))

    @override
    def first_pose(self, fields: Fields, joints: Array) -> Array:
        return self.home_poses(joints)


class Hexaglide(ImplicitMechanism):
    """Legs of fixed length on carriages: |X + R b_i - P_i - q_i e_i| = L_i.

    e_i is the rail's direction, P_i the carriage's joint at place 0 with its offset in q_i.
    """

    joint_kinds = ("prismatic",) * 6
    task_axes = (*POSITION, *TURNS)
    arm_fields = (
        *place_fields("the carriage's joint at place 0, in the base frame"),
        ParameterField("azimuth_deg", "the rail's direction about z, deg", "angle", "azimuths"),
        ParameterField(
            "elevation_deg", "the direction above the horizontal in which its readings grow, deg",
            "angle", "rails",
        ),
        *ON_PLATFORM,
        ParameterField(
            "joint_offset_mm", "the carriage's place minus the reading, mm", "place", "offsets"
        ),
        FOREARM,
        *transmission_fields("mm", "drive"),
    )  # fmt: skip

    @override
    def misfit(self, fields: Fields, joints: Array, pose: Array) -> Array:
        directions = _rails(fields)
        legs = [
            leg - joints * along
            for leg, along in zip(_from_base(fields, pose), directions, strict=True)
        ]
        return np.asarray((_squared(legs) - fields["forearm"] ** 2) / (2.0 * fields["forearm"]))

    # |g - q e|² = L² has the roots q = g·e ± √((g·e)² - |g|² + L²): the carriage takes the one
    # that is higher up, on level rails the one further along.
    @override
    def first_joints(self, fields: Fields, poses: Array) -> Array:
        legs, rails = _from_base(fields, poses), _rails(fields)
        along = sum(leg * rail for leg, rail in zip(legs, rails, strict=True))
        root = np.sqrt(along**2 - _squared(legs) + fields["forearm"] ** 2)
        return np.asarray(along + np.where(np.sin(fields["elevation"]) < -0.1, -root, root))

    @override
    def first_pose(self, fields: Fields, joints: Array) -> Array:
        return self.home_poses(joints)


def _from_base(fields: Fields, pose: Array) -> list[Array]:
    """Return x, y, z (…, N, 6) of the platform's joints seen from the legs' places on the base."""
    ends = turned_by(pose[..., 3:], [fields[f"plate_{c}"] for c in AXES])
    return [pose[..., k, None] + ends[k] - fields[c] for k, c in enumerate(AXES)]


def _rails(fields: Fields) -> list[Array]:
    """Return x, y, z (…, 1, 6) of the rails' directions."""
    upright = rail_directions({"rail_tilt": 0.0 * fields["azimuth"], **fields})
    return [upright[..., k, :, :] for k in range(3)]


def _squared(vectors: list[Array]) -> Array:
    """Return the squared lengths (…, N, 6) of vectors by x, y, z."""
    return np.asarray(vectors[0] ** 2 + vectors[1] ** 2 + vectors[2] ** 2)
