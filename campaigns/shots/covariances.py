"""Whether nine numbers can be the covariance of a point."""

import math
from itertools import chain

from drivers.values import Matrix3

LEAST_DETERMINANT = 1e-12
"""Of the correlations; below it one direction would be known a million times better than others."""


def positive_definite(matrix: Matrix3) -> bool:
    """Sylvester's rule on the correlations, so that the scale does not matter."""
    if not all(math.isfinite(value) for value in chain.from_iterable(matrix)):
        return False
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
    if min(xx, yy, zz) <= 0.0:
        return False
    r_xy = xy / math.sqrt(xx) / math.sqrt(yy)
    r_xz = xz / math.sqrt(xx) / math.sqrt(zz)
    r_yz = yz / math.sqrt(yy) / math.sqrt(zz)
    if max(abs(r_xy), abs(r_xz), abs(r_yz)) >= 1.0:
        return False
    determinant = 1.0 + 2.0 * r_xy * r_xz * r_yz - r_xy**2 - r_xz**2 - r_yz**2
    return determinant > LEAST_DETERMINANT
