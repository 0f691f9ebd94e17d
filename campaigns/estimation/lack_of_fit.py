"""Lack of fit: what a model leaves that has a cause, and is no scatter.

Scatter of a robot is new at every shot. What a model lacks (eccentric encoders, sag, a wrong
reflector) is the same at the same joints. A test of many columns at once misses a small effect of
few; so each cause has a group of columns of its own, tested beside all unknowns of the fit, of all
arms together and of each alone. The most significant one is taken into the fit, and others are
told if they are significant after it (forward selection).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from campaigns.arrays import SHOTS_AT_ONCE, Array, Index
from campaigns.estimation import error_columns
from campaigns.estimation.error_columns import harmonic
from campaigns.estimation.f_test import FittedShots, log_p
from campaigns.estimation.information import EXACT, SIGNIFICANCE
from campaigns.estimation.residuals import PointResiduals

GENERAL = "joints"
"""Name of the group of what no other group stands for."""
LEAST_FREEDOM = 30
"""Degrees of freedom that must be left beside the columns."""
MOST_CAUSES = 4
RANK, TINY = 1e-5, 1e-300
"""Of squared lengths: directions of a group below it are the fit's own, as a turn of all arms is,
of which a fit by imperfect parts leaves a trace."""
SHORTEST_MM, LONGEST_MM = 5.0, 500.0
"""Periods of a carriage's drive that are looked for."""
SHORTEST_RAD, LONGEST_RAD = 2.0 * math.pi / 200.0, 2.0 * math.pi / 4.0
"""Periods of an arm's gear: from four to 200 in a turn."""
Waves = NDArray[np.complex128]
Drives = tuple[Array, Array, float, float]
"""Whitened ∂point/∂joints (N, 3, n), joints (N, n), and the shortest and longest period."""
POSSIBLE = 0.01
"""Chance below which a cause is worth a trial, which other tests of it then have to support."""
FEWEST_PERIODS = 2.0
"""Over the travel: fewer may as well be an eccentric encoder, a ratio or the geometry."""
STEPS_A_TURN = 2.0
"""Frequencies looked at, from one that makes a turn more over the travel to the next."""
NEAR = 9
"""Frequencies about the best one, a quarter of a step apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Columns of one cause, whitened, (N, 3, k)."""

    name: str
    columns: Array
    arms: Index | None = None
    """Arm of each column, (k,); None where the cause is no arm's."""
    parameters: tuple[str, ...] = ()
    """Name of each column's parameter, where the mechanism has it."""
    period: float = 0.0
    searched: int = 1
    """Number of groups among which this one was the best."""


@dataclass(frozen=True, slots=True, eq=False)
class LackOfFit:
    """Cause of what a model leaves, by its size."""

    group: Group
    part: Index
    """Places of its columns in the group's: those of one arm, or all."""
    size: Array
    """By these columns, (k,), mm and rad."""
    std: Array
    share: float
    """Part of the residuals' variance that it explains beyond chance."""
    log_p: float
    """Logarithm of the chance that good shots show as much by any group."""

    @property
    def name(self) -> str:
        """Name of the cause."""
        return self.group.name

    @property
    def arms(self) -> tuple[int, ...]:
        """Arm of each entry of `size`; () where the cause is no arm's."""
        return () if self.group.arms is None else tuple(self.group.arms[self.part].tolist())

    @property
    def significant(self) -> bool:
        """Whether chance hardly shows as much."""
        return self.log_p < math.log(SIGNIFICANCE)

    @property
    def columns(self) -> Array:
        """Whitened, (N, 3, k)."""
        return np.asarray(self.group.columns[:, :, self.part])

    @property
    def p(self) -> float:
        """Chance that good shots show as much by any group."""
        return math.exp(self.log_p)


