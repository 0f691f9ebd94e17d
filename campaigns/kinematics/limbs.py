"""Limbs of parallel robots: where an actuated joint holds the upper end of its forearm.

A limb is a crank on a motor or a carriage on a rail. It carries a parallelogram of two rods, the
forearm, between an upper bar and a bar on the plate. Limbs have no state: they are given the fields
of all arms by stem, arrays (…, 1, n) in mm and rad, and joints (…, N, n). Vectors of all arms are
(…, 3, N, n).
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, Literal

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array, Mask
from campaigns.kinematics.parameters import (
    DRIVE_PERIOD,
    RIPPLES_PER_TURN,
    Parameter,
    ParameterField,
    Role,
)

Fields = Mapping[str, Array]
STEP = 1e-200
"""Imaginary step h of derivatives, f'(x) = Im f(x + ih) / h. There is no difference to cancel, so h
is so small that its square vanishes beside any number."""
LESS_PLATE_JOINT = "in the base frame, less the plate joint's place"
LEVEL_RISE = 0.26
"""Sine of the elevation up to which a rail counts as level: 15°."""


def place_fields(of: str) -> tuple[ParameterField, ...]:
    """Make the fields of a place.

    Args:
        of: What is there, and in which frame, for people.

    Returns:
        Fields `x_mm`, `y_mm` and `z_mm` in the group `places`.
    """
    return tuple(ParameterField(f"{c}_mm", f"{c} of {of}, mm", "place", "places") for c in "xyz")


def extension_field(name: str, description: str, group: str) -> ParameterField:
    """Make a field of an imperfect part, a small angle in deg."""
    return ParameterField(name, f"{description}, deg", "small angle", group, Role.EXTENSION)


def transmission_fields(unit: Literal["deg", "mm"], part: str) -> tuple[ParameterField, ...]:
    """Make the fields of a joint's encoder, and of its gear or drive.

    Args:
        unit: `"deg"` of revolute joints, `"mm"` of prismatic ones.
        part: `"gear"` or `"drive"`, for people.

    Returns:
        Fields of ratio, eccentricity, ripple, backlash and compliance, which files may leave out.
    """
    quantity: Literal["small angle", "place"] = "small angle" if unit == "deg" else "place"
    eccentricity = (
        ("eccentricity_sin", "the encoder's eccentricity, factor of sin(reading)", "eccentricity"),
        ("eccentricity_cos", "the encoder's eccentricity, factor of cos(reading)", "eccentricity"),
    )
    rows = (
        *(eccentricity if unit == "deg" else ()),
        ("ripple_sin", f"the {part}'s ripple, factor of the sine of its phase", "ripple"),
        ("ripple_cos", f"the {part}'s ripple, factor of the cosine of its phase", "ripple"),
        ("backlash", f"the {part}'s lost motion", "backlash"),
        (
            "compliance",
            f"the {part}'s compliance under the plate's weight, at 300 mm",
            "compliance",
        ),
    )
    ratio = "the excess of the joint's motion over its reading, ppm"
    return (
        ParameterField("encoder_gain_ppm", ratio, "ratio", "ratio", Role.TRANSMISSION),
        *(
            ParameterField(f"{stem}_{unit}", f"{words}, {unit}", quantity, group, Role.TRANSMISSION)
            for stem, words, group in rows
        ),
    )


FOREARM = ParameterField("forearm_mm", "the forearm's length, mm", "length", "lengths")
OF_ANY_LIMB = (
    extension_field(
        "parallelogram_skew_deg",
        "the difference of the forearm's two rods over their distance",
        "rods",
    ),
    extension_field("bar_turn_deg", "the plate's bar turned about z out of its direction", "bars"),
    *(
        ParameterField(
            f"plate_joint_{c}_mm", f"the bar's {c} on the plate beyond `plate_joints_mm`, mm",
            "place", "plate_joints", Role.EXTENSION,
        )
        for c in "xyz"
    ),
)  # fmt: skip


class Limb(ABC):
    """Kind of limb: its fields, where it holds its forearm, and how far it is from its limits."""

    fields: ClassVar[tuple[ParameterField, ...]]
    joint: ClassVar[Literal["revolute", "prismatic"]]
    rate: ClassVar[Parameter]
    """How often a ripple of its joint repeats."""
    bars_follow_azimuths: ClassVar[bool]
    """Whether the bars lie across the arms' azimuths; else across fixed directions."""
    words: ClassVar[tuple[str, str, str]]
    """Path of the forearm's upper end, direction in which swing is counted, and name of that end,
    for messages."""

    @abstractmethod
    def upper_ends(self, fields: Fields, joints: Array) -> Array:
        """Return the upper ends of the forearms in the base frame, (…, 3, N, n)."""

    def upper_bars(self, fields: Fields, bar_azimuths: Array) -> Array:
        """Return the directions of the upper bars, (…, 3, 1, n): level but for the axis's tilt."""
        return crank_frames(bar_azimuths, fields["axis_tilt"])[1]

    @abstractmethod
    def inverse(self, fields: Fields, targets: Array) -> tuple[Array, Mask]:
        """Return the joints (N, n) whose forearms reach targets (3, N, n), and in which rows."""

    @abstractmethod
    def swing_rad(self, fields: Fields, forearms: Array) -> Array:
        """Return the angles (N, n) of forearms out of their arms' planes, or off their rails."""

    # |cos| of the angle between the forearm g and its upper end's motion t = ∂A/∂q:
    # |g·t| / (|t| L). It vanishes where crank and forearm are stretched out, and the
    # joint no longer moves the plate: a singularity of the first kind (Gosselin and Angeles 1990).
    @np.errstate(invalid="ignore")
    def leverage(self, fields: Fields, joints: Array, forearms: Array) -> Array:
        """Return the share (N, n) of each forearm along which its joint moves it, 0 to 1."""
        motion = self.upper_ends(fields, np.asarray(joints + 1j * STEP)).imag / STEP
        size = np.sqrt(dot(motion, motion)) * fields["forearm"]
        return np.asarray(np.abs(dot(forearms, motion) / size))

    @abstractmethod
    def reach_mm(self, fields: Fields, joint: tuple[float, float], swing_rad: float) -> Array:
        """Return the lowest and highest corner (2, 3) of a box that holds all lower ends.

        `joint` are the limits of each joint, `swing_rad` the limit of the forearms' swing.
        """

    @abstractmethod
    def outward_rad(self, fields: Fields) -> Array:
        """Return the azimuths (n,) from the robot's middle to the arms."""


