"""Variance components: how much the robot itself scatters, beside what the tracker states.

Σ_i = C_i + s² 1 + σ_q² J_i J_iᵀ: the tracker's covariance, scatter of the point in space, and
scatter of the joints through J = ∂position/∂joints. Restricted maximum likelihood (REML; Patterson
and Thompson 1971) finds s and σ_q with the unknowns of the fit integrated out, and takes each only
where the likelihood asks for it.
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import SHOTS_AT_ONCE, Array, Index, Mask
from campaigns.estimation.gauss_newton import LEAST_PIVOT
from campaigns.estimation.observability import column_norms, triangle_of
from campaigns.estimation.tracker_noise import inverse_roots

WORTH = 6.0
"""Gain in 2 log L that a component must bring."""
SMALLEST = 1e-3
"""Of a component's standard deviation in parts of what is stated: below it nothing can be told."""
LARGEST = 1e4
HOPELESS_SCORE = 1.5
"""Score below which no component gains `WORTH`: that takes about 2.4 if there are many shots."""
MANY = 90
"""Degrees of freedom from which that holds, however unlike a tracker's σ along its axes are."""
TINY = 1e-300
PROMISING = 1.0
"""Gain beside the first component from which both are sought together."""
SEARCHED_BELOW = 3.0
"""A second component is sought between what it would be alone and e⁻³ of it."""
NOWHERE = -math.inf
CLEAR = 1.0
"""In 2 log L: by so much no further search would choose other components."""
UNMOVED = 0.01
"""Relative change of a component that tells nothing new, half of what a fit is made again for."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearizedShots:
    """Points of N shots about an estimate, to first order, in the tracker's axes."""

    residual_mm: Array
    """Modelled minus measured, (N, 3)."""
    jacobian: Array
    """∂point/∂unknowns, (N, 3, P)."""
    stated_mm2: Array
    """Covariance that the tracker states, (N, 3, 3)."""
    by_joints: Array
    """∂point/∂joints, (N, 3, n), mm per rad or mm; (N, 3, 0) where the robot's scatter is none."""

    def __len__(self) -> int:
        return len(self.residual_mm)

    def rows(self, rows: Index | Mask) -> "LinearizedShots":
        """Some of them, by number or mask."""
        return LinearizedShots(
            self.residual_mm[rows], self.jacobian[rows], self.stated_mm2[rows], self.by_joints[rows]
        )


@dataclass(frozen=True, slots=True)
class VarianceComponents:
    """Standard deviations of the robot's own scatter, with their own 1 σ where found."""

    point_mm: float = 0.0
    joint: float = 0.0
    """rad, or mm of a carriage."""
    point_mm_std: float = 0.0
    joint_std: float = 0.0

    @property
    def any(self) -> bool:
        """Presence of any scatter of the robot's own."""
        return self.point_mm > 0.0 or self.joint > 0.0

    def covariance_mm2(self, stated_mm2: Array, by_joints: Array) -> Array:
        """Covariance of points, the robot's scatter included, (N, 3, 3)."""
        through = by_joints @ by_joints.swapaxes(1, 2)
        return np.asarray(stated_mm2 + self.point_mm**2 * np.eye(3) + self.joint**2 * through)


NONE = VarianceComponents()


def estimate_components(
    shots: LinearizedShots, before: VarianceComponents = NONE
) -> VarianceComponents:
    """Components that the likelihood asks for; none with too few shots to tell any.

    `before`: those of the same shots about another fit, which stay where they hardly move.
    """
    count, unknowns = shots.residual_mm.size, shots.jacobian.shape[-1]
    if count <= unknowns + 2:
        return NONE
    likelihood: _RestrictedLikelihood | None = None
    if (before.point_mm > 0.0) != (before.joint > 0.0):
        likelihood = _RestrictedLikelihood(shots)
        if likelihood.is_top(before):
            return before
    found = _scores(shots)
    least = hopeless_score(count - unknowns)
    hopeful = [place for place, score in enumerate(found) if score >= least]
    if not hopeful:
        return NONE
    likelihood = likelihood or _RestrictedLikelihood(shots)
    none, best = likelihood.at(NOWHERE, NOWHERE), {}
    for place in hopeful:
        best[place] = likelihood.best_single(place)
    if max(best.values(), key=lambda each: each[0])[0] - none <= WORTH:
        return NONE
    singles = [best.get(place) or likelihood.best_single(place) for place in (0, 1)]
    value, logs = max(singles, key=lambda each: each[0])
    both_value, both = likelihood.best_pair(singles)
    if both_value - value > WORTH:
        logs = both
    return likelihood.components(logs)


