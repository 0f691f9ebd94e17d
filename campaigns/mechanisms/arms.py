"""Actuated arms of parallel robots: where joints hold the upper ends of the forearms.

Arrays of all arms lie by component and arm, (3, n, N): long rows are what the processor is fast at.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.mechanism import ArmWords, Limits
from campaigns.mechanisms.parameters import FOREARM, ParameterField
from campaigns.mechanisms.transmission import OF_CRANKS


@dataclass(frozen=True, slots=True, eq=False)
class Arms(ABC):
    """Arms at joints, one forearm each; the class is the kind of arm.

    Values of all arms are (n, k) fields in the order of `fields`, extensions (n, e). A last axis of
    one, or of N where every row is of a robot of its own, stands behind what is kept of them.
    """

    fields: ClassVar[tuple[ParameterField, ...]]
    """Of each arm, in the order of its values."""
    extensions: ClassVar[tuple[ParameterField, ...]]
    """Beyond what controllers know."""
    transmission: ClassVar[tuple[ParameterField, ...]]
    """Of a joint's gear and encoder."""
    joint: ClassVar[Literal["revolute", "prismatic"]]
    shows_turn: ClassVar[bool]
    """Whether arms of known azimuths show how the base is turned about z."""
    leaning: ClassVar[tuple[str, ...]] = ()
    """Fields that say which way imperfect parts lean, beside the extensions."""
    azimuth_is_outward: ClassVar[bool]
    """Whether forearms' bars lie across the azimuths of the arms."""
    words: ClassVar[ArmWords]

    forearm_mm: Array
    """L_i, (n, 1)."""
    elbows_mm: Array
    """A_i in the base frame, (3, n, N)."""

    @abstractmethod
    def by_fields(self, forearms_mm: Array, *, azimuths: bool = True) -> Array:
        """∂F_i of the closures by arm i's own fields and extensions, (…, n, k, N).

        Of forearms (3, …, n, N): all but the columns of their own lengths are linear in them.
        Those of azimuths may hold anything where they are not asked for.
        """

    @abstractmethod
    def swing_rad(self, forearms_mm: Array) -> Array:
        """Angles of forearms (3, n, N) out of their arms' planes, or off their rails, (N, n)."""

    @abstractmethod
    def leverage(self, forearms_mm: Array) -> Array:
        """Share of each forearm along which its joint moves it, (N, n)."""

    @classmethod
    @abstractmethod
    def at(cls, values: Array, extensions: Array, joints: Array) -> Self:
        """Arms of fields (n, k, 1) and extensions (n, e, 1) at readings (N, n)."""

    @staticmethod
    @abstractmethod
    def inverse(values: Array, extensions: Array, targets_mm: Array) -> tuple[Array, Mask]:
        """Joints (N, n) whose forearms end at (N, n, 3), and which rows have all of them, (N,)."""

    @staticmethod
    @abstractmethod
    def outward_rad(values: Array) -> Array:
        """Azimuths from the robot's middle to the arms, (n,)."""

    @staticmethod
    @abstractmethod
    def sensitivity_scale_mm(values: Array) -> Array:
        """Lengths that turn errors into errors of place, (n, k + e + f).

        Of each field, of each extension and of each field of the transmission.
        """

    @staticmethod
    @abstractmethod
    def reach_mm(values: Array, extensions: Array, limits: Limits, centre_mm: Array) -> Array:
        """Half size (3,) of a box about a place that holds all that the forearms' ends reach."""


CRANK_FIELDS = (
    ParameterField("x_mm", "the motor centre's x in the base frame, mm", "place"),
    ParameterField("y_mm", "the motor centre's y in the base frame, mm", "place"),
    ParameterField("z_mm", "the motor centre's z in the base frame, mm", "place"),
    ParameterField("azimuth_deg", "the arm's direction about z at joint angle 0, deg", "angle"),
    ParameterField("joint_offset_deg", "the joint angle minus the encoder's reading, deg", "angle"),
    ParameterField("arm_mm", "the arm's length, mm", "length"),
    ParameterField(FOREARM, "the forearm's length, mm", "length"),
)
AXIS_TILT = ParameterField(
    "axis_tilt_deg", "the motor's axis out of the horizontal, deg; may be left out", "small angle"
)


