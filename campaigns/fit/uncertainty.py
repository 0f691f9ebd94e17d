"""Undetermined directions of a posterior, its uncertainty of positions, and their budget."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.fit.error_model import frame_columns
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.posterior import Posterior

UNSEEN_TOLERANCES = 300.0
"""Tolerances along a direction that change points by less than their noise, if no shot shows it."""
NAMED_SHARE = 0.08
"""Share of an undetermined combination from which a parameter is named as part of it."""


@dataclass(frozen=True, slots=True, eq=False)
class NullDirections:
    """Combinations of unknowns that no shot determines: they stay at nominal."""

    vectors: Array
    """Orthonormal directions, (P, k), in tolerances."""
    names: tuple[tuple[str, ...], ...]
    """Parameters of each combination, but for those of the tracker alone."""

    @classmethod
    def spanned_by(cls, vectors: Array, names: tuple[str, ...]) -> Self:
        """Return orthonormal directions (P, k) with the names of the unknowns in each."""
        return cls(vectors, _named(vectors, names))

    def transform(self, x: Array) -> Array:
        """Return unknowns (P,) in the datum in which these directions are held at nominal."""
        return np.asarray(x - self.vectors @ (self.vectors.T @ x))

    def transform_covariance(self, covariance: Array) -> Array:
        """Return a covariance (P, P) of the unknowns in the datum in which these are held."""
        projector = np.eye(len(self.vectors)) - self.vectors @ self.vectors.T
        return np.asarray(projector @ covariance @ projector)


def null_directions(posterior: Posterior) -> NullDirections:
    """Return the directions that neither a shot nor a known length determines.

    What remains are motions of the robot's base frame, and whatever the mechanism hides: inner
    constraints, the datum of a free network.
    """
    size = len(posterior.model.names)
    frames = slice(len(posterior.at.x), None)
    rows = np.concatenate(
        [posterior.at.jacobian[..., :size], posterior.at.jacobian[..., frames]], axis=2
    )
    information = marginal_information(shot_information(rows, posterior.weights), size)
    for source in posterior.measured:
        place = posterior.model.names.index(source)
        information[place, place] += posterior.prior[place, place]
    return null_directions_of(information, posterior.model.names)


def shot_information(jacobian: Array, weights: Array) -> Array:
    """Return the information (Q, Q) of shots with derivatives (N, 3, Q) and weights (N, 3, 3)."""
    rows = jacobian.reshape(-1, jacobian.shape[2])
    return np.asarray((weights @ jacobian).reshape(rows.shape).T @ rows)


def marginal_information(information: Array, size: int) -> Array:
    """Return the information on the first `size` unknowns, the others eliminated."""
    parameters, mixed = information[:size, :size], information[:size, size:]
    frames = information[size:, size:]
    return np.asarray(parameters - mixed @ np.linalg.solve(frames, mixed.T))


def null_directions_of(information: Array, names: tuple[str, ...]) -> NullDirections:
    """Return the directions along which information (P, P) is practically zero."""
    values, vectors = np.linalg.eigh(information)
    return NullDirections.spanned_by(vectors[:, values < UNSEEN_TOLERANCES**-2], names)


def _named(null: Array, names: tuple[str, ...]) -> tuple[tuple[str, ...], ...]:
    """Return the parameters of the simplest combinations, of which each has one pivot alone."""
    if not null.shape[1]:
        return ()
    pivots = scipy.linalg.qr(null.T, pivoting=True, mode="r")[1][: null.shape[1]]
    simple = null @ np.linalg.inv(null[pivots])
    named = (
        tuple(sorted(names[k] for k in np.flatnonzero(np.abs(column) > NAMED_SHARE)))
        for column in simple.T
    )
    return tuple(sorted(own for own in named if not {*own} <= {*TRACKER_SOURCES}))


def without_frame(by: Array, positions: Array) -> Array:
    """Return derivatives of positions (M, 3, P) from which every motion of the frame is removed."""
    frame = frame_columns(positions).reshape(-1, 6)
    basis = np.linalg.qr(frame / np.linalg.norm(frame, axis=0))[0]
    rows = by.reshape(-1, by.shape[2])
    return np.asarray((rows - basis @ (basis.T @ rows)).reshape(by.shape))


def position_std_mm(by: Array, covariance: Array) -> Array:
    """Return 1 σ of positions, the root of the summed variances of x, y and z, (M,)."""
    return np.asarray(np.sqrt(((by @ covariance) * by).sum(axis=(1, 2))))


def budget(posterior: Posterior, by: Array) -> Mapping[str, float]:
    """Return the mean squares (mm²) that each source gives to positions with derivatives `by`.

    `by` (M, 3, P) have the frame's motion removed. The shares add up exactly to the mean square of
    `position_std_mm`: with posterior covariance C, weights W and the priors' precision D,
    C = C (Σ_k φ_k A'W V_k W A + Σ_g D_g) C, so each part of the noise and each group has its term.
    """
    size, covariance = len(posterior.model.names), posterior.covariance
    influence = by.reshape(-1, size) @ covariance[:size]
    rows = (posterior.weights @ posterior.at.jacobian).reshape(-1, len(covariance))
    points, shares = len(by), {}
    for part, factor in posterior.components.factors.items():
        noise = np.linalg.cholesky(factor * posterior.noise[part] + 1e-18 * np.eye(3))
        spread = noise.swapaxes(1, 2) @ rows.reshape(-1, 3, len(covariance))
        shares[part] = float(((spread.reshape(rows.shape) @ influence.T) ** 2).sum()) / points
    groups = (*posterior.model.groups, *("changes",) * (len(posterior.at.x) - size))
    for group in dict.fromkeys(groups):
        places = [place for place, share in enumerate(groups) if share == group]
        share = influence[:, places] @ posterior.prior[np.ix_(places, range(len(covariance)))]
        shares[group] = float((share * influence).sum()) / points
    return shares
