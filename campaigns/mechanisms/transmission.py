"""Transmission of joints: what gears and encoders add to readings on their way to the arms.

    true = q + δ + k q + a sin q + b cos q + c sin Nq + d cos Nq - ½ β s

q is the encoder's reading, δ the joint's offset, k an error of the encoder's ratio or of a screw's
pitch; a and b an eccentric encoder, once a turn of the arm; c and d a ripple, N times a turn, of
the gear or of the motor's encoder (of a carriage, N = 2π over the travel in a turn of its drive);
β the backlash, of which the joint stays behind by half on the side s = ±1 to which it last moved.

Each term is the offset's column times a function of q or s, so that poses and their derivatives
need no other kinematics: only the angle that goes in is another.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.parameters import ParameterField

LEFT_BEHIND = -0.5
"""What part of the backlash an arm is from its encoder, in the direction of approach."""
ROUNDS = 60
STEEPEST = 0.5
"""Largest change of a joint's error over its motion that a robot may have: the rounds converge."""
STANDS = 1e-9
"""Way of a joint, rad or mm, below which it has not moved."""
SETTLED = 1e-14
"""Relative change of readings that ends the rounds."""


GAIN = ParameterField(
    "encoder_gain_ppm", "the joint's motion beyond its reading's, ppm; may be left out", "ratio"
)
OF_CRANKS = (
    GAIN,
    *(
        ParameterField(f"{name}_deg", f"{words}, deg; may be left out", "small angle")
        for name, words in (
            ("eccentricity_sin", "the encoder's eccentricity by the reading's sine"),
            ("eccentricity_cos", "the encoder's eccentricity by the reading's cosine"),
            ("ripple_sin", "the gear's ripple by the sine of its phase"),
            ("ripple_cos", "the gear's ripple by the cosine of its phase"),
            ("backlash", "the gear's lost motion"),
        )
    ),
)
OF_CARRIAGES = (
    GAIN,
    *(
        ParameterField(f"{name}_mm", f"{words}, mm; may be left out", "place")
        for name, words in (
            ("ripple_sin", "the drive's ripple by the sine of its phase"),
            ("ripple_cos", "the drive's ripple by the cosine of its phase"),
            ("backlash", "the drive's lost motion"),
        )
    ),
)
YIELDING = "yielding"
TERMS: Mapping[str, tuple[str, ...]] = {
    "ratio": ("encoder_gain",),
    "eccentricity": ("eccentricity_sin", "eccentricity_cos"),
    YIELDING: ("eccentricity_sin", "eccentricity_cos"),
    "ripple": ("ripple_sin", "ripple_cos"),
    "period": ("ripple_sin", "ripple_cos"),
    "backlash": ("backlash",),
}
"""Stems of the fields that take up what shots show of a joint, by the name of its cause.

A gear that yields under its arm's weight goes by the cosine, as an eccentric encoder may. Under
the plate's it goes so nearly, and the geometry takes the rest: right of positions alone."""


@dataclass(frozen=True, slots=True)
class Transmission:
    """Transmission of all joints of a robot: which terms it has, and the ripples' rate.

    Values of all arms are (f, n), a row a field, in rad or mm and ratios.
    """

    fields: tuple[ParameterField, ...]
    ripple_rate: float = 0.0
    """Phase of a ripple in rad over the joint's reading in rad or mm, N; 0 where nobody knows."""

    def terms(self, joints: Array, approach: Array | None = None) -> Array:
        """Change of joints by each field, (f, N, n), at readings (N, n) reached by `approach`."""
        phase = self.ripple_rate * joints
        ripples = self.ripple_rate != 0.0
        of: dict[str, Array] = {
            "encoder_gain": joints,
            "ripple_sin": np.sin(phase) * ripples,
            "ripple_cos": np.cos(phase) * ripples,
            "backlash": np.zeros_like(joints) if approach is None else LEFT_BEHIND * approach,
        }
        if any(each.stem == "eccentricity_sin" for each in self.fields):
            of |= {"eccentricity_sin": np.sin(joints), "eccentricity_cos": np.cos(joints)}
        return np.stack([of[each.stem] for each in self.fields])

    def true_joints(self, values: Array, encoders: Array, approach: Array | None = None) -> Array:
        """Joints of the arms (N, n), but for their offsets, at encoder readings (N, n)."""
        if not values.any():
            return encoders
        return np.asarray(
            encoders + np.einsum("fn,fkn->kn", values, self.terms(encoders, approach))
        )

    def encoder_readings(
        self, values: Array, joints: Array, approach: Array | None = None
    ) -> Array:
        """Readings (N, n) at which the arms are at these joints; NaN stays."""
        if not values.any():
            return joints
        readings = joints
        for _ in range(ROUNDS):
            off = self.true_joints(values, readings, approach) - joints
            readings = readings - off
            if not np.nanmax(np.abs(off), initial=0.0) > SETTLED * (
                1.0 + np.nanmax(np.abs(joints), initial=0.0)
            ):
                break
        return np.asarray(readings)

    @staticmethod
    def columns(by_offsets: Array, terms: Array) -> Array:
        """Derivatives (N, t, f n) by all values, a field's together, from those by the offsets.

        `by_offsets` (N, t, n), and the terms (f, N, n) of the same joints.
        """
        columns = by_offsets[:, :, None] * terms.swapaxes(0, 1)[:, None]
        return np.asarray(columns.reshape(*by_offsets.shape[:2], -1))

    def slopes(self, values: Array, encoders: Array) -> Array:
        """Change of the arms' joints over that of the readings, (N, n), at readings (N, n)."""
        phase, ripple = self.ripple_rate * encoders, self.ripple_rate
        of: dict[str, Array] = {
            "encoder_gain": np.ones_like(encoders),
            "eccentricity_sin": np.cos(encoders),
            "eccentricity_cos": -np.sin(encoders),
            "ripple_sin": ripple * np.cos(phase),
            "ripple_cos": -ripple * np.sin(phase),
            "backlash": np.zeros_like(encoders),
        }
        rates = np.stack([of[each.stem] for each in self.fields])
        return np.asarray(1.0 + np.einsum("fn,fkn->kn", values, rates))

    def steepest(self, values: Array) -> float:
        """Bound of the change of any joint's error over its motion."""
        rates = {"encoder_gain": 1.0, "backlash": 0.0}
        rates |= {"eccentricity_sin": 1.0, "eccentricity_cos": 1.0}
        own = [rates.get(each.stem, abs(self.ripple_rate)) for each in self.fields]
        return float((np.array(own) @ np.abs(values)).max())


def approach_along(joints: Array) -> Array:
    """Sign of each joint's last motion at joints (N, n) that are reached one after another, (N, n).

    A joint that stands keeps it, and has 0 until it moves.
    """
    ways = np.diff(joints, axis=0, prepend=joints[:1])
    ways = np.where(np.abs(ways) > STANDS, np.sign(ways), 0.0)
    moved = np.where(ways != 0.0, np.arange(len(ways))[:, None], 0)
    return np.take_along_axis(ways, np.maximum.accumulate(moved, axis=0), axis=0)