def hopeless_score(dof: int) -> float:
    """Score below which no component gains `WORTH`; with 14 degrees of freedom 0.15 can do."""
    return HOPELESS_SCORE * min(1.0, dof / MANY) ** 2


def _scores(shots: LinearizedShots) -> Array:
    """Scores of the two components at none, (2,)."""
    inverse = inverse_roots(shots.stated_mm2)
    rows = np.concatenate([shots.jacobian, shots.residual_mm[:, :, None]], axis=2)
    whitened = inverse @ rows
    by_shot = _orthonormal(whitened[:, :, :-1])
    if by_shot is None:
        flat = whitened[:, :, :-1].reshape(-1, rows.shape[-1] - 1)
        basis = np.linalg.qr(flat / np.maximum(column_norms(flat), TINY))[0]
        by_shot = basis.reshape(len(shots), 3, -1)
    basis, residual = by_shot.reshape(3 * len(shots), -1), whitened[:, :, -1].ravel()
    left = (residual - basis @ (basis.T @ residual)).reshape(-1, 3)
    leverage = by_shot @ by_shot.swapaxes(1, 2)
    columns = (inverse, inverse @ shots.by_joints)
    return np.array([_component_score(left, leverage, each) for each in columns])


def _component_score(left: Array, leverage: Array, columns: Array) -> float:
    """Score of a component at none, in about its own standard deviation.

    It is the slope of the likelihood there: without one there is nothing to be gained. Of whitened
    residuals (N, 3) after a fit, its leverages (N, 3, 3), and the whitened columns (N, 3, k).
    """
    own = columns @ columns.swapaxes(1, 2)
    told = np.einsum("nik,ni->nk", columns, left)
    expected = np.einsum("nii->", own) - np.einsum("nij,nij->", leverage, own)
    spread = np.sqrt(2.0 * np.sum(own**2))
    return float((np.sum(told**2) - expected) / spread)


def _orthonormal(columns: Array) -> Array | None:
    """Orthonormal columns (N, 3, P) of the space of others; None where they nearly depend.

    By their squares, which tell them well enough apart in a fraction of a QR's time.
    """
    flat = columns.reshape(3 * len(columns), -1)
    flat = flat / np.maximum(column_norms(flat), TINY)
    try:
        triangle = np.linalg.cholesky(flat.T @ flat).T
    except np.linalg.LinAlgError:
        return None
    if np.diag(triangle).min() <= LEAST_PIVOT:
        return None
    return np.asarray(flat @ np.linalg.inv(triangle)).reshape(columns.shape)


