"""Wrong shots: the probability of each shot to be good, by the fit without it.

Theory of operation. A shot is good, with the noise of the model, or wrong: then its point has a
further error N(0, λ² 1), whose size λ is unknown, log-uniform from 0.1 to 100 mm. The share of
wrong shots is unknown too, with a Beta prior. A shot is judged by the fit without it, its cavity:
with the weight w W that it had, residual r and the covariance H = A C A' of its predicted point,

    residual without it (1 - w H W)⁻¹ r,    its covariance V + (1 - w H W)⁻¹ H,

so a shot that was followed and one that was left out are judged by one formula. The probability of
being good is the weight of a shot in the next fit (expectation maximisation).

Many wrong shots of one size inflate the scatter and hide in it. So the first weights are those of
Cauchy-distributed errors, which hardly notice them, then three concentration steps (Rousseeuw and
Van Driessen 1999): fit to the 60 % that fit best.
"""

import numpy as np
import scipy

from campaigns.arrays import Array, Mask

SIZES_MM = np.geomspace(0.1, 100.0, 7)
"""Sizes of the errors of wrong shots, alike likely."""
WRONG_BEFORE, GOOD_BEFORE = 1.0, 50.0
"""Beta prior of the share of wrong shots: as if 1 of 51 had been wrong before."""
CORE_SHARE = 0.6
"""Share of the shots to which a concentration step fits."""
CORE_OF_OTHERS = 0.5
"""That of other kinds of observation, which people type: half a list may be of another thing."""


def cavity(residual: Array, by_unknowns: Array, noise: Array, weight: Array) -> tuple[Array, Array]:
    """Return residuals (N, r) and their covariances (N, r, r) by the fit without each shot.

    `by_unknowns` (N, r, r) are the covariances A C A' of the predicted points or other rows,
    `noise` those of the measured ones, `weight` (N,) what each shot counted in the fit.
    """
    kept = np.eye(residual.shape[1]) - weight[:, None, None] * (by_unknowns @ np.linalg.inv(noise))
    without = np.linalg.solve(kept, residual[..., None])[..., 0]
    covariance = noise + np.linalg.solve(kept, by_unknowns)
    return np.asarray(without), np.asarray(covariance)


def log_densities(residual: Array, covariance: Array) -> tuple[Array, Array]:
    """Return the log densities (N,) of cavity residuals of good and of wrong shots."""
    good = _log_normal(residual, covariance)
    wrong = [
        _log_normal(residual, covariance + size**2 * np.eye(residual.shape[1])) for size in SIZES_MM
    ]
    return good, np.logaddexp.reduce(wrong, axis=0) - np.log(len(SIZES_MM))


def probabilities_of_good(good: Array, wrong: Array, share: float, usable: Mask) -> Array:
    """Return the probability (N,) of each shot to be good, 0 for shots that are not `usable`.

    At most half of the shots are wrong: among more the good ones could not be distinguished.
    """
    log_odds = np.log(share / (1.0 - share)) + wrong - good
    probability = scipy.special.expit(-log_odds) * usable
    if probability.sum() < 0.5 * usable.sum():
        probability = (log_odds <= np.median(log_odds[usable])) * usable * 1.0
    return np.asarray(probability)


def share_of_wrong(probability: Array, usable: Mask) -> float:
    """Return the mean of the posterior of the share of wrong shots, ½ at most."""
    wrong = float((1.0 - probability[usable]).sum())
    share = (wrong + WRONG_BEFORE) / (float(usable.sum()) + WRONG_BEFORE + GOOD_BEFORE)
    return min(share, 0.5)


def cauchy_weights(chi2: Array, rows: int = 3) -> Array:
    """Return the weights (N,) of Cauchy-distributed errors by expected χ² of residuals.

    `rows` is the number of coordinates of an error.
    """
    return np.asarray((rows + 1.0) / (1.0 + chi2))


def core_of(chi2: Array, usable: Mask, share: float = CORE_SHARE) -> Array:
    """Return the weights (N,), 1 or 0, of a concentration step by χ² of cavity residuals.

    `share` of the shots have a weight.
    """
    if not usable.any():
        return np.zeros(len(usable))
    return np.asarray((chi2 <= np.quantile(chi2[usable], share)) * usable * 1.0)


def log_prior_of_count(wrong: int, count: int) -> float:
    """Return the log probability of certain `wrong` shots out of `count` (Beta-binomial)."""
    return float(scipy.special.betaln(wrong + WRONG_BEFORE, count - wrong + GOOD_BEFORE))


def _log_normal(residual: Array, covariance: Array) -> Array:
    """Return the log density of residuals (N, r) up to a constant."""
    misfit = (residual * np.linalg.solve(covariance, residual[..., None])[..., 0]).sum(axis=1)
    return np.asarray(-0.5 * (misfit + np.linalg.slogdet(covariance)[1]))
