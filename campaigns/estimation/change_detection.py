"""Change during a campaign: tests of a step, or a drift, at every place in time and of every cause.

For each cause (one joint's offset, one arm's length, the tracker's frame) and each shot k an F test
of a step from k on, in the linearised fit whitened with the whole covariance of every shot. The
chance of the largest over all tests is Bonferroni's; of causes with one column Worsley's (1982)
improvement of it, which takes into account that a step from k on and one from k + 1 on are almost
the same test.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.f_test import FittedShots, log_p
from campaigns.estimation.information import EXACT, column_effect

SIGNIFICANCE = 1e-3
"""Chance of a false alarm over all tests of a campaign, at most."""
FEWEST_BEYOND = 3
"""Shots before and after a step, so that no single gross error makes one."""
MOST_ALONE = 5
MADE_BY_ONE = 0.7
"""Part of a step's gain that a single shot may make where the others alone show no step."""
HOLDS = 0.35
"""Part of its size that a change must have in the half of the shots that is far from it, on either
side."""
CHANCE = 2.0
"""Standard deviations by which these shots may show less of it."""
LAGS = 4
"""Order of the autoregressive noise that is allowed for."""
REMEMBERED, MOST_REMEMBERED = 1.65, 0.95
"""Standard deviations of the sum of autocorrelations from which noise has a memory; most of one."""
AS_WELL = 9.2
"""χ² of the two coordinates by which a wrong shot is freer than a step; chance in one of 100."""
FITTED = 1e-6
"""Of a gain: what is left of a cause that the fit has among its unknowns."""
ROUNDING = 1e-12
UNTOLD = 1e-10
"""Part of what is told of the best known direction below which nothing is told of one."""

CauseKind = Literal["joint", "length", "mount", "frame", "drift", "growth", "shot"]
OF_PARTS: tuple[CauseKind, ...] = ("joint", "length")
"""Kinds of causes with one column, which a single wrong shot seldom resembles."""


@dataclass(frozen=True, slots=True, eq=False)
class Cause:
    """Thing that may change: its columns ∂point/∂change, (N, 3, m), whitened as the shots are."""

    kind: CauseKind
    name: str
    columns: Array
    log_prior: float = 0.0
    """Logarithm of how often it happens, beside others that few shots don't tell from it."""
    time_constants: tuple[float, ...] = (math.inf,)
    """Of a drift that slows down, in parts of the campaign; by the last it goes on evenly."""


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """Change that the shots show, by how much, and between which of them."""

    kind: CauseKind
    name: str
    after: int
    """Place of the last shot before it, in the order of time."""
    size: Array
    """By the cause's columns, (m,); of a drift from the first shot to the last."""
    std: Array
    log_p: float
    """Logarithm of the chance of good shots to show as much anywhere; 0 where one alone does."""
    time_constant: float = math.inf
    """Of a drift."""

    @property
    def p(self) -> float:
        """Chance of good shots to show as much anywhere."""
        return math.exp(self.log_p)


def drifted(passed: Array, time_constant: float) -> Array:
    """Part of a drift that has come about, from 0 to 1, as parts of its time have passed, (N,)."""
    if math.isinf(time_constant):
        return passed
    return np.asarray(np.expm1(-passed / time_constant) / math.expm1(-1.0 / time_constant))


