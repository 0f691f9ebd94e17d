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

from campaigns.arrays import Array, Index
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
POSSIBLE = 0.01
"""Chance below which a cause is worth a trial, which other tests of it then have to support."""


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


def lacks_of_fit(shots: FittedShots, groups: Sequence[Group]) -> Iterator[LackOfFit]:
    """Causes that the shots show, the most significant first, or one alone that is possible."""
    level = POSSIBLE
    for _ in range(MOST_CAUSES):
        found = _most_significant(shots, groups)
        if found is None or found.log_p >= math.log(level):
            return
        yield found
        if not found.significant:
            return
        level = SIGNIFICANCE
        shots = shots.fitted(found.columns)


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
            chance += math.log(tests)
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
