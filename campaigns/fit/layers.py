"""Residual layers: errors that depend on the place or on an arm's angle, and have no column.

Theory of operation. A robot may have errors for which the table has no source: a beam that bends
with a kink, a cable that pulls in a corner, an arm that is not straight. They do not look like
wrong shots, leave next to nothing out, and make a result up to four times too sure. A Gaussian
process sees them (`effects.Layer`): over the workspace, with a size for each direction, or over
each arm's angle. Layers of several lengths and coordinates compete; the mean of their evidence
decides whether one is added, so that trying many costs nothing.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.effects import Layer, place_coordinates
from campaigns.fit.error_sources import DEG
from campaigns.fit.fit import Fit

LAYERS = ("place", "arms")
"""Kinds of layers: a campaign has at most one of each."""
PLACE_LENGTHS = (0.25, 0.5, 1.0)
"""Correlation lengths over the workspace, in its largest radius."""
ANGLE_LENGTHS = (0.1, 0.25, 0.5)
"""Correlation lengths over the joints, in the largest motion of one."""
USUAL_MM = 0.020
"""Usual size of a layer over the workspace."""
USUAL_RAD = 0.01 * DEG
"""Usual size of a layer over the angles of cranks; of carriages it is `USUAL_MM`."""
SIZES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Sizes of a layer, in usual sizes, at which its evidence is summed: alike likely."""
SIGNIFICANT = 2.0
"""Standard deviations of the score from which a layer's evidence is computed at all."""
MOST_KNOTS = 300
"""Most shots by whose places a layer's functions are made: their cost grows with the cube. They lie
nearer to each other than the shots of usual campaigns; what is between them counts as unseen."""
LEFT_OUT = 2
"""Shots left out from which layers are also judged with all shots in the fit."""


def likely_layers(fit: Fit) -> Iterator[Layer]:
    """Yield the likeliest layer, if the mean of all layers' Bayes factors exceeds 1."""
    # At most one layer of each kind: a second would share its directions with the first.
    present = {effect.kind for effect in fit.model.effects if isinstance(effect, Layer)}
    layers = [layer for layer in candidate_layers(fit) if layer.kind not in present]
    variants = [fit]
    if (fit.usable & ~fit.kept).sum() >= LEFT_OUT:
        variants.append(replace(fit, good=fit.usable.astype(np.float64)))
    for variant in variants if layers else ():
        factors = log_factors(variant, layers)
        log_mean = float(np.logaddexp.reduce(factors) - np.log(len(factors)))
        if log_mean > 0.0:
            # with these odds the evidence of the best one is the mean of all
            yield replace(layers[int(factors.argmax())], log_odds=log_mean - float(factors.max()))


def candidate_layers(fit: Fit) -> list[Layer]:
    """Return the layers over the shots of a fit: three lengths of each set of coordinates."""
    knots = np.flatnonzero(fit.usable)
    knots = knots[np.linspace(0, len(knots) - 1, min(len(knots), MOST_KNOTS)).astype(np.intp)]
    poses, joints = fit.observations.near[knots], fit.observations.joints[knots]
    radius = float(np.hypot(*(poses[:, :2] - poses[:, :2].mean(axis=0)).T).max())
    turn_mm = radius / 1.5
    places = place_coordinates(poses, turn_mm)
    layers = [
        Layer.over("place", (places[:, :columns],), length * radius, USUAL_MM, turn_mm)
        for length in PLACE_LENGTHS
        for columns in range(2, places.shape[1] + 1)
    ]
    kinds = {axis.is_revolute for axis in fit.model.nominal.mechanism.joints}
    if len(kinds) > 1:
        return layers  # no length compares angles of cranks with ways of carriages
    angles = tuple(joint[:, None] for joint in joints.T)
    span, usual = float(np.ptp(joints)), USUAL_RAD if kinds == {True} else USUAL_MM
    return layers + [Layer.over("arms", angles, length * span, usual) for length in ANGLE_LENGTHS]


# With whitened residuals e and the projector M off all other unknowns, e ~ N(0, 1) in their space.
# A layer with whitened columns c adds s² c c'; with the eigenvalues g and eigenvectors V of c'M c
#
#     log B(s) = ½ Σ s² u_j² / (1 + s² g_j) - ½ Σ log(1 + s² g_j),   u = V' c'M e.
#
# The score at s = 0, ½ (Σ u² - Σ g), has the standard deviation √(½ Σ g²) without a layer: most
# layers of a good robot are dismissed by it, without eigenvalues. Each direction of a place has a
# size of its own and is there or not, with even odds.
def log_factors(fit: Fit, layers: list[Layer]) -> Array:
    """Return the log Bayes factor of each layer, the mean over sizes."""
    white = fit.whitened
    values = np.zeros(len(layers))
    for number, layer in enumerate(layers):
        columns, begin = white.columns(fit.at.columns_of(layer, fit.observations)), 0
        for _, count in layer.sizes_of:
            block, begin = columns[:, begin : begin + count], begin + count
            factor = _log_factor(white.information(block), block.T @ white.residual)
            values[number] += np.logaddexp(0.0, factor) - np.log(2.0)
    return values


def _log_factor(information: Array, score: Array) -> float:
    """Return log B of columns with this information (k, k) and score (k,); -∞ if unlikely."""
    excess = float(score @ score - np.trace(information))
    if excess <= SIGNIFICANT * np.sqrt(2.0 * float((information**2).sum())):
        return -np.inf
    eigenvalues, vectors = np.linalg.eigh(information)
    eigenvalues, u2 = np.maximum(eigenvalues, 0.0), (vectors.T @ score) ** 2
    of_sizes = [
        0.5 * float((s**2 * u2 / (1.0 + s**2 * eigenvalues)).sum())
        - 0.5 * float(np.log1p(s**2 * eigenvalues).sum())
        for s in SIZES
    ]
    return float(np.logaddexp.reduce(of_sizes) - np.log(len(SIZES)))