def detect_change(shots: FittedShots, causes: Sequence[Cause]) -> Change | None:
    """Most likely change in shots that stand in the order of time; None where chance will do.

    A step must hold for all shots before and after it, and be no single shot's.
    """
    count = shots.left.size // 3
    for _ in range(MOST_ALONE):
        chi2, freedom = shots.chi2, shots.freedom
        few = freedom < 2 * FEWEST_BEYOND or count < 2 * FEWEST_BEYOND
        if few or chi2 <= EXACT**2 * freedom:
            return None
        tests = [_Tests.of(cause, shots) for cause in causes]
        chances = [log_p(each.size.shape[1], freedom, each.gain, chi2) for each in tests]
        alone: int | None = None
        told = [
            (each, found, int(np.argmin(found))) for each, found in zip(tests, chances, strict=True)
        ]
        told.sort(key=lambda of: of[1][of[2]] - of[0].cause.log_prior)
        for each, found, place in told:
            chance = 0.0
            for test in tests:
                chance += test.chance_anywhere(float(found[place]))
                if chance >= SIGNIFICANCE:
                    break
            if chance >= SIGNIFICANCE:
                continue
            by_shot, expected = each.gain_by_shot(place, shots.left)
            most = float(by_shot.max())
            beside = log_p(each.size.shape[1], freedom, max(each.gain[place] - most, 0.0), chi2)
            if most > MADE_BY_ONE * each.gain[place] and beside > math.log(SIGNIFICANCE):
                alone = int(np.argmax(by_shot))
                break
            if each.holds(place, by_shot, expected):
                logarithm = math.log(min(chance, 1.0)) if chance > 0.0 else float(found[place])
                return each.change(place, chi2, freedom, logarithm)
        if alone is None:
            return None
        one = np.zeros((count, 3, 3))
        one[alone] = np.eye(3)
        shots = shots.fitted(one)
    return None


def likeliest_drift(shots: FittedShots, drifts: Sequence[Cause]) -> Change | None:
    """Drift that is most significant among some, wherever the shots show it; None by chance."""
    chi2, freedom = shots.chi2, shots.freedom
    if freedom < 2 * FEWEST_BEYOND or chi2 <= EXACT**2 * freedom:
        return None
    tests = [_Tests.of(cause, shots) for cause in drifts]
    chances = [log_p(each.size.shape[1], freedom, each.gain, chi2) for each in tests]
    least, test, found = min(
        ((float(found.min()), test, found) for test, found in zip(tests, chances, strict=True)),
        key=lambda each: each[0],
    )
    chance = least + math.log(sum(len(each) for each in chances))
    if chance >= math.log(SIGNIFICANCE):
        return None
    return test.change(int(np.argmin(found)), chi2, freedom, chance)


