"""Tests of a fit's shots: what the model lacks, and a step or a drift in the order of time.

All shots that are not gross take part, those that were left out of the fit and unseen ones too.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation import lack_of_fit
from campaigns.estimation.change_detection import (
    Cause,
    Change,
    detect_change,
    last_together,
    memory,
    outlier_as_step,
    without_memory,
)
from campaigns.estimation.f_test import FittedShots
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.estimation.robust import rejection_threshold, robust_scale
from campaigns.estimation.tracker_noise import inverse_roots
from campaigns.estimation.variance_components import LinearizedShots, estimate_components
from campaigns.identification.fit import PointFit
from campaigns.identification.fit import linearized as linearized_shots
from campaigns.identification.observations import Inputs, Observations, all_observations
from campaigns.mechanisms.mechanism import KinematicSolution, NoSolution
from campaigns.mechanisms.parameters import FOREARM, ParameterSpace

Columns = TypeVar("Columns", lack_of_fit.Group, Cause)

GROSS = 20.0
"""σ beyond which a shot is a gross error, which shows no cause."""
RARE = math.log(0.01)
"""How seldom a forearm of a crank changes its length by a step, for each encoder that slips."""
LAST = 10
"""Shots at the end, of which one may be the first after a change that the others hardly show."""
WORSE = 1.3
"""Scatter of unseen shots over that of fitted ones that is no chance."""
SWAPPED = 0.1
"""Part of their misfits that two neighbours may have with each other's points."""


@dataclass(frozen=True, slots=True, eq=False)
class Tested:
    """What tests of all shots show, the shots by their numbers."""

    lacks: tuple[lack_of_fit.LackOfFit, ...] = ()
    possible: lack_of_fit.LackOfFit | None = None
    """Where nothing is significant: what is worth a trial."""
    change: Change | None = None
    between: tuple[int, int] | None = None
    """Shots before and after the change."""
    swapped: tuple[tuple[int, int], ...] = ()
    off_from: tuple[int, int] | None = None
    """Number of shots that are off, and the first of the last shots that hold them all."""


def tested(inputs: Inputs, points: PointFit, near: KinematicSolution) -> Tested:
    """Tests of all shots by a plain fit, from poses near theirs."""
    try:
        shots = _all_shots(inputs, points, near)
    except (NoSolution, np.linalg.LinAlgError):
        return Tested()
    swapped = tuple(_swapped(shots))
    apart = shots.out.copy()
    apart[[row for pair in swapped for row in pair]] = False
    gross = _gross(shots, swapped)
    in_line = ~gross | (apart & ~isolated(~shots.out))
    late = last_together(apart)
    if late is None and (last := last_together(apart[shots.fitted])) is not None:
        late = int(np.flatnonzero(shots.fitted)[last])
    if late is not None:
        in_line[late:] |= apart[late:]
    smooth = steps = _Rows(shots, np.flatnonzero(~gross))
    if in_line.sum() > len(smooth.rows):
        steps = _Rows(shots, np.flatnonzero(in_line))
    found, change = _most_significant(smooth, steps)
    lacks = tuple(each for each in found if each.significant)
    possible = found[0] if found and not lacks else None
    numbers = shots.numbers
    between = off = None
    if change is not None:
        rows = steps.rows[[change.after, change.after + 1]]
        rows = steps.rows[[0, -1]] if change.kind == "drift" else rows
        between = numbers[rows[0]], numbers[rows[1]]
    elif not lacks and late is not None:
        off = int(apart.sum()), numbers[late]
    elif not lacks and (shown := _shown_by_one(shots, gross, np.flatnonzero(apart))) is not None:
        change, rows = shown
        between = numbers[rows[change.after]], numbers[rows[change.after + 1]]
    named = tuple((numbers[one], numbers[other]) for one, other in swapped)
    return Tested(lacks, possible, change, between, named, off)


def _shown_by_one(shots: "_AllShots", gross: Mask, apart: Index) -> tuple[Change, Index] | None:
    """Step that a shot apart may show as well as an error of its own, and the rows tried."""
    late = apart[apart >= len(shots.out) - LAST]
    causes = tuple(_causes(shots)) if len(late) else ()
    for row in late.tolist():
        rows = np.union1d(np.flatnonzero(~gross), [row])
        tried = _Rows(shots, rows)
        at = int(np.searchsorted(rows, row))
        if (found := outlier_as_step(tried.fit, tried.of(causes), at)) is not None:
            return found, rows
    return None


def _gross(shots: "_AllShots", swapped: tuple[tuple[int, int], ...]) -> Mask:
    """Shots that show no cause, (N,): gross errors, and neighbours that are swapped."""
    gross = shots.size > GROSS
    gross[[row for pair in swapped for row in pair]] = True
    return np.asarray(gross)


def isolated(kept: Mask) -> Mask:
    """Rows left out whose neighbours in time are kept: single gross errors."""
    out = ~kept
    beside = np.zeros_like(out)
    beside[1:] |= out[:-1]
    beside[:-1] |= out[1:]
    return np.asarray(out & ~beside)