class Crank(Limb):
    """Crank on a motor (paper eqs. 1-8): elbow = P + l (cos q u + sin q w).

    u points along the azimuth, w down; q is the joint with its offset. Beyond the paper the motor's
    axis may be tilted out of the horizontal, turned about u.
    """

    fields = (
        *place_fields(f"the motor's centre {LESS_PLATE_JOINT}"),
        ParameterField(
            "azimuth_deg", "the arm's direction about z at joint angle 0, deg", "angle", "azimuths"
        ),
        ParameterField(
            "joint_offset_deg", "the joint angle minus the encoder's reading, deg", "angle",
            "offsets",
        ),
        ParameterField("arm_mm", "the arm's length, mm", "length", "lengths"),
        FOREARM,
        extension_field("axis_tilt_deg", "the motor's axis out of the horizontal", "axes"),
        *OF_ANY_LIMB,
        *transmission_fields("deg", "gear"),
    )  # fmt: skip
    joint = "revolute"
    rate = RIPPLES_PER_TURN
    bars_follow_azimuths = True
    words = ("its elbow's circle", "out of its arm's plane", "elbow")

    @override
    def upper_ends(self, fields: Fields, joints: Array) -> Array:
        angle = joints + fields["joint_offset"]
        outward, _, lowered = crank_frames(fields["azimuth"], fields["axis_tilt"])
        turned = along(np.cos(angle), outward) + along(np.sin(angle), lowered)
        return _place(fields) + along(fields["arm"], turned)

    # With d from the motor to the forearm's lower end, |P + l (cos q u + sin q w) - target|² = L²
    # is, in the paper's letters,
    #
    #     I sin q + J cos q + C = 0      I = -2 l d·w,  J = -2 l d·u,  C = |d|² + l² - L²
    #
    # that is R cos(q - φ) = -C with R² = I² + J² and φ = atan2(I, J). Its roots are
    # q = φ ± atan2(√(R² - C²), -C); plus is the elbow outward. Where R² < C² there is none: the
    # target is out of reach. The paper's eq. 14 in tan(q / 2) has the same roots, but may be 0 / 0.
    @override
    def inverse(self, fields: Fields, targets: Array) -> tuple[Array, Mask]:
        """Solve on the elbow-outward branch (eqs. 10-14, corrected: docs/explanation/model.md)."""
        motor_to_target = targets - _place(fields)
        outward, _, lowered = crank_frames(fields["azimuth"], fields["axis_tilt"])
        arm, forearm = fields["arm"], fields["forearm"]
        sine = -2.0 * arm * dot(motor_to_target, lowered)
        cosine = -2.0 * arm * dot(motor_to_target, outward)
        constant = dot(motor_to_target, motor_to_target) + arm**2 - forearm**2
        root2 = sine**2 + cosine**2 - constant**2
        root = np.sqrt(np.where(root2 >= 0.0, root2, np.nan))
        angle = np.arctan2(sine, cosine) + np.arctan2(root, -constant) - fields["joint_offset"]
        # readings lie in [-π, π)
        return np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi, np.all(root2 >= 0.0, axis=-1)

    @override
    def swing_rad(self, fields: Fields, forearms: Array) -> Array:
        _, axis, _ = crank_frames(fields["azimuth"], fields["axis_tilt"])
        aside = dot(forearms, axis) / fields["forearm"]
        return np.asarray(np.arcsin(np.clip(aside, -1.0, 1.0)))

    @override
    def reach_mm(self, fields: Fields, joint: tuple[float, float], swing_rad: float) -> Array:
        """Return a box of a forearm each way about the middle of the motors, and below it."""
        middle = _place(fields).mean(axis=(1, 2))
        forearm, arm = fields["forearm"].max(), fields["arm"].max()
        down = np.array([forearm, forearm, forearm + arm])
        return np.stack([middle - down, middle + np.array([forearm, forearm, 0.0])])

    @override
    def outward_rad(self, fields: Fields) -> Array:
        return np.asarray(fields["azimuth"][0])


