"""Variance components: how much the robot itself scatters, beside what the tracker states.

Σ_i = C_i + s² 1 + σ_q² J_i J_iᵀ: the tracker's covariance, scatter of the point in space, and
scatter of the joints through J = ∂position/∂joints. Restricted maximum likelihood (REML; Patterson
and Thompson 1971) finds s and σ_q with the unknowns of the fit integrated out, and takes each only
where the likelihood asks for it.
"""

import math
from dataclasses import dataclass
from types import ModuleType
from typing import TypeAlias

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
GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))
LEAST_STEP = math.sqrt(2.2e-16)
"""Part of a place, beside a tolerance, that two trials of a search are at least apart."""

Search: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float]
"""Search for a maximum: its bounds, the best three places, their values, and the last two steps."""


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
    shots: LinearizedShots,
    kernel: ModuleType | None = None,
    scores: Array | None = None,
    before: VarianceComponents = NONE,
) -> VarianceComponents:
    """Components that the likelihood asks for; none with too few shots to tell any.

    `kernel`: compiled loops, where they can be used; scores of the components where known, (2,).
    `before`: those of the same shots about another fit, which stay where they hardly move.
    """
    count, unknowns = shots.residual_mm.size, shots.jacobian.shape[-1]
    if count <= unknowns + 2:
        return NONE
    likelihood: _RestrictedLikelihood | None = None
    if (before.point_mm > 0.0) != (before.joint > 0.0):
        likelihood = _RestrictedLikelihood(shots, kernel)
        if likelihood.is_top(before):
            return before
    found = _scores(shots) if scores is None else scores
    least = hopeless_score(count - unknowns)
    hopeful = [place for place, score in enumerate(found) if score >= least]
    if not hopeful:
        return NONE
    likelihood = likelihood or _RestrictedLikelihood(shots, kernel)
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
    columns = (each.transpose(1, 2, 0) for each in (inverse, inverse @ shots.by_joints))
    leverage = (by_shot @ by_shot.swapaxes(1, 2)).transpose(1, 2, 0)
    return component_scores(left.T, leverage, *columns)


def component_scores(left: Array, leverage: Array, *columns: Array) -> Array:
    """Scores of components at none, in about their own standard deviations, (k, …).

    It is the slope of the likelihood there: without one there is nothing to be gained. Of whitened
    residuals (…, 3, N) after a fit, its leverages (…, 3, 3, N), and each component's whitened
    columns (…, 3, k, N).
    """
    found = []
    for each in columns:
        own = np.einsum("...ikn,...jkn->...ijn", each, each)
        taken = np.einsum("...ijn,...ijn->...", leverage, own)
        found.append(component_score(left, each, own, taken))
    return np.array(found)