class _RestrictedLikelihood:
    """2 log L of the logarithms of both standard deviations, in parts of typical stated ones."""

    def __init__(self, shots: LinearizedShots) -> None:
        self._shots = shots
        self._through = shots.by_joints @ shots.by_joints.swapaxes(1, 2)
        jacobian = _orthonormal(shots.jacobian)
        self._is_orthonormal = jacobian is not None
        """Whether columns are so far from dependence that their squares, which take a fraction
        of the time of a QR, tell as much."""
        if jacobian is None:
            scale = column_norms(shots.jacobian.reshape(-1, shots.jacobian.shape[-1]))
            jacobian = shots.jacobian / np.where(scale > 0.0, scale, 1.0)
        self._rows = np.concatenate([jacobian, shots.residual_mm[:, :, None]], axis=2)
        typical_mm = math.sqrt(float(np.trace(shots.stated_mm2, axis1=1, axis2=2).mean()) / 3.0)
        lever = math.sqrt(float(np.trace(self._through, axis1=1, axis2=2).mean()) / 3.0)
        self._units = (typical_mm, typical_mm / lever if lever > 0.0 else 1.0)

    def at(self, log_point: float, log_joint: float) -> float:
        """2 log L but for a constant; -∞ where a covariance is none."""
        point, joint = self._std(log_point, log_joint)
        covariance = self._shots.stated_mm2 + point**2 * np.eye(3) + joint**2 * self._through
        try:
            inverse = inverse_roots(covariance)
            if self._is_orthonormal:
                own = np.diag(np.linalg.cholesky(self._squares(inverse)))
            else:
                rows = (inverse @ self._rows).reshape(-1, self._rows.shape[-1])
                own = np.abs(np.diag(triangle_of(rows)))
        except np.linalg.LinAlgError:
            return NOWHERE
        known = own[:-1] > own[:-1].max() * np.finfo(np.float64).eps * 3 * len(inverse)
        size = -2.0 * float(np.log(np.einsum("nii->ni", inverse)).sum())
        return -(size + 2.0 * float(np.log(own[:-1][known]).sum()) + float(own[-1] ** 2))

    def _squares(self, inverse: Array) -> Array:
        """Products of all whitened columns, of some shots at a time, which stay in the cache."""
        found = np.zeros((self._rows.shape[-1],) * 2)
        for first in range(0, len(inverse), SHOTS_AT_ONCE):
            some = slice(first, first + SHOTS_AT_ONCE)
            rows = (inverse[some] @ self._rows[some]).reshape(-1, len(found))
            found += rows.T @ rows
        return found

    def best_single(self, place: int) -> tuple[float, tuple[float, float]]:
        """Best value with one component alone, and where it is."""
        low, high = math.log(SMALLEST), math.log(LARGEST)
        value, log = self._best_along(place, NOWHERE, low, high, 0.02)
        return value, self._logs(place, log)

    def _best_along(
        self, place: int, other: float, low: float, high: float, tolerance: float
    ) -> tuple[float, float]:
        """Best value with the logarithm of one component between bounds, and where it is."""

        def less(log: float) -> float:
            return -self.at(*((log, other) if place == 0 else (other, log)))

        found = scipy.optimize.minimize_scalar(
            less, bounds=(low, high), method="bounded", options={"xatol": tolerance}
        )
        return -float(found.fun), float(found.x)

    def best_pair(
        self, singles: list[tuple[float, tuple[float, float]]]
    ) -> tuple[float, tuple[float, float]]:
        """Best value with both components, sought where a second one beside the first gains."""
        value, logs = max(singles, key=lambda each: each[0])
        second = 1 if logs[1] == NOWHERE else 0

        high = singles[second][1][second]
        low = max(high - SEARCHED_BELOW, math.log(SMALLEST))
        high = max(high, low + SEARCHED_BELOW)
        along, log = self._best_along(second, logs[1 - second], low, high, 0.05)
        if along - value < PROMISING:
            return value, logs

        def less(place: Array) -> float:
            return -self.at(float(place[0]), float(place[1]))

        found = scipy.optimize.minimize(
            less,
            np.array((logs[0], log) if second == 1 else (log, logs[1])),
            method="Nelder-Mead",
            options={"xatol": 0.01, "fatol": 0.01, "maxfev": 120},
        )
        return -float(found.fun), (float(found.x[0]), float(found.x[1]))

    def is_top(self, one: VarianceComponents) -> bool:
        """Whether a single component hardly moves, and neither none, the other nor both gain."""
        place = 0 if one.point_mm > 0.0 else 1
        log = math.log((one.point_mm or one.joint) / self._units[place])
        value, nothing = self.at(*self._logs(place, log)), self.at(NOWHERE, NOWHERE)
        beside = [self.at(*self._logs(place, log + by)) for by in (-UNMOVED, UNMOVED)]
        other = self.at(*self._logs(1 - place, log))  # which moves the points as far
        both = [(log, log - by) if place == 0 else (log - by, log) for by in (1.0, 2.0)]
        return (
            max(beside) < value
            and nothing + WORTH + CLEAR < value
            and other + CLEAR < value
            and max(self.at(*each) for each in both) + CLEAR < value + WORTH
        )

    def components(self, logs: tuple[float, float]) -> VarianceComponents:
        """With standard deviations from the curvature of the likelihood at its top."""
        point, joint = self._std(*logs)
        point_std, joint_std = (self._relative_std(logs, place) for place in (0, 1))
        return VarianceComponents(point, joint, point * point_std, joint * joint_std)

    def _relative_std(self, logs: tuple[float, float], place: int) -> float:
        if logs[place] == NOWHERE:
            return 0.0
        step = 0.05
        lower, upper = list(logs), list(logs)
        lower[place] -= step
        upper[place] += step
        bend = 2.0 * self.at(*logs) - self.at(lower[0], lower[1]) - self.at(upper[0], upper[1])
        return math.sqrt(2.0 * step**2 / bend) if bend > 0.0 else 1.0

    def _std(self, log_point: float, log_joint: float) -> tuple[float, float]:
        return self._units[0] * math.exp(log_point), self._units[1] * math.exp(log_joint)

    @staticmethod
    def _logs(place: int, log: float) -> tuple[float, float]:
        return (log, NOWHERE) if place == 0 else (NOWHERE, log)