class Carriage(Limb):
    """Carriage on a straight rail: upper end = P + (q + offset) e.

    e points along azimuth and elevation, where the readings grow; beyond that the rail may lean
    sideways, out of the vertical plane of its azimuth, and the carriage's bar out of the
    horizontal. The platform hangs below its carriages: of the two places from which a forearm
    reaches, a carriage takes the upper one, on rails that are about level the one further along.
    """

    fields = (
        *place_fields(f"the rail's zero {LESS_PLATE_JOINT}"),
        ParameterField("azimuth_deg", "the rail's direction about z, deg", "angle", "azimuths"),
        ParameterField(
            "elevation_deg",
            "the direction above the horizontal in which its readings grow, deg",
            "angle",
            "rails",
        ),
        ParameterField(
            "joint_offset_mm", "the carriage's place minus the reading, mm", "place", "offsets"
        ),
        FOREARM,
        extension_field(
            "rail_tilt_deg", "the rail out of the vertical plane of its azimuth", "rails"
        ),
        extension_field("axis_tilt_deg", "the carriage's bar out of the horizontal", "axes"),
        *OF_ANY_LIMB,
        *transmission_fields("mm", "drive"),
    )
    joint = "prismatic"
    rate = DRIVE_PERIOD
    bars_follow_azimuths = False
    words = ("its carriage's rail", "away from its rail", "carriage")

    @override
    def upper_ends(self, fields: Fields, joints: Array) -> Array:
        return _place(fields) + along(joints + fields["joint_offset"], rail_directions(fields))

    # With d from the rail's zero to the forearm's lower end and b = d·e its part along the rail,
    # |s e - d|² = L² has the roots s = b ± √(b² - |d|² + L²): a line cuts a sphere twice.
    @override
    def inverse(self, fields: Fields, targets: Array) -> tuple[Array, Mask]:
        """Solve for the upper of the two places from which a forearm reaches, or the outer one."""
        to_target = targets - _place(fields)
        along_rail = dot(to_target, rail_directions(fields))
        root2 = along_rail**2 - dot(to_target, to_target) + fields["forearm"] ** 2
        root = np.sqrt(np.where(root2 >= 0.0, root2, np.nan)) * self._upward(fields)
        return along_rail + root - fields["joint_offset"], np.all(root2 >= 0.0, axis=-1)

    @override
    def swing_rad(self, fields: Fields, forearms: Array) -> Array:
        """Return the angles (N, n) between forearms and their rails' direction down or inward."""
        cosine = -self._upward(fields) * dot(forearms, rail_directions(fields)) / fields["forearm"]
        return np.asarray(np.arccos(np.clip(cosine, -1.0, 1.0)))

    # A forearm within its swing lies in a cone about its rail's direction downward. That direction
    # is at an angle β_k from axis k, so the forearm's angle from axis k is within β_k ± swing, and
    # its cosine is largest and smallest at the ends of that interval, cut to [0, π]. The box of one
    # arm is this added to both ends of its rail; the plate is in all of these boxes.
    @override
    def reach_mm(self, fields: Fields, joint: tuple[float, float], swing_rad: float) -> Array:
        """Return a box of what forearms within their swing reach from carriages on their rails."""
        rail_ends = [self.upper_ends(fields, np.array([[limit]])) for limit in joint]
        carriages = np.concatenate(rail_ends, axis=1)  # (3, 2, n)
        upward = rail_directions(fields) * self._upward(fields)
        from_axis = np.arccos(np.clip(-upward, -1.0, 1.0))
        lowest = np.cos(np.minimum(from_axis + swing_rad, np.pi))
        highest = np.cos(np.maximum(from_axis - swing_rad, 0.0))
        forearm = fields["forearm"]
        low = (carriages.min(axis=1, keepdims=True) + forearm * lowest).max(axis=(1, 2))
        high = (carriages.max(axis=1, keepdims=True) + forearm * highest).min(axis=(1, 2))
        return np.stack([low, high])

    @override
    def outward_rad(self, fields: Fields) -> Array:
        x, y = fields["x"][0], fields["y"][0]
        return np.asarray(np.arctan2(y - y.mean(), x - x.mean()))

    # Fields may be complex here, for derivatives: the choice of the branch is of their real parts.
    def _upward(self, fields: Fields) -> Array:
        """Return 1 for rails (1, n) whose readings grow upward, of level ones outward; else -1."""
        rise = np.sin(np.real(fields["elevation"]))
        outward = np.cos(np.real(fields["azimuth"] - self.outward_rad(fields)))
        sense = np.where(np.abs(rise) > LEVEL_RISE, rise, outward)
        return np.where(sense > -1e-9, 1.0, -1.0)


