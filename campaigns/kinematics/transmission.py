"""Transmission of joints: errors of gears and encoders between a reading and the limb's joint.

    true = q + δ + k q + a sin q + b cos q + c sin Nq + d cos Nq - ½ β s

q is the encoder's reading, δ the joint's offset; k an error of the encoder's ratio or of a screw's
pitch; a and b an eccentric encoder; c and d a ripple with the joint's phase rate N (0: no ripple);
β the backlash, by half of which the joint stays behind on the side s = ±1 to which it last moved
(0: unknown).

Each term is a function of q or s times a parameter, so that its derivative is that function times
the derivative by the offset. The limbs' equations need no change: only the angle that enters them
is another one. Here "true" angles leave δ out, which the limbs add themselves.
"""

from collections.abc import Mapping

import numpy as np

from campaigns.arrays import Array

STEEPEST_ERROR = 0.5
"""Largest change of a joint's error over its motion that a robot may have, so that the rounds of
`encoder_readings` converge."""
LEAST_MOTION = 1e-9
"""Motion of a joint, rad or mm, below which it has not moved."""


def terms(joints: Array, approach: Array | None, phase_rate: Array) -> dict[str, Array]:
    """Return the factor (N, n) of each parameter of the transmission, by its stem.

    `joints` (N, n) are readings, `approach` (N, n) the signs of the joints' last motions.
    `phase_rate` (n,) is the change of each ripple's phase with the reading; 0: no ripple.
    """
    phase, has_ripple = phase_rate * joints, phase_rate != 0.0
    return {
        "encoder_gain": joints,
        "eccentricity_sin": np.sin(joints),
        "eccentricity_cos": np.cos(joints),
        "ripple_sin": np.sin(phase) * has_ripple,
        "ripple_cos": np.cos(phase) * has_ripple,
        "backlash": np.zeros_like(joints) if approach is None else -0.5 * approach,
    }


STEMS = tuple(terms(np.zeros(1), None, np.zeros(1)))
"""Stems of the parameters of the transmission, whose factors `terms` returns."""


def true_joints(
    values: Mapping[str, Array], joints: Array, approach: Array | None, phase_rate: Array
) -> Array:
    """Return the joints (N, n), less their offsets, at which encoders read `joints`.

    `values` are parameters (1, n) by stem.
    """
    if not any(values[stem].any() for stem in STEMS if stem in values):
        return joints
    factors = terms(joints, approach, phase_rate).items()
    return np.asarray(
        joints + sum(values[stem] * factor for stem, factor in factors if stem in values)
    )


# With the error f(q) = true(q) - q, the reading of a joint at Q solves q + f(q) = Q. Rounds of
# q ← q - (q + f(q) - Q) shrink the error by |f'| each: below ½ by `STEEPEST_ERROR`.
def encoder_readings(
    values: Mapping[str, Array], joints: Array, approach: Array | None, phase_rate: Array
) -> Array:
    """Return the readings (N, n) at which joints, less their offsets, are at `joints`, or NaN."""
    readings = joints
    rounding = 1e-14 * (1.0 + np.nanmax(np.abs(joints), initial=0.0))
    for _ in range(60):
        error = true_joints(values, readings, approach, phase_rate) - joints
        readings = readings - error
        if not np.nanmax(np.abs(error), initial=0.0) > rounding:
            break
    return np.asarray(readings)


def approach_along(joints: Array, before: Array | None = None) -> Array:
    """Return the sign of each joint's last motion at joints (N, n) reached one after another.

    A joint that stands keeps its sign. `before` (n,) is the sign at the first row; None: unknown.
    """
    motions = np.diff(joints, axis=0, prepend=joints[:1])
    signs = np.where(np.abs(motions) > LEAST_MOTION, np.sign(motions), 0.0)
    if before is not None and len(signs):
        signs[0] = before
    # each row takes the sign at the last row in which its joint moved
    row_of_motion = np.where(signs != 0.0, np.arange(len(signs))[:, None], 0)
    return np.take_along_axis(signs, np.maximum.accumulate(row_of_motion, axis=0), axis=0)
