"""What a plan will tell before anything has moved: standard deviations and observability."""

from dataclasses import dataclass

import numpy as np

from campaigns.numerics.geometry import Array, Geometry, Index, indices
from campaigns.numerics.pairs import directions
from campaigns.numerics.par4 import parameter_jacobian
from campaigns.numerics.statistics import covariance, observability


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """What a plan tells of the free parameters."""

    std: Array
    """1 σ in mm and rad, (F,)."""
    rank: int
    condition: float
    indices: dict[str, float]
    """O1…O5 (Sun & Hollerbach 2008)."""


def predict_distances(
    geometry: Geometry,
    free: tuple[str, ...],
    joints_rad: Array,
    poses: Array,
    pairs: Index,
    variance_mm2: Array,
) -> Prediction:
    """What distances of pairs (M, 2) with variances (M,) will tell of the free parameters.

    Lost rank gives infinite standard deviations.
    """
    by_shot = parameter_jacobian(geometry, joints_rad, poses)[:, :3, indices(free)]
    first, second = pairs.T
    direction = directions(poses[:, :3], first, second)
    jacobian = np.einsum("mk,mkf->mf", direction, by_shot[second] - by_shot[first])
    whitened = jacobian / np.sqrt(variance_mm2)[:, None]
    seen = observability(whitened)
    full = seen.rank == len(free)
    std = np.sqrt(np.diag(covariance(whitened))) if full else np.full(len(free), np.inf)
    return Prediction(
        std, seen.rank, seen.condition, observability_indices(seen.singular_values, len(pairs))
    )


def observability_indices(singular_values: Array, rows: int) -> dict[str, float]:
    """O1…O5 of the scaled Jacobian's singular values (P,)."""
    largest, least = float(singular_values[0]), float(singular_values[-1])
    positive = least > 0.0
    if largest == 0.0:
        return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
    return {
        "O1": float(np.exp(np.log(singular_values).mean()) / np.sqrt(rows)) if positive else 0.0,
        "O2": least / largest,
        "O3": least,
        "O4": least**2 / largest,
        "O5": float(1.0 / np.sum(1.0 / singular_values)) if positive else 0.0,
    }