def error_groups(
    points: PointResiduals, x: Array, encoders: Array, approach: Array
) -> Iterator[Group]:
    """Groups of columns at the unknowns x, a cause each, in the tracker's axes and in mm.

    Of encoders (N, n) that came by `approach` (N, n), 0 where that is not known.
    """
    model, parameters = points.model, points.parameters(x)
    space, rate = model.mechanism.parameters, model.mechanism.transmission.ripple_rate
    is_revolute = model.mechanism.joints[0].is_revolute
    rotations, joints = points.rotations(x), model.arm_joints(parameters)
    by_joints = rotations @ model.by_joints(parameters)
    measured_mm, positions_mm = points.points_in_tracker_mm, model.positions_mm(parameters)
    arms = np.arange(joints.shape[1])
    if is_revolute:
        yield Group("eccentricity", harmonic(by_joints, joints), np.repeat(arms, 2))
    if rate:
        name = "ripple" if is_revolute else "period"
        columns = harmonic(by_joints, rate * encoders)
        yield Group(name, columns, np.repeat(arms, 2), period=2.0 * np.pi / rate)
    yield Group("ratio", error_columns.of_joints(by_joints, joints), arms)
    if approach.any():
        yield Group("backlash", error_columns.backlash(by_joints, approach), arms)
    free = {space.geometry[place] for place in model.free.tolist() if place < len(space.geometry)}
    azimuths = tuple(name for name in space.of_field("azimuth_deg") if name not in free)
    # a turn of all arms is the frame's and the mounts': one direction less
    azimuths = azimuths[len(azimuths) < space.arms :]
    if azimuths:
        columns = rotations @ model.by_geometry(parameters, space.places(azimuths))
        if len(azimuths) == space.arms:
            columns = columns - columns.mean(axis=2, keepdims=True)
        own = np.array([space[name].arm for name in azimuths])
        yield Group("azimuths", columns, own, azimuths)
    beside = {*space.free_by_default, *free}
    parts = tuple(name for name in space.free_in_full if name not in beside)
    if parts:
        own = np.array([space[name].arm for name in parts])
        columns = rotations @ model.by_geometry(parameters, space.places(parts))
        yield Group("parts", columns, own, parts)
    up, reach_mm = rotations[:, :, 2], np.hypot(*positions_mm.T[:2]).max()
    yield Group("yielding", error_columns.yielding(by_joints, up), arms)
    yield Group("sag", error_columns.sag_by_reach(up, positions_mm, float(reach_mm)))
    yield Group("reflector", error_columns.reflector_constant(measured_mm))
    yield Group("transit axis", error_columns.transit_axis(measured_mm))
    yield Group(GENERAL, error_columns.smooth(joints))


def lacks_of_fit(
    shots: FittedShots, groups: Sequence[Group], drives: Drives | None = None
) -> Iterator[LackOfFit]:
    """Causes that the shots show, the most significant first, or one alone that is possible.

    `drives` may have a period, which is searched.
    """
    level = POSSIBLE
    for _ in range(MOST_CAUSES):
        searched = () if drives is None else (best_period(shots, drives),)
        found = _most_significant(shots, (*groups, *searched))
        if found is None or found.log_p >= math.log(level):
            return
        yield found
        if not found.significant:
            return
        level = SIGNIFICANCE
        shots = shots.fitted(found.columns)


def best_period(shots: FittedShots, drives: Drives) -> Group:
    """Group of the period, mm or rad, that explains most, the search for it counted."""
    by_joints, joints, shortest, longest = drives
    travel = max(float(np.ptp(joints)), shortest)
    step = 1.0 / (STEPS_A_TURN * travel)
    lowest = max(1.0 / longest, FEWEST_PERIODS / travel)
    frequencies = np.arange(lowest, max(1.0 / shortest, lowest + step), step)
    columns = np.column_stack([shots.basis, shots.left]).reshape(len(joints), 3, -1)
    turned = by_joints.swapaxes(1, 2)
    sought = joints, turned @ by_joints, turned @ columns
    best = frequencies[int(np.argmax(_gains(*sought, lowest, step, len(frequencies))))]
    near = best + step * np.linspace(-1.0, 1.0, NEAR)
    gains = _gains(*sought, float(near[0]), step * 2.0 / (NEAR - 1), NEAR)
    best = near[int(np.argmax(np.where(near < lowest, -np.inf, gains)))]
    columns = harmonic(by_joints, 2.0 * np.pi * best * joints)
    arms = np.repeat(np.arange(joints.shape[1]), 2)
    tests = len(frequencies) + len(near)
    return Group(
        "ripple" if longest == LONGEST_RAD else "period",
        columns,
        arms,
        period=1.0 / best,
        searched=tests,
    )