@dataclass(frozen=True, eq=False)
class _AllShots:
    """All shots in the order of time, about a fit; which are out of line, and by how many σ."""

    everything: Observations
    linearized: LinearizedShots
    whitening: Array
    """Inverse roots of their covariances, (N, 3, 3)."""
    x: Array
    size: Array
    out: Mask
    fitted: Mask
    groups: tuple[lack_of_fit.Group, ...]
    """Groups of columns, a cause each."""

    @property
    def parameters(self) -> Array:
        """Free parameters of the fit, (F,)."""
        return self.everything.points.parameters(self.x)

    @property
    def numbers(self) -> tuple[int, ...]:
        return self.everything.numbers

    @property
    def space(self) -> ParameterSpace:
        return self.everything.model.mechanism.parameters

    def by_parameters(self, names: tuple[str, ...]) -> Array:
        """∂point/∂parameters in the tracker's axes, (N, 3, K)."""
        data = self.everything.points
        by_names = data.model.by_geometry(self.parameters, self.space.places(names))
        return np.asarray(data.rotations(self.x) @ by_names)

    def reweighed(self, rows: Index, columns: Array) -> "_AllShots":
        """The same by the scatter that some of them show beside further columns (N, 3, k)."""
        some = self.linearized
        fitted = replace(some, jacobian=np.concatenate([some.jacobian, columns], axis=2))
        scatter = estimate_components(fitted.rows(rows))
        covariance = scatter.covariance_mm2(some.stated_mm2, some.by_joints)
        return replace(self, whitening=inverse_roots(covariance))