def outlier_as_step(shots: FittedShots, causes: Sequence[Cause], at: int) -> Change | None:
    """Step of a part that explains shots from one on as well as its being wrong; else None.

    The shots after it are too few then to say whether one shot is wrong or the robot has changed.
    Its `log_p` is 0.
    """
    one = np.zeros((shots.left.size // 3, 3, 3))
    one[at] = np.eye(3)
    without, found = shots.fitted(one), list[tuple[float, Change]]()
    variance = max(1.0, without.chi2 / max(without.freedom, 1))
    for cause in causes:
        if cause.kind not in OF_PARTS:
            continue
        after = cause.columns.copy()
        after[:at] = 0.0
        size, covariance_matrix, gain = column_effect(shots, after)
        left, std = shots.chi2 - gain, np.sqrt(variance * np.diag(covariance_matrix))
        if left <= without.chi2 + variance * AS_WELL:
            found.append((left, Change(cause.kind, cause.name, at - 1, -size, std, 0.0)))
    # parts of an arm move one shot alike, and so may two arms: encoders slip most often, and little
    found.sort(
        key=lambda each: (OF_PARTS.index(each[1].kind), round(each[0], 2), abs(each[1].size[0]))
    )
    return found[0][1] if found else None


def memory(left: Array) -> Array:
    """Filter that whitens autoregressive noise in residuals (N, 3), (1 + p,); () without any.

    By Yule and Walker, where the autocorrelations together are beyond chance.
    """
    square = float(np.sum(left**2))
    if len(left) <= 4 * LAGS or square <= 0.0:
        return np.empty(0)
    correlation = np.array([np.sum(left[lag:] * left[:-lag]) for lag in range(1, LAGS + 1)])
    correlation /= square
    if correlation.sum() < REMEMBERED * math.sqrt(LAGS / left.size):
        return np.empty(0)
    # a mean before a step and one after it hide as much of a long memory (Kendall 1954)
    first = min(max(float(correlation[0]), 0.0), MOST_REMEMBERED)
    hidden = min(2.0 * (1.0 + 4.0 * first) / (len(left) * (1.0 - first)), 0.5)
    correlation += hidden * (1.0 - correlation)
    lags = np.abs(np.subtract.outer(np.arange(LAGS), np.arange(LAGS)))
    coefficients = np.linalg.solve(np.append(1.0, correlation)[lags], correlation)
    innovation = max(1.0 - float(coefficients @ correlation), ROUNDING)
    return np.append(1.0, -coefficients) / math.sqrt(innovation)


def without_memory(filtered: Array, rows: Array) -> Array:
    """Rows (N, …) by a filter, less what the noise of those before them leads to expect."""
    if not len(filtered):
        return rows
    new = filtered[0] * rows
    for lag, coefficient in enumerate(filtered[1:].tolist(), start=1):
        new[lag:] += coefficient * rows[:-lag]
    new[: len(filtered) - 1] = rows[: len(filtered) - 1]
    return np.asarray(new)


def last_together(wrong: Mask) -> int | None:
    """First of the shots at the end, in the order of time, that hold all that are wrong, (N,).

    None where chance will do for as many to fall together there (hypergeometric).
    """
    places, count = np.flatnonzero(wrong), len(wrong)
    if len(places) < 2:
        return None
    last = count - int(places[0])
    chance = math.comb(last, len(places)) / math.comb(count, len(places))
    return int(places[0]) if chance < SIGNIFICANCE else None


@dataclass(frozen=True, slots=True, eq=False)
class _Tests:
    """Tests of one cause at K places: places, steps (K, m), their gains and unit covariances.

    `correlation` (K - 1,) is that of each place's statistic with the next one's, where m is 1.
    """

    cause: Cause
    after: Index
    size: Array
    gain: Array
    covariance: Array
    correlation: Array

    @classmethod
    def of(cls, cause: Cause, shots: FittedShots) -> "_Tests":
        """Tests beside the columns of the fit."""
        columns, count = cause.columns, len(cause.columns)
        by_shot, basis = shots.left.reshape(count, 3), shots.basis.reshape(count, 3, -1)
        turned = columns.swapaxes(1, 2)
        own, shared = turned @ columns, basis.swapaxes(1, 2) @ columns
        gained = (turned @ by_shot[:, :, None])[:, :, 0]
        if cause.kind == "drift":
            courses = _courses(cause, count)
            own, shared, gained = (
                np.tensordot(part, each, axes=1)
                for part, each in ((courses**2, own), (courses, shared), (courses, gained))
            )
            first = np.arange(len(courses))
        else:
            own, shared, gained = map(_from_there_on, (own, shared, gained))
            first = np.arange(FEWEST_BEYOND, count - FEWEST_BEYOND + 1)
        normal = (own - shared.swapaxes(1, 2) @ shared)[first]
        inverse = _inverse(normal)
        size = np.einsum("nij,nj->ni", inverse, gained[first])
        gain = np.maximum(np.einsum("ni,ni->n", gained[first], size), 0.0)
        correlation = np.empty(0)
        if columns.shape[2] == 1 and cause.kind != "drift":
            together = own[first[1:], 0, 0]  # what both of two neighbours have: the later one's
            together = together - np.sum(shared[first[:-1], :, 0] * shared[first[1:], :, 0], axis=1)
            unit = np.sqrt(np.maximum(inverse[:, 0, 0], 0.0))  # rounding where a fit says it all
            correlation = together * unit[:-1] * unit[1:]
        places = np.zeros_like(first) if cause.kind == "drift" else first - 1
        return cls(cause, places, size, gain, inverse, correlation)

    def chance_anywhere(self, logarithm: float) -> float:
        """Bound on the chance that good shots show a test of so small a p at any of the places.

        Of neighbours beyond ± u both are counted once: P ≤ Σ P(A_k) - Σ P(A_k and A_k+1), whose
        normal probabilities Owen's T tells.
        """
        p = math.exp(logarithm)
        if p <= 0.0:
            return 0.0
        if not len(self.correlation):
            return p * len(self.gain)
        u, rho = (
            -float(scipy.special.ndtri(0.5 * p)),
            np.clip(self.correlation, -1.0 + ROUNDING, 1.0),
        )
        apart = scipy.special.owens_t(u, np.sqrt((1.0 - rho) / (1.0 + rho)))
        return float(2.0 * scipy.special.ndtr(-u) + 4.0 * np.sum(apart))

    def gain_by_shot(self, place: int, left: Array) -> tuple[Array, Array]:
        """Part of the gain that each shot makes, and would make if all showed the change, (N,)."""
        count, moved = len(self.cause.columns), self.cause.columns @ self.size[place]
        course = (np.arange(count) > self.after[place]).astype(np.float64)
        if self.cause.kind == "drift":
            course = _courses(self.cause, count)[place]
        by_all = np.einsum("nk,nk->n", moved, left.reshape(-1, 3))
        if abs(by_all.sum()) < FITTED * self.gain[place]:
            course = course - course.mean()  # the fit says where all are: half of it is before
        told = np.sum(moved**2, axis=1) * course**2
        return by_all * course, told * (self.gain[place] / max(float(told.sum()), ROUNDING))

    def holds(self, place: int, by_shot: Array, expected: Array) -> bool:
        """Whether the shots far from a change, before and after it, show it too."""
        first, count = int(self.after[place]) + 1, len(by_shot)
        first = count // 2 if self.cause.kind == "drift" else first
        far = slice(0, (first + 1) // 2), slice((first + count) // 2, count)
        noise = CHANCE * np.sqrt(expected)  # of a shot's part, whose variance is itself
        return all(
            by_shot[some].sum() >= HOLDS * expected[some].sum() - np.linalg.norm(noise[some])
            for some in far
        )

    def change(self, place: int, chi2: float, freedom: int, logarithm: float) -> Change:
        """Change at one of the places."""
        rest = max(chi2 - float(self.gain[place]), 0.0) / (freedom - self.size.shape[1])
        std = np.sqrt(np.abs(rest * np.diag(self.covariance[place])))
        cause, after = self.cause, int(self.after[place])
        slowing = cause.time_constants[place] if cause.kind == "drift" else math.inf
        return Change(cause.kind, cause.name, after, -self.size[place], std, logarithm, slowing)


def _courses(cause: Cause, count: int) -> Array:
    """Courses of a drift, (K, N)."""
    passed = np.linspace(0.0, 1.0, count)
    return np.stack([drifted(passed, each) for each in cause.time_constants])


def _inverse(normal: Array) -> Array:
    """Inverses (K, m, m), zero along directions that nothing tells."""
    if normal.shape[-1] == 1:
        told = normal > UNTOLD * normal.max(initial=0.0)
        return np.where(told, 1.0 / np.where(told, normal, 1.0), 0.0)
    try:
        inverse = np.linalg.inv(normal)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(normal, rcond=UNTOLD, hermitian=True))
    size, own = (np.linalg.norm(each, axis=(1, 2)) for each in (normal, inverse))
    lost = size * own > 1.0 / UNTOLD  # no smaller than the condition
    inverse[lost] = np.linalg.pinv(normal[lost], rcond=UNTOLD, hermitian=True)
    return np.asarray(inverse)


def _from_there_on(each: Array) -> Array:
    """Sums of a shot and all that follow it."""
    return np.asarray(np.cumsum(each[::-1], axis=0)[::-1])
