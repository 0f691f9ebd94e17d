"""Array types: float, index and truth values."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

AXES = ("x", "y", "z")
"""Names of the coordinates of a point."""