def component_score(left: Array, columns: Array, own: Array, taken: Array) -> Array:
    """Score of one component, (…), of its columns' products (…, 3, 3, N).

    `taken` is what the fit took of these, (…).
    """
    told = np.einsum("...ikn,...in->...kn", columns, left)
    expected = np.einsum("...iin->...", own) - taken
    spread = np.sqrt(2.0 * np.sum(own**2, axis=(-3, -2, -1)))
    return np.asarray((np.sum(told**2, axis=(-2, -1)) - expected) / spread)


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

    def __init__(self, shots: LinearizedShots, kernel: ModuleType | None = None) -> None:
        self._shots, self._kernel = shots, kernel
        if kernel is None:
            self._through = shots.by_joints @ shots.by_joints.swapaxes(1, 2)
            jacobian = _orthonormal(shots.jacobian)
            self._is_orthonormal = jacobian is not None
            """Whether columns are so far from dependence that their squares, which take a fraction
            of the time of a QR, tell as much; compiled loops look themselves."""
            if jacobian is None:
                scale = column_norms(shots.jacobian.reshape(-1, shots.jacobian.shape[-1]))
                jacobian = shots.jacobian / np.where(scale > 0.0, scale, 1.0)
            self._rows = np.concatenate([jacobian, shots.residual_mm[:, :, None]], axis=2)
        else:
            every = shots.jacobian, shots.residual_mm, shots.by_joints, shots.stated_mm2
            *of_shots, stated = (np.ascontiguousarray(each.T) for each in every)
            rows, through = kernel.likelihood_rows(*of_shots)
            self._by_component = rows, stated, through  # covariances: symmetrical
            self._rows, self._through, self._is_orthonormal = rows.T, through.T, False
        typical_mm = math.sqrt(float(np.trace(shots.stated_mm2, axis1=1, axis2=2).mean()) / 3.0)
        lever = math.sqrt(float(np.trace(self._through, axis1=1, axis2=2).mean()) / 3.0)
        self._units = (typical_mm, typical_mm / lever if lever > 0.0 else 1.0)

    def at(self, log_point: float, log_joint: float) -> float:
        """2 log L but for a constant; -∞ where a covariance is none."""
        point, joint = self._std(log_point, log_joint)
        if self._kernel is not None:
            of_all = self._kernel.restricted_likelihood(*self._by_component, point**2, joint**2)
            if math.isfinite(of_all):
                return float(of_all)
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
        if self._kernel is not None:
            fixed = self._std(other, other)[1 - place] ** 2
            found: tuple[float, float] = self._kernel.likeliest(
                *self._by_component, place, fixed, self._units[place], low, high, tolerance
            )
            if math.isfinite(found[0]):
                return found

        def at(log: float) -> float:
            return self.at(*((log, other) if place == 0 else (other, log)))

        trial = low + GOLDEN * (high - low)
        search, trial = next_trial(begun(low, high, trial, at(trial)), tolerance)
        while not math.isnan(trial):
            search, trial = next_trial(with_trial(search, trial, at(trial)), tolerance)
        return search[5], search[2]

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


def begun(low: float, high: float, place: float, value: float) -> Search:
    """Search between two bounds by the value at a first place."""
    return low, high, place, place, place, value, value, value, 0.0, 0.0


def next_trial(search: Search, tolerance: float) -> tuple[Search, float]:
    """The next place to try; not a number where the best one is known to the tolerance.

    By parabolas where they lead on, else by golden sections (Brent 1973), as SciPy's bounded
    search. Compiled loops are made of the same lines.
    """
    low, high, best, second, third, at_best, at_second, at_third, step, before = search
    middle, least = 0.5 * (low + high), LEAST_STEP * abs(best) + tolerance / 3.0
    if abs(best - middle) <= 2.0 * least - 0.5 * (high - low):
        return search, math.nan
    is_parabola = False
    if abs(before) > least:
        right = (best - second) * (at_third - at_best)
        left = (best - third) * (at_second - at_best)
        above, below = (best - third) * left - (best - second) * right, 2.0 * (left - right)
        above, below = (-above if below > 0.0 else above), abs(below)
        is_parabola = abs(above) < abs(0.5 * below * before)
        is_parabola &= below * (low - best) < above < below * (high - best)
        before = step
    if is_parabola:
        step = above / below
        if min(best + step - low, high - best - step) < 2.0 * least:
            step = math.copysign(least, middle - best)
    else:
        before = (low if best >= middle else high) - best
        step = GOLDEN * before
    found = low, high, best, second, third, at_best, at_second, at_third, step, before
    return found, best + math.copysign(max(abs(step), least), step)


def with_trial(search: Search, place: float, value: float) -> Search:
    """The same search by the value at one more place."""
    low, high, best, second, third, at_best, at_second, at_third, step, before = search
    if value >= at_best:
        low, high = (best, high) if place >= best else (low, best)
        third, at_third, second, at_second = second, at_second, best, at_best
        best, at_best = place, value
    else:
        low, high = (place, high) if place < best else (low, place)
        if value >= at_second or second == best:
            third, at_third, second, at_second = second, at_second, place, value
        elif value >= at_third or third in (best, second):
            third, at_third = place, value
    return low, high, best, second, third, at_best, at_second, at_third, step, before
