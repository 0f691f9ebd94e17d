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

from campaigns.arrays import SHOTS_AT_ONCE, Array, Index, Mask
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
WELL_TOLD = 1e-9
"""Part of the best known direction from which no other is lost to rounding."""
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

    @property
    def p(self) -> float:
        """Chance of good shots to show as much anywhere."""
        return math.exp(self.log_p)


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
        alone: int | None = None
        places = [int(np.argmax(each.gain)) for each in tests]
        told = [
            (each, float(log_p(each.gained.shape[1], freedom, each.gain[place], chi2)), place)
            for each, place in zip(tests, places, strict=True)
        ]
        told.sort(key=lambda of: of[1] - of[0].cause.log_prior)
        by_chance = 0.0
        for each, found, place in told:
            chance = 0.0
            for test in tests if found < by_chance else ():
                chance += test.chance_anywhere(found)
                if chance >= SIGNIFICANCE:
                    break
            if found >= by_chance or chance >= SIGNIFICANCE:
                by_chance = min(by_chance, found)  # and so it is of all that are as likely
                continue
            by_shot, expected = each.gain_by_shot(place, shots.left)
            most = float(by_shot.max())
            beside = log_p(each.gained.shape[1], freedom, max(each.gain[place] - most, 0.0), chi2)
            if most > MADE_BY_ONE * each.gain[place] and beside > math.log(SIGNIFICANCE):
                alone = int(np.argmax(by_shot))
                break
            if each.holds(place, by_shot, expected):
                logarithm = math.log(min(chance, 1.0)) if chance > 0.0 else found
                return each.change(place, chi2, freedom, logarithm)
        if alone is None:
            return None
        one = np.zeros((count, 3, 3))
        one[alone] = np.eye(3)
        shots = shots.fitted(one)
    return None


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
    """Tests of one cause at K places: places, normal equations (K, m, m) and (K, m), gains (K,).

    `correlation` (K - 1,) is that of each place's statistic with the next one's, where m is 1.
    """

    cause: Cause
    after: Index
    normal: Array
    gained: Array
    gain: Array
    correlation: Array

    @classmethod
    def of(cls, cause: Cause, shots: FittedShots) -> "_Tests":
        """Tests beside the columns of the fit."""
        columns, count = cause.columns, len(cause.columns)
        if cause.kind == "drift":
            turned = np.ascontiguousarray(columns.swapaxes(1, 2))
            by_shot, basis = shots.left.reshape(count, 3, 1), shots.basis.reshape(count, 3, -1)
            passed = np.linspace(0.0, 1.0, count)[None]
            own, shared, gained = (
                np.tensordot(part, each, axes=1)
                for part, each in (
                    (passed**2, turned @ columns),
                    (passed, turned @ basis),
                    (passed, (turned @ by_shot)[:, :, 0]),
                )
            )
            normal = own - shared @ shared.swapaxes(1, 2)
            gain = _gains(normal, gained)
            return cls(cause, np.zeros(1, dtype=np.intp), normal, gained, gain, np.empty(0))
        # sums from the last shot on, of those steps that leave enough shots before and after them
        last, some = np.ascontiguousarray(columns[::-1]), slice(FEWEST_BEYOND - 1, -FEWEST_BEYOND)
        turned, by_shot = (
            np.ascontiguousarray(last.swapaxes(1, 2)),
            shots.left.reshape(count, 3, 1)[::-1],
        )
        own, gained = (_sums(each)[some] for each in (turned @ last, (turned @ by_shot)[:, :, 0]))
        squares, products = (each[some] for each in _shared(turned, shots.basis_from_last))
        normal = (own - squares)[::-1]
        gained = gained[::-1]
        correlation = np.empty(0)
        if columns.shape[2] == 1:
            # what both of two neighbours have: the later one's
            together = own[:-1, 0, 0] - products[1:]
            # rounding where a fit says it all
            unit = np.sqrt(np.maximum(_inverse(normal)[:, 0, 0], 0.0))
            correlation = together[::-1] * unit[:-1] * unit[1:]
        after = np.arange(FEWEST_BEYOND - 1, count - FEWEST_BEYOND)
        return cls(cause, after, normal, gained, _gains(normal, gained), correlation)

    def solved(self, place: int) -> tuple[Array, Array]:
        """Step (m,) at a place, and its unit covariance (m, m)."""
        few = slice(None) if self.gained.shape[1] == 1 else slice(place, place + 1)
        covariance = _inverse(self.normal[few])[place if few.start is None else 0]
        return covariance @ self.gained[place], covariance

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
        count, moved = len(self.cause.columns), self.cause.columns @ self.solved(place)[0]
        course = (np.arange(count) > self.after[place]).astype(np.float64)
        if self.cause.kind == "drift":
            course = np.linspace(0.0, 1.0, count)
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
        size, covariance = self.solved(place)
        rest = max(chi2 - float(self.gain[place]), 0.0) / (freedom - len(size))
        std = np.sqrt(np.abs(rest * np.diag(covariance)))
        cause, after = self.cause, int(self.after[place])
        return Change(cause.kind, cause.name, after, -size, std, logarithm)