# With v = (-sin α, cos α, 0) across the arm, a tilt τ turns the motor's axis about u to
# cos τ v + sin τ z0. Square to it and to u is w = -sin τ v - cos τ z0, down for τ = 0; the
# elbow moves in the plane of u and w. Returned are u, the axis and w.
def crank_frames(azimuth: Array, axis_tilt: Array) -> tuple[Array, Array, Array]:
    """Return unit vectors (…, 3, 1, n): outward at joint angle 0, the motor's axis, down at 90°."""
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    level, tilt = np.cos(axis_tilt), np.sin(axis_tilt)
    return (
        vectors(cos, sin, 0.0),
        vectors(-sin * level, cos * level, tilt),
        vectors(-sin * tilt, cos * tilt, -level),
    )


# cos κ (cos ε cos α, cos ε sin α, sin ε) + sin κ (-sin α, cos α, 0) with azimuth α, elevation ε and
# a sideways tilt κ out of the vertical plane of the azimuth.
def rail_directions(fields: Fields) -> Array:
    """Return the unit vectors (…, 3, 1, n) along rails, in which their readings grow."""
    cos, sin = np.cos(fields["azimuth"]), np.sin(fields["azimuth"])
    level, rise = np.cos(fields["elevation"]), np.sin(fields["elevation"])
    upright, tilt = np.cos(fields["rail_tilt"]), np.sin(fields["rail_tilt"])
    return vectors(
        upright * level * cos - tilt * sin, upright * level * sin + tilt * cos, upright * rise
    )


def vectors(x: Array, y: Array, z: Array | float) -> Array:
    """Return the vectors (…, 3, N, n) of components (…, N, n)."""
    shape = np.broadcast(x, y, z).shape  # a third of the time of stack and broadcast_arrays
    result = np.empty((*shape[:-2], 3, *shape[-2:]), dtype=np.result_type(x, y, z))
    result[..., 0, :, :], result[..., 1, :, :], result[..., 2, :, :] = x, y, z
    return result


def along(lengths: Array, directions: Array) -> Array:
    """Return vectors (…, 3, N, n) of lengths (…, N, n) in given directions (…, 3, N, n)."""
    return np.asarray(lengths[..., None, :, :] * directions)


def dot(a: Array, b: Array) -> Array:
    """Return scalar products (…, N, n) of vectors (…, 3, N, n)."""
    return np.asarray((a * b).sum(axis=-3))


def _place(fields: Fields) -> Array:
    """Return the limbs' places P in the base frame, (…, 3, 1, n)."""
    return vectors(fields["x"], fields["y"], fields["z"])
