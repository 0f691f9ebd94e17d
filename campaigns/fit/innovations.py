"""Shots that were never fitted, judged by the posterior.

The error of such shots has the covariance of the parameters and of their own noise, whose χ² tests
the whole model.
"""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.error_model import Linearised, Observations
from campaigns.fit.posterior import Posterior, noise_parts


@dataclass(frozen=True, slots=True, eq=False)
class Innovations:
    """Errors of shots that were not fitted, and their covariance by the posterior."""

    at: Linearised
    errors: Array
    """Predicted minus measured, (3 M,), mm."""
    covariance: Array
    """(3 M, 3 M)"""


def innovations(posterior: Posterior, observations: Observations) -> Innovations:
    """Predict shots (M) of the sessions that were fitted, in their frames."""
    model = posterior.model
    at = model.linearise(observations, posterior.x, posterior.at.frames, observations.near)
    parts = noise_parts(model, observations, at.by_joint)
    factors = posterior.components.factors
    noise = sum(factors.get(part, 1.0) * covariance for part, covariance in parts.items())
    rows = at.jacobian.reshape(-1, at.jacobian.shape[2])
    covariance = rows @ posterior.covariance_without_changes @ rows.T
    for shot, block in enumerate(np.asarray(noise)):
        place = slice(3 * shot, 3 * shot + 3)
        covariance[place, place] += block
    return Innovations(at, at.residual.ravel(), covariance)
