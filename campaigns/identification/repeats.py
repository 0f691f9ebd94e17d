"""Repeats: whether the scatter of a fit is the robot's repeatability.

The fit explains what no unknown explains as scatter, alike at all shots. A robot that scatters does
so at one pose as well: visits of the same pose, such as drift shots and repeatability visits, show
it. Where they scatter less than the fit says, the rest is an error of the model that repeats, and
an error of every position.
"""

from dataclasses import dataclass

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


@dataclass(frozen=True, slots=True, eq=False)
class _Visits:
    """Visits of poses: how far each is from the mean of its pose, and what noise it has."""

    deviations: Array
    """(N, 3), mm."""
    stated: Array
    """Covariance of the tracker's noise, (N, 3, 3)."""
    scatter: Array
    """Covariance of the robot's scatter as the fit has it, (N, 3, 3)."""
    freedom: int
    """Degrees of freedom of all deviations."""


@dataclass(frozen=True, slots=True)
class PlannedVisits:
    """Visits of one pose, and what they will show of the scatter."""

    visits: int
    """All visits of the pose."""
    seconds: float
    """Time beyond that of the plan."""
    scatter_std: float
    """1 σ of their scatter, relative to it."""
    shown_share: float
    """Least share of the fit's scatter, as a variance, that they show to repeat, by even chance."""


# The scatter s of k visits has ν = 3 (k - 1) degrees of freedom: σ(s)/s = 1/√(2 ν). If a share e of
# the fit's scatter repeats, the ratio of variances is (1 - e) F. Half of all ratios are below
# (1 - e) times the median of F, so that half of all campaigns show e where that is the limit of F.
def planned_visits(visits: int, fit_freedom: float, seconds: float = 0.0) -> PlannedVisits:
    """Return what two or more visits of one pose will show beside a fit's degrees of freedom."""
    freedom = 3 * (visits - 1)
    limit, median = scipy.special.fdtri(freedom, fit_freedom, [LEVEL, 0.5])
    return PlannedVisits(visits, seconds, (2.0 * freedom) ** -0.5, 1.0 - float(limit / median))


# Deviations d of visits from the mean of their pose have the noise V of a shot, less what the mean
# took up: Σ d'V⁻¹d has 3 (k - 1) degrees of freedom. It is divided by the scatter of the fit, which
# has degrees of freedom of its own, so that its size is compared by F.
def repeating_share(fit: Fit, shots: Shots, observations: Observations) -> float:
    """Return the share of the fit's scatter, as a variance, that repeats; 0 if none is shown.

    `observations` are of all `shots`.
    """
    visits = _visits(fit, shots, observations)
    if visits is None:
        return 0.0
    ratio = _chi2(visits, 1.0) / visits.freedom
    if scipy.special.fdtr(visits.freedom, max(fit.freedom, 1.0), ratio) >= LEVEL:
        return 0.0
    shares = np.linspace(0.0, 1.0, 51)
    likeliest = int(np.argmax([_log_likelihood(visits, share) for share in shares]))
    return 1.0 - float(shares[likeliest])


def _chi2(visits: _Visits, share: float) -> float:
    """Return Σ d'V⁻¹d with a share of the robot's scatter."""
    covariance = visits.stated + share * visits.scatter
    scaled = np.linalg.solve(covariance, visits.deviations[..., None])[..., 0]
    return float((visits.deviations * scaled).sum())


def _log_likelihood(visits: _Visits, share: float) -> float:
    """Return the log likelihood of a share of the robot's scatter, up to a constant."""
    # the means took up some of the coordinates: each determinant counts for what is left
    log_sizes = np.linalg.slogdet(visits.stated + share * visits.scatter)[1]
    share_left = visits.freedom / (3.0 * len(visits.deviations))
    return -0.5 * _chi2(visits, share) - 0.5 * share_left * float(log_sizes.sum())


def _visits(fit: Fit, shots: Shots, observations: Observations) -> _Visits | None:
    """Return the visits of poses that were visited more than once; None without any."""
    rows = shots.rows_of(*REPEATED)
    rows = rows[(observations.frame[rows] >= 0) & np.isfinite(observations.near[rows]).all(axis=1)]
    if not len(rows):
        return None
    # predicted points take out the joints read and the slow motion of the stand
    measured = observations.rows(rows)
    at = fit.model.predict(fit.at.x, fit.at.frames, measured, measured.near)
    poses = np.column_stack([np.round(shots.commanded[rows], 6), observations.frame[rows]])
    _, of_pose, counts = np.unique(poses, axis=0, return_inverse=True, return_counts=True)
    of_pose = of_pose.ravel()
    is_again = (counts[of_pose] > 1) & np.isfinite(at.residual).all(axis=1)
    freedom = 3 * int(is_again.sum() - len(np.unique(of_pose[is_again])))
    if freedom <= 0:
        return None
    means = np.stack(
        [at.residual[is_again & (of_pose == pose)].mean(axis=0) for pose in of_pose[is_again]]
    )
    parts = noise_parts(fit.model, measured, at.by_joint)
    stated, scatter = np.zeros((2, int(is_again.sum()), 3, 3))
    for part, covariance in parts.items():
        of_part = fit.factors.get(part, 1.0) * covariance[is_again]
        if part in SCATTER:
            scatter += of_part
        else:
            stated += of_part
    return _Visits(at.residual[is_again] - means, stated, scatter, freedom)