def _gains(
    joints: Array, own: Array, through: Array, lowest: float, step: float, count: int
) -> Array:
    """Part of χ² that sines and cosines explain, (F,), of so many frequencies a step apart.

    Of joints (N, n) by Jᵀ J (N, n, n) and Jᵀ of the fit's basis and what it leaves (N, n, R + 1).
    By sums over some shots at a time, whose waves stay in the processor's cache.
    """
    fine, arms = math.isqrt(count), joints.shape[1]
    coarse = -(-count // fine)
    waves = coarse * fine
    told = np.zeros((arms, through.shape[2], 2 * waves))
    sums = np.zeros((2, arms, arms, coarse, fine), np.complex128)
    for first in range(0, len(joints), SHOTS_AT_ONCE):
        some = slice(first, first + SHOTS_AT_ONCE)
        turn, begin = np.exp(2j * np.pi * np.multiply.outer((step, lowest), joints[some].T))
        # the angle sum theorem saves most sines
        steps = _powers(np.ones_like(turn), turn, fine)
        leaps = _powers(begin, steps[..., -1] * turn, coarse)  # (n, S, F)
        for i in range(arms):
            wave = (leaps[i, :, :, None] * steps[i, :, None]).reshape(-1, waves)
            told[i] += through[some, i].T @ wave.view(np.float64)
            for j in range(i, arms):
                weighted = own[some, i, j, None] * leaps[i]
                for place, leap, each in (
                    (0, leaps[j].conj(), steps[j].conj()),
                    (1, leaps[j], steps[j]),
                ):
                    sums[place, i, j] += (weighted * leap).T @ (steps[i] * each)
    square = np.empty((arms, 2, arms, 2, waves))
    for i in range(arms):
        for j in range(i, arms):
            less, more = sums[:, i, j].reshape(2, waves)  # of the angles' difference and sum
            sines, cosines = less.real - more.real, less.real + more.real
            mixed = more.imag + less.imag, more.imag - less.imag
            square[i, :, j] = 0.5 * np.array([[sines, mixed[0]], [mixed[1], cosines]])
            square[j, :, i] = square[i, :, j].swapaxes(0, 1)
    square = square.transpose(4, 0, 1, 2, 3).reshape(waves, 2 * arms, 2 * arms)[:count]
    # of each complex wave the cosine comes first
    both = told.reshape(arms, -1, waves, 2)[:, :, :count, ::-1]
    shared = both.transpose(2, 1, 0, 3).reshape(count, -1, 2 * arms)
    gained, shared = shared[:, -1], shared[:, :-1]
    square = square - shared.swapaxes(1, 2) @ shared
    size = np.einsum("fij,fj->fi", np.linalg.pinv(square, rcond=RANK, hermitian=True), gained)
    return np.asarray(np.sum(gained * size, axis=1))


def _powers(begin: Waves, turn: Waves, count: int) -> Waves:
    """Waves (…, count), from the beginning (…) on each a turn (…) further."""
    found = np.repeat(turn[..., None], count, axis=-1)
    found[..., 0] = begin
    return np.cumprod(found, axis=-1, dtype=np.complex128)


def _most_significant(shots: FittedShots, groups: Sequence[Group]) -> LackOfFit | None:
    """The group, or the part of one that is a single arm's, of the least chance."""
    chi2, tests = shots.chi2, sum(len(_parts(each)) for each in groups)
    if chi2 <= EXACT**2 * shots.left.size:
        return None
    best: tuple[float, Group, Index, _Solved] | None = None
    columns = shots.beside_each([each.columns for each in groups])
    for group, beside in zip(groups, columns, strict=True):
        normal, told = beside.T @ beside, beside.T @ shots.left
        for part in _parts(group):
            solved = _Solved.of(normal[np.ix_(part, part)], told[part])
            if solved.rank == 0 or shots.freedom - solved.rank < LEAST_FREEDOM:
                continue
            chance = float(log_p(solved.rank, shots.freedom, solved.gain, chi2))
            chance += math.log(tests * group.searched)
            if best is None or chance < best[0]:
                best = chance, group, part, solved
    return None if best is None else _lack(shots, *best)


def _parts(group: Group) -> list[Index]:
    """Columns of all arms, and of each of several."""
    every = np.arange(group.columns.shape[-1])
    if group.arms is None or len(set(group.arms.tolist())) < 2:
        return [every]
    return [every, *(every[group.arms == arm] for arm in sorted(set(group.arms.tolist())))]


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """Least squares of k columns beside a fit: sizes, gain and rank."""

    size: Array
    along: Array
    """Sizes (k, rank) that each move the shots by 1 σ, in directions apart from one another."""
    gain: float
    rank: int

    @classmethod
    def of(cls, normal: Array, told: Array) -> "_Solved":
        """By normal equations (k, k) and (k,)."""
        lengths = np.sqrt(np.diag(normal))
        scale = np.where(lengths > 0.0, 1.0 / np.maximum(lengths, TINY), 0.0)
        values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
        kept = values > RANK
        along = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
        size = along @ (along.T @ told)
        return cls(size, along, float(told @ size), sum(kept))


def _lack(
    shots: FittedShots, chance: float, group: Group, part: Index, solved: _Solved
) -> LackOfFit:
    rest = (shots.chi2 - solved.gain) / (shots.freedom - solved.rank)
    return LackOfFit(
        group=group,
        part=part,
        size=-solved.size,
        std=np.sqrt(rest * np.sum(solved.along**2, axis=1)),
        share=float(max(0.0, solved.gain - solved.rank * rest) / shots.chi2),
        log_p=min(chance, 0.0),
    )
