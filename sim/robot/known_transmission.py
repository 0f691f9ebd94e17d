"""Encoder readings of a controller that knows its gears and encoders: a root search a joint.

With q the reading, N the ripples' rate and s = ±1 the way that a joint last went, an arm stands at
q + k q + a sin q + b cos q + c sin Nq + d cos Nq - ½ β s, its offset aside.
"""

import math
from collections.abc import Mapping

import numpy as np

from sim.geometry import Array, Kind

FARTHEST = 0.1
"""Largest error of a gear and its encoder that is looked for, rad; of carriages in `Kind.scale`."""
CLOSE = 1e-12
STANDS = 1e-9
"""Way below which a joint stays where it is, likewise."""


def readings_for(
    flat: Mapping[str, float], kind: Kind, ripple_rate: float, joints: Array, present: Array
) -> Array:
    """Readings (n,) at which arms stand at joints (n,), each coming from where it is at present.

    Of the two readings of a joint, one from each side, it is the one beyond; between them the
    nearer one.
    """
    return np.array(
        [
            _reading(flat, kind, ripple_rate, arm, float(joints[arm]), float(present[arm]))
            for arm in range(kind.arms)
        ]
    )


def _reading(
    flat: Mapping[str, float], kind: Kind, ripple_rate: float, arm: int, joint: float, now: float
) -> float:
    import scipy  # only for a controller that knows its gears

    def value(stem: str) -> float:
        return kind.inner(flat.get(f"arm{arm}.{stem}_{kind.unit}", 0.0))

    gain = 1e-6 * flat.get(f"arm{arm}.encoder_gain_ppm", 0.0)
    a, b = value("eccentricity_sin"), value("eccentricity_cos")
    c, d, half = value("ripple_sin"), value("ripple_cos"), 0.5 * value("backlash")

    def beyond(reading: float, side: float) -> float:
        turned = ripple_rate * reading
        periodic = a * math.sin(reading) + b * math.cos(reading)
        periodic += c * math.sin(turned) + d * math.cos(turned)
        return reading * (1.0 + gain) + periodic - half * side - joint

    reach = FARTHEST * kind.scale
    falling, rising = (
        float(
            scipy.optimize.brentq(
                beyond, joint - reach, joint + reach, args=(side,), xtol=CLOSE * kind.scale
            )
        )
        for side in (-1.0, 1.0)
    )
    if now <= falling - STANDS * kind.scale:
        return rising
    if now >= rising + STANDS * kind.scale:
        return falling
    return rising if now > 0.5 * (falling + rising) else falling
