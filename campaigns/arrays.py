"""Array types: float, index and truth values; batches, a row each."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

AXES = ("x", "y", "z")
"""Names of the coordinates of a point."""


def batch(values: ArrayLike, columns: Sequence[str], what: str) -> Array:
    """Return rows (N, k) of values by column, of which one row alone may be given, (k,).

    Raises `ValueError` with the shape.
    """
    rows = np.atleast_2d(np.asarray(values, dtype=np.float64))
    if rows.ndim != 2 or rows.shape[1] != len(columns):
        raise ValueError(
            f"{what} have shape {np.shape(values)}, must have (N, {len(columns)}) or "
            f"({len(columns)},): {', '.join(columns)}"
        )
    return rows