def _gains(normal: Array, gained: Array) -> Array:
    """Gains (K,) of χ² by normal equations (K, m, m) and (K, m), none along what nothing tells.

    By elimination of all at once; by their inverses where little may be left of a direction.
    """
    if normal.shape[-1] == 1:
        return _by_inverses(normal, gained)
    rest, told = np.ascontiguousarray(normal.transpose(1, 2, 0)), gained.T.copy()
    own, gain, least = np.einsum("iik->ik", rest).copy(), np.zeros(len(normal)), np.inf
    with np.errstate(all="ignore"):
        for place, column in enumerate(own):
            pivot, others = rest[place, place].copy(), slice(place + 1, None)
            least = np.minimum(least, pivot / column)
            part = rest[others, place] / pivot
            gain += told[place] ** 2 / pivot
            told[others] -= part * told[place]
            rest[others, others] -= part[:, None] * rest[place, others]
        well_told = own.min(axis=0) * least > WELL_TOLD * own.max(axis=0)
    if not well_told.all():
        gain[~well_told] = _by_inverses(normal[~well_told], gained[~well_told])
    return np.maximum(gain, 0.0)


def _by_inverses(normal: Array, gained: Array) -> Array:
    size = np.einsum("nij,nj->ni", _inverse(normal), gained)
    return np.asarray(np.maximum(np.einsum("ni,ni->n", gained, size), 0.0))


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


def _shared(turned: Array, basis: Array) -> tuple[Array, Array]:
    """Of sums over shots, what columns (N, m, 3) share with a fit's basis (N, 3, R), (m, R) each.

    Their squares (N, m, m), and the product of each with the one before it, (N,), where m is 1. Of
    some shots at a time, whose sums stay in the processor's cache.
    """
    (count, columns, _), one = turned.shape, turned.shape[1] == 1
    squares, products = np.empty((count, columns, columns)), np.zeros(count * one)
    before = np.zeros((1, columns, basis.shape[2]))
    for first in range(0, count, SHOTS_AT_ONCE):
        some = slice(first, first + SHOTS_AT_ONCE)
        sums = _sums(np.concatenate([before, turned[some] @ basis[some]]))
        if one:
            np.einsum("nr,nr->n", sums[1:, 0], sums[1:, 0], out=squares[some, 0, 0])
            np.einsum("nr,nr->n", sums[1:, 0], sums[:-1, 0], out=products[some])
        else:
            np.matmul(sums[1:], sums[1:].swapaxes(1, 2), out=squares[some])
        before = sums[-1:]
    return squares, products


def _sums(each: Array) -> Array:
    """Sums (N, …) of a row and all before it, in order: of two columns at a time, if it can be.

    As parts of complex numbers, for each sum waits for the one before it.
    """
    rows = np.ascontiguousarray(each).reshape(len(each), -1)
    if rows.shape[1] % 2 == 0:
        rows = rows.view(np.complex128)
    return np.cumsum(rows, axis=0).view(np.float64).reshape(each.shape)
