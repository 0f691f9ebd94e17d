"""Array types: float, index and truth values; batches, a row each."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

AXES = ("x", "y", "z")
"""Names of the coordinates of a point."""


def batch(values: ArrayLike, columns: Sequence[str], quantity: str) -> Array:
    """Return values as rows (N, k), of which a caller may give one row alone, (k,).

    Raise `ValueError` with both shapes and the columns' names if there are not `columns` of them.
    """
    rows = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if rows.ndim != 2 or rows.shape[1] != len(columns):
        raise ValueError(
            f"{quantity} have shape {np.shape(values)}, must have (N, {len(columns)}) or "
            f"({len(columns)},): {', '.join(columns)}"
        )
    return rows