@dataclass(frozen=True, slots=True, eq=False)
class RotaryArms(Arms):
    """Cranks on motors (paper eqs. 1-8): elbow A_i = P_i + l_i (cos q u_i + sin q w_i).

    q is the encoder's reading and the joint offset; u_i points along the azimuth, w_i down. Beyond
    the paper the motor's axis may be tilted out of the horizontal, turned by τ_i about u_i.
    """

    fields = CRANK_FIELDS
    extensions = (AXIS_TILT,)
    transmission = OF_CRANKS
    joint = "revolute"
    shows_turn = True
    azimuth_is_outward = True
    words = ("its elbow's circle", "out of its arm's plane", "elbow")

    arm_mm: Array
    """l_i, (n, 1)."""
    axis_tilt_rad: Array
    """τ_i, (n, 1)."""
    frames: Array
    """u_i, the motor's axis and w_i, of unit length in the base frame, (3, 3, n, 1)."""
    cos: Array
    """Cosines of the arms' angles, (n, N)."""
    sin: Array
    """A positive angle lowers the elbow."""

    @override
    @classmethod
    def at(cls, values: Array, extensions: Array, joints: Array) -> Self:
        """Cranks of (n, 7, 1) fields and (n, 1, 1) axis tilts at angles (N, n)."""
        tilt = extensions[:, 0]
        motor, azimuth, offset, arm, forearm = _columns(values)
        frames = crank_frames(azimuth, tilt)
        angle = np.ascontiguousarray(joints.T) + offset
        cos, sin = np.cos(angle), np.sin(angle)
        outward, _, lowered = arm * frames
        elbows = motor.swapaxes(0, 1) + (cos * outward + sin * lowered)
        return cls(forearm, elbows, arm, tilt, frames, cos, sin)

    @override
    def by_fields(self, forearms_mm: Array, *, azimuths: bool = True) -> Array:
        """∂F_i by x, y, z, azimuth, joint offset, arm, forearm and axis tilt, (…, n, 8, N)."""
        cos, sin = self.cos, self.sin
        out, aside, down = in_frames(self.frames, forearms_mm)
        arm_mm, tilt_rad = self.arm_mm, self.axis_tilt_rad
        jacobian = np.empty((len(CRANK_FIELDS) + 1, *forearms_mm.shape[1:]))  # field by field
        np.multiply(forearms_mm, -2.0, out=jacobian[:3])
        if azimuths:
            across = np.cos(tilt_rad) * aside + np.sin(tilt_rad) * down
            jacobian[3] = -2.0 * arm_mm * (cos * across - sin * np.sin(tilt_rad) * out)
        jacobian[4] = 2.0 * arm_mm * (sin * out - cos * down)
        jacobian[5] = -2.0 * (cos * out + sin * down)
        jacobian[6] = -2.0 * self.forearm_mm
        jacobian[7] = -2.0 * arm_mm * sin * aside
        return np.moveaxis(jacobian, 0, -2)

    @override
    def swing_rad(self, forearms_mm: Array) -> Array:
        """Angles of forearms (3, n, N) out of the planes in which their cranks turn, (N, n)."""
        _, aside, _ = in_frames(self.frames, forearms_mm)
        return np.asarray(np.arcsin(np.clip((aside / self.forearm_mm).T, -1.0, 1.0)))

    @override
    def leverage(self, forearms_mm: Array) -> Array:
        """|∂F_i/∂q_i| / 2 l_i L_i: sine of the angle between crank and forearm, (N, n)."""
        out, _, down = in_frames(self.frames, forearms_mm)
        lever = self.cos * down - self.sin * out
        return np.asarray(np.abs(lever / self.forearm_mm).T)

    @override
    @staticmethod
    def outward_rad(values: Array) -> Array:
        return values[:, 3]

    @override
    @staticmethod
    def inverse(values: Array, extensions: Array, targets_mm: Array) -> tuple[Array, Mask]:
        """Encoder angles on the branch with the elbow outward (eqs. 10-14 as corrected)."""
        motor, azimuth, offset, arm, forearm = _columns(values)
        motor_to_plate = targets_mm - motor
        frames = crank_frames(azimuth, extensions[:, 0])[..., None]
        out, _, down = in_frames(frames, motor_to_plate.T).swapaxes(1, 2)
        sine = -2.0 * arm * down
        cosine = -2.0 * arm * out
        constant = np.einsum("...k,...k->...", motor_to_plate, motor_to_plate) + arm**2 - forearm**2
        discriminant = sine**2 + cosine**2 - constant**2
        found = np.all(discriminant >= 0.0, axis=-1)
        root = np.sqrt(np.where(discriminant >= 0.0, discriminant, np.nan))
        # the root of eq. 14's half-angle form, without its 0/0 where both of its arguments vanish
        angle = np.arctan2(sine, cosine) + np.arctan2(root, -constant) - offset
        return np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi, found

    @override
    @staticmethod
    def sensitivity_scale_mm(values: Array) -> Array:
        """The crank's length for angles and ratios, 1 for lengths."""
        scale = np.ones((len(values), len(CRANK_FIELDS) + 1 + len(OF_CRANKS)))
        scale[:, [3, 4, *range(7, scale.shape[1])]] = values[:, 5:6]
        return scale

    @override
    @staticmethod
    def reach_mm(values: Array, extensions: Array, limits: Limits, centre_mm: Array) -> Array:
        """A forearm each way, (3,)."""
        return np.full(3, values[:, 6].max())


def crank_frames(azimuth_rad: Array, axis_tilt_rad: Array) -> Array:
    """u_i, the motor's axis, and w_i, of unit length in the base frame, (3, 3, n, …).

    The crank points along u_i at an angle of 0° (eq. 5) and along w_i at 90°. The axis is v_i of
    eq. 6 turned about u_i by the axis tilt; without one w_i points straight down.
    """
    cos, sin = np.cos(azimuth_rad), np.sin(azimuth_rad)
    level, tilt = np.cos(axis_tilt_rad), np.sin(axis_tilt_rad)
    outward = [cos, sin, np.zeros_like(cos)]
    axis = [-sin * level, cos * level, tilt]
    lowered = [-sin * tilt, cos * tilt, -level]
    return np.array([outward, axis, lowered])


def in_frames(frames: Array, vectors: Array) -> Array:
    """Vectors of the arms (3, …, n, N) along their frames' axes (a, 3, n, 1), (a, …, n, N)."""
    return np.asarray(np.einsum("akin,k...in->a...in", frames, vectors))


def _columns(values: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Motor centres (n, 3, …), azimuths, joint offsets, crank and forearm lengths, (n, …) each."""
    return values[:, :3], values[:, 3], values[:, 4], values[:, 5], values[:, 6]