def _all_shots(inputs: Inputs, points: PointFit, near: KinematicSolution) -> _AllShots:
    """All of them; raises `NoSolution`, and `LinAlgError` for a covariance that is none."""
    everything, found = all_observations(inputs, points.observations, near), points.found
    linearized = linearized_shots(everything, found.x)
    covariance = points.scatter.covariance_mm2(linearized.stated_mm2, linearized.by_joints)
    whitening = inverse_roots(covariance)
    size = np.linalg.norm((whitening @ linearized.residual_mm[:, :, None])[:, :, 0], axis=1)
    kept = dict(zip(points.observations.numbers, found.kept.tolist(), strict=True))
    fitted = np.array([number in kept for number in everything.numbers])
    scale = max(1.0, robust_scale(size[fitted], 3, len(found.x)))
    if not fitted.all() and (unseen := robust_scale(size[~fitted], 3, 0)) > WORSE * scale:
        # they scatter more: that is no step, and is for their own test
        whitening[~fitted] *= scale / unseen
        size[~fitted] *= scale / unseen
    size = size / scale
    out = size > rejection_threshold(len(size), 3)
    out |= np.array([not kept.get(number, True) for number in everything.numbers])
    encoders, approach = everything.shots.joints, everything.shots.approach
    groups = tuple(lack_of_fit.error_groups(everything.points, found.x, encoders, approach))
    return _AllShots(everything, linearized, whitening, found.x, size, out, fitted, groups)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Some of the shots, whitened, and without the memory that their noise may have."""

    shots: _AllShots
    rows: Index
    phi: Array = field(default_factory=lambda: np.empty(0))

    @cached_property
    def fit(self) -> FittedShots:
        """Linear fit of these rows."""
        residual_mm = self.shots.linearized.residual_mm
        return FittedShots.of(self.white(residual_mm[:, :, None]), self.jacobian)

    @cached_property
    def jacobian(self) -> Array:
        """Whitened ∂point/∂unknowns, (N, 3, P)."""
        return self.white(self.shots.linearized.jacobian)

    @cached_property
    def groups(self) -> tuple[lack_of_fit.Group, ...]:
        """Groups of columns, whitened."""
        return self.of(self.shots.groups)

    def white(self, columns: Array) -> Array:
        """Whitened columns (N, 3, k) of these rows."""
        whitening = self.shots.whitening
        if len(self.rows) < len(whitening):
            whitening, columns = whitening[self.rows], columns[self.rows]
        return without_memory(self.phi, np.asarray(whitening @ columns))

    def of(self, each: Sequence[Columns]) -> tuple[Columns, ...]:
        """Groups or causes by their columns of these rows."""
        ends = np.cumsum([one.columns.shape[2] for one in each])
        white = self.white(np.concatenate([one.columns for one in each], axis=2))
        split = np.split(white, ends[:-1], axis=2)
        return tuple(replace(one, columns=own) for one, own in zip(each, split, strict=True))


def _most_significant(
    smooth: _Rows, steps: _Rows
) -> tuple[tuple[lack_of_fit.LackOfFit, ...], Change | None]:
    """Lacks of the model and change, the most significant first and the others beside it."""
    shots = smooth.shots
    causes = tuple(_causes(shots))
    found = _selected(smooth, steps, causes)
    if _any_significant(found[0]):
        # what the model lacks is no scatter of the robot, for which it was taken
        weighed = shots.reweighed(smooth.rows, _taken_up(shots, found[0]))
        smooth, steps = replace(smooth, shots=weighed), replace(steps, shots=weighed)
        found = _selected(smooth, steps, causes)
    lacks, change = found
    if not _any_significant(lacks) and change is None:
        return found
    left = steps.fit
    if lacks:
        left = left.fitted(steps.white(_taken_up(shots, lacks)))
    if change is not None:
        left = left.fitted(steps.white(_changed(causes, change, steps)))
    phi = memory(left.left.reshape(-1, 3))
    if not len(phi):
        return found
    again = _selected(replace(smooth, phi=phi), replace(steps, phi=phi), causes)
    # beside noise with a memory it is seen whether there is a change, without it which and where
    return again[0], change if change is not None and again[1] is not None else again[1]


def _any_significant(lacks: tuple[lack_of_fit.LackOfFit, ...]) -> bool:
    return any(each.significant for each in lacks)


def _selected(
    smooth: _Rows, steps: _Rows, causes: tuple[Cause, ...]
) -> tuple[tuple[lack_of_fit.LackOfFit, ...], Change | None]:
    shots = smooth.shots
    over_time = steps.of(causes)
    change = detect_change(steps.fit, over_time)
    lacks = tuple(lack_of_fit.lacks_of_fit(smooth.fit, smooth.groups))
    if not _any_significant(lacks):
        return lacks if change is None else (), change
    if change is not None and change.log_p < lacks[0].log_p:
        return (), change  # half of the shots are of another robot, which any cause may resemble
    # whatever else the model lacks at these joints is no change either
    explained = steps.fit
    for columns in (_taken_up(shots, lacks), *_general(shots)):
        if explained.freedom - columns.shape[-1] >= lack_of_fit.LEAST_FREEDOM:
            explained = explained.fitted(steps.white(columns))
    return lacks, detect_change(explained, over_time)


def _general(shots: _AllShots) -> Iterator[Array]:
    """Columns that stand for more than one cause."""
    return (each.columns for each in shots.groups if each.name in {"parts", lack_of_fit.GENERAL})


def _taken_up(shots: _AllShots, lacks: tuple[lack_of_fit.LackOfFit, ...]) -> Array:
    """Columns of what the model lacks, of all shots."""
    known = {each.name: each.columns for each in shots.groups}
    return np.concatenate([known[each.name][:, :, each.part] for each in lacks], axis=2)


def _changed(causes: tuple[Cause, ...], change: Change, steps: _Rows) -> Array:
    """Columns of a change, of all shots."""
    cause = next(each for each in causes if (each.kind, each.name) == (change.kind, change.name))
    places = np.arange(len(cause.columns))
    since = (places >= steps.rows[change.after + 1]).astype(np.float64)
    if change.kind == "drift":
        since = places / len(places)
    return np.asarray(cause.columns * since[:, None, None])


def part_causes(
    space: ParameterSpace, by_joints: Array, by_parameters: Callable[[tuple[str, ...]], Array]
) -> Iterator[Cause]:
    """Causes that are parts of the robot, by ∂point/∂joints and ∂point/∂(named parameters)."""
    for place, offset in enumerate(space.offsets.tolist()):
        yield Cause("joint", space.geometry[offset], by_joints[:, :, place : place + 1])
    forearms = () if FOREARM in space.arm_lengths[0] else space.of_field(FOREARM)
    links = (*space.arm_lengths, *forearms)
    mounts = tuple(f"arm{arm}.{axis}_mm" for arm in range(space.arms) for axis in "xyz")
    found = by_parameters((*links, *mounts))
    for place, name in enumerate(links):
        prior = RARE if name in forearms else 0.0
        yield Cause("length", name, found[:, :, place : place + 1], prior)
    for place in range(0, len(mounts), 3):
        own = found[:, :, len(links) + place :][:, :, :3]
        yield Cause("mount", mounts[place], own)


def _causes(shots: _AllShots) -> Iterator[Cause]:
    """Causes of a change, with their columns of all shots."""
    space = shots.space
    yield from part_causes(space, shots.linearized.by_joints, shots.by_parameters)
    yield Cause("frame", "frame", shots.linearized.jacobian[:, :, -FRAME_COLUMNS:])
    yield from _drifts(shots)


def _drifts(shots: _AllShots) -> Iterator[Cause]:
    """Those that go on all the time: of the tracker's stand, and as parts grow warm."""
    yield Cause("drift", "drift", shots.linearized.jacobian[:, :, -FRAME_COLUMNS:])
    lengths = shots.by_parameters(shots.space.arm_lengths).sum(axis=2, keepdims=True)
    yield Cause("drift", "lengths", lengths)


def _swapped(shots: _AllShots) -> Iterator[tuple[int, int]]:
    """Neighbours in time, by row, that each have the other's point."""
    measured = shots.everything.points.points_in_tracker_mm
    modelled, off = measured + shots.linearized.residual_mm, shots.out & (shots.size > GROSS)
    for row in np.flatnonzero(off[:-1] & off[1:]).tolist():
        own = np.linalg.norm(modelled[row : row + 2] - measured[row : row + 2], axis=1)
        other = np.linalg.norm(modelled[row : row + 2] - measured[row : row + 2][::-1], axis=1)
        if other.max() < SWAPPED * own.min():
            yield row, row + 1
