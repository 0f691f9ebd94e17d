"""Repeats: whether the scatter of a fit is the robot's repeatability.

The fit explains what no unknown explains as scatter, alike at all shots. A robot that scatters does
so at one pose as well: visits of the same pose, such as drift shots and repeatability visits, show
it. Where they scatter less than the fit says, the rest is an error of the model that repeats, and
an error of every position.
"""

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.fit.error_model import Observations
from campaigns.fit.fit import Fit, noise_parts
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

LEVEL = 0.05
"""Probability that visits scatter so little by chance, below which they contradict the fit."""
SCATTER = ("points", "joints")
"""Parts of the noise that are the robot's scatter."""
REPEATED = (ShotSet.DRIFT, ShotSet.REPEATABILITY)
"""Sets in which poses are visited again."""


# Deviations d of visits from the mean of their pose have the noise V of a shot, less what the mean
# took up: Σ d'V⁻¹d has 3 (k - 1) degrees of freedom. It is divided by the scatter of the fit, which
# has degrees of freedom of its own, so that its size is compared by F.
def repeating_share(fit: Fit, shots: Shots, observations: Observations) -> float:
    """Return the share of the fit's scatter, as a variance, that repeats; 0 if none is shown.

    `observations` are of all `shots`.
    """
    deviations, stated, scatter, dof = _visits(fit, shots, observations)
    if dof == 0:
        return 0.0
    chi2 = _chi2(deviations, stated + scatter)
    if scipy.special.fdtr(dof, max(fit.freedom, 1.0), chi2 / dof) >= LEVEL:
        return 0.0
    shares = np.linspace(0.0, 1.0, 51)
    log_likelihood = [
        -0.5 * _chi2(deviations, stated + share * scatter)
        - 0.5
        * dof
        / len(deviations)
        / 3.0
        * float(np.linalg.slogdet(stated + share * scatter)[1].sum())
        for share in shares
    ]
    return 1.0 - float(shares[int(np.argmax(log_likelihood))])


def _chi2(deviations: Array, covariance: Array) -> float:
    """Return Σ d'V⁻¹d of deviations (N, 3) with covariances (N, 3, 3)."""
    scaled = np.linalg.solve(covariance, deviations[..., None])[..., 0]
    return float((deviations * scaled).sum())


def _visits(fit: Fit, shots: Shots, observations: Observations) -> tuple[Array, Array, Array, int]:
    """Return deviations of visits from their pose's mean (N, 3), their noise, and its freedom.

    The noise is the tracker's (N, 3, 3) and the robot's scatter (N, 3, 3) as the fit has it.
    """
    # Predicted points take out the joints read and the slow motion of the stand.
    rows = shots.rows_of(*REPEATED)
    rows = rows[(observations.frame[rows] >= 0) & np.isfinite(observations.near[rows]).all(axis=1)]
    deviations, used, dof = [], [], 0
    if len(rows):
        visits = observations.rows(rows)
        at = fit.model.predict(fit.at.x, fit.at.frames, visits, visits.near)
        poses = np.column_stack([np.round(shots.commanded[rows], 6), observations.frame[rows]])
        _, of_pose = np.unique(poses, axis=0, return_inverse=True)
        for pose in range(int(of_pose.max()) + 1):
            members = np.flatnonzero(of_pose.ravel() == pose)
            residual = at.residual[members]
            if len(members) > 1 and np.isfinite(residual).all():
                deviations.append(residual - residual.mean(axis=0))
                used.append(members)
                dof += 3 * (len(members) - 1)
    if not dof:
        empty = np.zeros((0, 3, 3))
        return np.zeros((0, 3)), empty, empty, 0
    parts = noise_parts(fit.model, visits, at.by_joint)
    members = np.concatenate(used)
    sums = [
        sum((fit.factors.get(part, 1.0) * covariance[members] for part, covariance in parts.items()
             if (part in SCATTER) is is_scatter), np.zeros((len(members), 3, 3)))
        for is_scatter in (False, True)
    ]  # fmt: skip
    return np.concatenate(deviations), sums[0], sums[1], dof
