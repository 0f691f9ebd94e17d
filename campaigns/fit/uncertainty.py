"""Uncertainty of a fit: directions that no shot determines, σ of positions, and its budget.

Theory of operation. The posterior covariance C of all unknowns comes in. First, some combinations
of parameters move no point: motions of the robot's base frame, which the tracker's free frame takes
back, and combinations that the mechanism hides. They are found as directions Z of practically no
information (`null_directions`). Priors with the precision D alone say where they are, and their
uncertainty is projected out of the σ of parameters. Geodesy calls this the datum of a free network,
and the projection S = 1 - Z (Z'DZ)⁻¹ Z'D an S-transformation (Baarda 1973).

Second, positions are of interest up to a motion of the frame, for the robot's base is where its
users define it. Derivatives of positions lose the part that a frame explains (`without_frame`);
with what remains, B, the variances of coordinates are the diagonal of B C B' (`length_std`).
`budget` splits their mean square into shares of the noise and of each prior.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Self

import numpy as np
import scipy

from campaigns.arrays import AXES, Array, Index
from campaigns.fit.effects import Layer, Moved
from campaigns.fit.error_model import ErrorModel, Observations, frame_columns, moved_frames
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.fit import Fit
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.slots import Slot

FORMER, SIZES = "former", "sizes"
"""Rows of the budget: a former result as prior, and what the sizes of groups may be."""
UNSEEN_TOLERANCES = 300.0
"""Tolerances along a direction by which all points together change by less than their noise, if it
counts as undetermined."""
SAME_MOTION = 1e-3
"""Singular value below which motions, as columns of unit length, are equal."""
NAMED_SHARE = 0.08
"""Share of an undetermined combination from which a parameter is named as part of it."""


@dataclass(frozen=True, eq=False)
class NullDirections:
    """Combinations of unknowns that no shot determines: priors alone say where they are."""

    vectors: Array
    """Orthonormal directions Z, (P, k), in tolerances."""
    names: tuple[tuple[str, ...], ...]
    """Names of the parameters of each combination, without those of the tracker alone, and those
    that a mechanism has but never moves by."""

    motions: tuple[str, ...]
    """What each combination does, in words; empty where no motion takes it back."""
    prior: Array
    """Precision D of the unknowns before the shots, (P, P)."""

    @classmethod
    def spanned_by(
        cls,
        vectors: Array,
        names: tuple[str, ...],
        prior: Array,
        unnamed: Collection[str] = (),
        motions: Mapping[str, Array] = MappingProxyType({}),
    ) -> Self:
        """Return orthonormal directions (P, k) with the names of the unknowns in each.

        Combinations of `unnamed` ones alone are not named. `motions` are by words those that take
        a direction back, with the size of each (k,), mm at a distance of 1 m.
        """
        silent = {*TRACKER_SOURCES, *unnamed}
        combinations = _name_combinations(vectors, names, motions)
        named = [(words, each) for words, each in combinations if not {*each} <= silent]
        in_words, listed = zip(*named, strict=True) if named else ((), ())
        return cls(vectors, listed, in_words, prior)

    @cached_property
    def projector(self) -> Array:
        """Projector S = 1 - Z (Z'DZ)⁻¹ Z'D to the datum, (P, P)."""
        z = self.vectors
        weighted = self.prior @ z
        return np.asarray(np.eye(len(z)) - z @ np.linalg.solve(z.T @ weighted, weighted.T))

    def transform(self, x: Array) -> Array:
        """Return unknowns (P,), or their derivatives (P, k), in the datum of these directions."""
        return np.asarray(self.projector @ x)

    def transform_covariance(self, covariance: Array) -> Array:
        """Return the covariance (P, P) of unknowns in the datum of these directions."""
        return np.asarray(self.projector @ covariance @ self.projector.T)


# Changes in time are left out: they are events, and no part of the robot's datum. So are all other
# effects, but for the surroundings of other kinds of observation, which are unknown as frames are.
# Priors are left out as well, but for known lengths and surroundings: a direction that a prior
# alone determines is undetermined.
def null_directions(fit: Fit) -> NullDirections:
    """Return the directions that neither a shot nor a known length determines."""
    size, information = len(fit.model.names), _information_with_frames(fit)
    marginal = marginal_information(information, size)
    for source in fit.measured:
        place = fit.model.names.index(source)
        marginal[place, place] += fit.precision[place, place]
    return _named_directions(fit, _null_vectors(marginal), information)


def directions_kept(fit: Fit, vectors: Array) -> NullDirections:
    """Return orthonormal directions (P, k) that are undetermined, whatever the shots of a fit say.

    The fit's shots name them.
    """
    return _named_directions(fit, vectors, _information_with_frames(fit))


def _information_with_frames(fit: Fit) -> Array:
    """Return the information (Q, Q) on the parameters, the surroundings and the frames."""
    size = len(fit.model.names)
    spans = [slice(size), *_places_of_slots(fit.model), slice(len(fit.at.x), None)]
    columns = [[rows.jacobian[..., span] for span in spans] for rows in fit.rows]
    parts = [
        shot_information(np.concatenate(parts, axis=2), rows.weights)
        for parts, rows in zip(columns, fit.rows, strict=True)
    ]
    whole, begin = np.asarray(sum(parts)), size
    for span in spans[1:-1]:
        end = begin + span.stop - span.start
        whole[begin:end, begin:end] += fit.precision[span, span]
        begin = end
    return whole


def _named_directions(fit: Fit, vectors: Array, information: Array) -> NullDirections:
    """Return directions (P, k) by what takes them back, by the information with the frames."""
    size = len(fit.model.names)
    step = np.linalg.solve(information[size:, size:], information[size:, :size] @ vectors)
    taken_back = np.asarray(step)[len(step) - 6 * len(fit.at.frames) :]
    motions = _motions(fit, vectors, taken_back)
    unnamed = _without_effect(marginal_information(information, size), fit.model.names)
    prior = fit.precision[:size, :size]
    return NullDirections.spanned_by(vectors, fit.model.names, prior, unnamed, motions)


# Why no shot notices a direction: something outside of the robot's geometry takes it back. The
# tracker's frame takes back motions of the base, the reflector's place shifts of the plate, and the
# tracker's scale one scale of all lengths. What these do along each direction names it.
def _motions(fit: Fit, vectors: Array, frames: Array) -> Mapping[str, Array]:
    """Return by words what takes back each direction (P, k): sizes (k,), mm at 1 m.

    `frames` (6 F, k) are the steps of the frames that do so, mrad and mm in the tracker's axes.
    """
    motions: dict[str, Array] = {}
    if fit.at.frames:
        # R + exp(ψ×) R is a turn by R'ψ about the base's origin, for the shift comes after it
        to_base = fit.at.frames[0].rotation.T
        for kind, place in (("shift of the base along", 3), ("turn of the base about", 0)):
            of_base = to_base @ frames[place : place + 3]
            motions |= {f"{kind} {axis}": row for axis, row in zip(AXES, of_base, strict=True)}
    model = fit.model
    sizes_mm = vectors * model.tolerance[:, None]
    for name, group, row in zip(model.names, model.groups, sizes_mm, strict=True):
        if group == "reflector":
            axis = name.removesuffix("_mm")[-1]
            motions[f"shift of the plate along {axis}"] = row
    if "scale" in model.names:
        motions["one scale of all lengths"] = 1e3 * sizes_mm[model.names.index("scale")]
    return motions


def _places_of_slots(model: ErrorModel) -> list[slice]:
    """Return the places of the unknowns of the surroundings."""
    pairs = zip(model.effects, model.effect_places, strict=True)
    return [where for effect, where in pairs if isinstance(effect, Slot)]


def shot_information(jacobian: Array, weights: Array) -> Array:
    """Return the information Σ A'WA (Q, Q) of derivatives (N, r, Q) and weights (N, r, r)."""
    rows = jacobian.reshape(-1, jacobian.shape[2])
    return np.asarray((weights @ jacobian).reshape(rows.shape).T @ rows)


# Schur complement N_pp - N_pf N_ff⁻¹ N_fp: its inverse is the block of the whole inverse.
def marginal_information(information: Array, size: int) -> Array:
    """Return the information on the first `size` unknowns, the others eliminated."""
    parameters, mixed = information[:size, :size], information[:size, size:]
    frames = information[size:, size:]
    return np.asarray(parameters - mixed @ np.linalg.solve(frames, mixed.T))


# An eigenvalue λ is the χ² by which all shots notice one tolerance along its eigenvector. Below
# 1 / 300², 300 tolerances along it stay within the noise. With 60 shots of any mechanism exact null
# directions lie below 3e-6 by rounding, the weakest ones that shots determine above 2e-5.
def null_directions_of(information: Array, names: tuple[str, ...], prior: Array) -> NullDirections:
    """Return the directions along which information (P, P) is practically zero.

    `prior` (P, P) is the precision of the unknowns before the shots.
    """
    without_effect = _without_effect(information, names)
    return NullDirections.spanned_by(_null_vectors(information), names, prior, without_effect)


def _null_vectors(information: Array) -> Array:
    """Return the directions (P, k) along which information (P, P) is practically zero."""
    values, vectors = np.linalg.eigh(information)
    return np.asarray(vectors[:, values < UNSEEN_TOLERANCES**-2])


def _without_effect(information: Array, names: tuple[str, ...]) -> list[str]:
    """Return the names of the unknowns that never move anything, by their information (P, P)."""
    return [name for name, row in zip(names, information, strict=True) if not row.any()]


# Eigenvectors mix all combinations. Reduced echelon form: QR with column pivoting picks the rows of
# a matrix (R, k) that are most independent, the pivots; multiplied by the inverse of these rows it
# has a 1 at one pivot and 0 at the others. First it is that of the motions M (m, k), of rank r:
# each motion alone, or with those that always come with it. The k - r directions of no motion have
# the form of their unknowns: one parameter with those that can imitate it. Their pivots are taken
# out of the former, which have fewer parameters then.
def _name_combinations(
    null: Array, names: tuple[str, ...], motions: Mapping[str, Array]
) -> list[tuple[str, tuple[str, ...]]]:
    """Return words and parameters of the simplest combinations that span Z (P, k)."""
    count = null.shape[1]
    if not count:
        return []
    moved = np.array([*motions.values()]).reshape(-1, count)
    sizes, by = np.linalg.svd(moved)[1:]
    rank = int((sizes > SAME_MOTION * sizes.max(initial=0.0)).sum())
    still = null @ by[rank:].T
    pivots = _pivots(still)
    still = still @ np.linalg.inv(still[pivots])
    movers = _pivots(moved @ by[:rank].T)
    turned = by[:rank].T @ np.linalg.inv(moved[movers] @ by[:rank].T)
    moving, shares = null @ turned, moved @ turned
    moving = moving - still @ moving[pivots]
    words = [
        " together with ".join(
            word for word, share in zip(motions, column, strict=True) if abs(share) > NAMED_SHARE
        )
        for column in shares.T
    ]
    moving = moving / np.abs(moving).max(axis=0, initial=0.0)
    columns = zip([*words, *[""] * still.shape[1]], [*moving.T, *still.T], strict=True)
    return sorted((word, _named(column, names)) for word, column in columns)


# Rows of arms that are alike are equally independent, and rounding would choose between them: a
# preference of a tenth, shared out over all rows, chooses the first one.
def _pivots(rows: Array) -> Index:
    """Return the k most independent rows of a matrix (R, k) of full rank, the first of equals."""
    count = rows.shape[1]
    if not count:
        return np.zeros(0, dtype=np.int64)
    preferred = rows * np.linspace(1.0, 0.9, len(rows))[:, None]
    return np.asarray(scipy.linalg.qr(preferred.T, pivoting=True, mode="r")[1][:count])


def _named(column: Array, names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the sorted names of the unknowns that have a share in a direction (P,)."""
    return tuple(sorted(names[place] for place in np.flatnonzero(np.abs(column) > NAMED_SHARE)))


# B = (1 - QQ') ∂X/∂x with an orthonormal basis Q of the six motions of the frame.
def without_frame(by: Array, positions: Array) -> Array:
    """Return derivatives of positions (M, 3, P) from which every motion of the frame is removed."""
    return without_motions(by, frame_columns(positions))


# Some motions may be equal, such as turns of base and tool where the tool turns about z alone: the
# singular vectors of columns of unit length have one of both.
def without_motions(by: Array, motions: Array) -> Array:
    """Return derivatives (M, 3, P) less what motions (M, 3, k) of all rows together explain."""
    columns = motions.reshape(-1, motions.shape[2])
    vectors, sizes, _ = np.linalg.svd(
        columns / np.linalg.norm(columns, axis=0), full_matrices=False
    )
    basis, rows = vectors[:, sizes > SAME_MOTION], by.reshape(-1, by.shape[2])
    return np.asarray((rows - basis @ (basis.T @ rows)).reshape(by.shape))


# The base's axes are where their users define them, and so are the tool's own.
def without_axes(by: Array, tool_axes: Array) -> Array:
    """Return derivatives of turns (M, 3, P) without turns of the base's and of the tool's axes.

    `tool_axes` (M, 3, 3) are the tool's axes in the base frame, as columns.
    """
    base = np.broadcast_to(np.eye(3), tool_axes.shape)
    return without_motions(by, np.concatenate([base, tool_axes], axis=2))


def free_turns_deg(model: ErrorModel, x: Array, joints: Array, poses: Array) -> Array:
    """Return the tool's turn by unknowns at joints (N, n) and poses (N, t), (N, 3, P), deg.

    `x` (P,) are the unknowns there. Turns of the base's and of the tool's axes are removed.
    """
    observations = Observations.unmeasured(joints, poses)
    turns = np.degrees(model.turns_by_unknowns(x, observations, poses))
    return without_axes(turns, model.nominal.mechanism.tool_axes(poses))


def length_std(by: Array, covariance: Array) -> Array:
    """Return 1 σ of vectors, √tr(B C B') with their derivatives B (M, 3, P), (M,)."""
    return np.asarray(np.sqrt(((by @ covariance) * by).sum(axis=(1, 2))))


# As C⁻¹ = w A'WA + D and W = W (Σ φ_k V_k) W,
#     C = C C⁻¹ C = C (Σ_k φ_k w A'W V_k W A + Σ_g D_g) C
# and each part k of the noise and each group g of priors has a term of its own in B C B'. A part's
# term is the sum of squares of √w L'W A C B' with L L' = φ V, by eigenvectors: noise along the beam
# alone, or scatter that rows share, is singular. A former result is one prior of
# all unknowns, whose rows are no sources by themselves. Unknown sizes have the rest of B C B'.
def budget(fit: Fit, by: Array) -> Mapping[str, float]:
    """Return the mean squares (mm²) that each source gives to positions with derivatives `by`.

    `by` (M, 3, P) are by all unknowns but frames, with the frame's motion removed. The shares add
    up exactly to the mean square of `length_std`.
    """
    model, size, points = fit.model, fit.model.size, len(by)
    rows = by.reshape(-1, size)
    influence = rows @ fit.inverse[:size]  # B C
    shares: dict[str, float] = {}
    for observed in fit.rows:
        root = (observed.good**0.5)[:, None, None]
        weighted = root * (observed.inverse_noise @ observed.jacobian)
        for part, covariance in observed.noise.items():
            variances, axes = np.linalg.eigh(fit.factors[part] * covariance)
            noise = axes * np.sqrt(np.maximum(variances, 0.0))[:, None]
            of_part = (noise.swapaxes(1, 2) @ weighted).reshape(-1, len(fit.inverse))
            share = float(((of_part @ influence.T) ** 2).sum()) / points
            shares[part] = shares.get(part, 0.0) + share
    is_former = fit.prior.precision is not None
    groups = [FORMER] * len(model.names) if is_former else [*model.groups]
    groups += [effect.source for effect in model.effects for _ in range(effect.count)]
    for group in dict.fromkeys(groups):
        places = [place for place, member in enumerate(groups) if member == group]
        of_group = influence[:, places] @ fit.precision[np.ix_(places, range(len(fit.inverse)))]
        shares[group] = shares.get(group, 0.0) + float((of_group * influence).sum()) / points
    if fit.spread is not None:
        spread = (rows @ fit.spread[:size, :size]) * rows
        shares[SIZES] = float(spread.sum()) / points
    return shares


# Between shots a layer keeps the part of its variance that its functions there do not explain.
def unseen_covariances(
    fit: Fit, by_moves: Mapping[Moved, Array], observations: Observations
) -> Array:
    """Return the covariance (N, 3, 3) of points by what layers may be between the shots, mm²."""
    covariance = np.zeros((len(observations), 3, 3))
    for layer in fit.model.effects:
        if not isinstance(layer, Layer):
            continue
        sizes = [layer.usual * fit.sizes[group] for group, _ in layer.sizes_of]
        by = by_moves[layer.moves] * np.resize(sizes, by_moves[layer.moves].shape[2])
        shares = layer.unseen_share(observations)[:, None, :]
        covariance += (by * shares) @ by.swapaxes(1, 2)
    return covariance


# Frames are flat, so that they follow from the other unknowns u: with the normal equations N of the
# shots, f is normal about -N_ff⁻¹ N_fu u with the covariance N_ff⁻¹. Rows of the joint covariance
# would do, but they are of the linear model from before sizes were averaged: a datum of 10 mrad, of
# which 1/1000 is not cancelled, then widens points by 0.03 mm.
def frame_of_today(fit: Fit) -> tuple[Transform, Array]:
    """Return the last session's frame at its end, with the changes that last, and its covariance.

    The covariance (6, P + 6) is with the unknowns of today, and with its own turns (mrad) and
    shifts (mm).
    """
    model, size = fit.model, fit.model.size
    of_frame = model.frame_of_today(len(fit.at.frames))
    by_frames, normal = of_frame[:, size:], fit.normal[0]
    inverse = np.linalg.inv(normal[size:, size:])
    follows = of_frame[:, :size] - by_frames @ inverse @ normal[size:, :size]
    shared = follows @ fit.covariance[:size, :size]
    itself = shared @ follows.T + by_frames @ inverse @ by_frames.T
    (frame,) = moved_frames(fit.at.frames[-1:], of_frame[:, :size] @ fit.at.x)
    return frame, np.hstack([shared @ model.of_today.T, itself])
