"""Length of a vector of known covariance."""

import numpy as np

from campaigns.arrays import Array


def length_with_std(vector_mm: Array, covariance_mm2: Array) -> tuple[float, float]:
    """Return the length of a vector (3,) and its 1 σ, by its covariance (3, 3).

    A length of 0 has the σ of its worst direction.
    """
    length = float(np.linalg.norm(vector_mm))
    if length == 0.0:
        return 0.0, float(np.sqrt(np.linalg.eigvalsh(covariance_mm2)[-1]))
    along = vector_mm / length
    return length, float(np.sqrt(along @ covariance_mm2 @ along))
