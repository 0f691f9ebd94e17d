"""Tests of a fit's shots: a step or a drift in the order of time, and what the model lacks."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.change_detection import Cause, Change, detect_change
from campaigns.estimation.lack_of_fit import LackOfFit, enough_shots, lack_of_fit, smooth_columns
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.estimation.variance_components import LinearizedShots
from campaigns.identification.fit import PointFit
from campaigns.mechanisms.parameters import ParameterSpace


def change_of(
    points: PointFit,
    space: ParameterSpace,
    lack: LackOfFit | None = None,
    parts: tuple[str, ...] = (),
) -> tuple[Change, tuple[int, int]] | None:
    """Change, and the numbers of the shots before and after it; None where chance explains all.

    Single shots left out are no change; several in a row may be one, and are looked at. Where the
    model has a `lack`, what smooth functions of the joints or imperfect `parts` explain is that,
    not a change.
    """
    fitted, found = points.observations, points.found
    order = fitted.shots.order_of_time()
    rows = order[~isolated(found.kept[order])]
    shots = _whitened(points, rows)
    if shots is None:
        return None
    jacobian = shots.jacobian
    explained = [] if lack is None else [_smooth(points, shots)]
    if lack is not None and lack.kind == "parts":
        explained.insert(0, _imperfect(points, parts, shots))
    for columns in explained:
        if enough_shots(len(rows), jacobian.shape[-1], columns.shape[-1]):
            jacobian = np.concatenate([jacobian, columns], axis=2)
    causes = tuple(_causes(points, space, shots))
    change = detect_change(shots.residual, jacobian, causes, shots.root)
    if change is None:
        return None
    numbers = [fitted.numbers[row] for row in rows.tolist()]
    if change.kind == "drift":
        return change, (numbers[0], numbers[-1])
    return change, (numbers[change.after], numbers[change.after + 1])


def lack_of_fit_of(points: PointFit, parts: tuple[str, ...]) -> LackOfFit | None:
    """Lack of fit by the shots that were kept; None where chance explains all.

    `parts` are the parameters of imperfect parts that were not looked for.
    """
    shots = _whitened(points, np.flatnonzero(points.found.kept))
    if shots is None:
        return None
    tests = [lack_of_fit(shots.residual, shots.jacobian, _smooth(points, shots), "joints")]
    if parts:
        columns = _imperfect(points, parts, shots)
        tests.append(lack_of_fit(shots.residual, shots.jacobian, columns, "parts"))
    told = [each for each in tests if each is not None and each.significant]
    return min(told, key=lambda each: each.p, default=None)


def isolated(kept: Mask) -> Mask:
    """Rows left out whose neighbours in time are kept: single gross errors."""
    out = ~kept
    beside = np.zeros_like(out)
    beside[1:] |= out[:-1]
    beside[:-1] |= out[1:]
    return np.asarray(out & ~beside)


@dataclass(frozen=True, slots=True, eq=False)
class _Whitened:
    """Some shots of a fit, with the roots of their covariances, (N, 3, 3), and whitened by them."""

    rows: Index
    linearized: LinearizedShots
    root: Array
    residual: Array
    jacobian: Array


def _whitened(points: PointFit, rows: Index) -> _Whitened | None:
    """Shots in this order; None for covariances that are none."""
    shots = points.linearized().rows(rows)
    try:
        root = np.linalg.cholesky(points.covariance_mm2()[rows])
    except np.linalg.LinAlgError:
        return None
    both = np.concatenate([shots.jacobian, shots.residual_mm[:, :, None]], axis=2)
    whitened = np.asarray(np.linalg.solve(root, both), dtype=np.float64)
    return _Whitened(rows, shots, np.asarray(root), whitened[:, :, -1], whitened[:, :, :-1])


def _smooth(points: PointFit, shots: _Whitened) -> Array:
    data = points.observations.points
    joints = data.model.arm_joints(data.parameters(points.found.x))[shots.rows]
    return np.asarray(np.linalg.solve(shots.root, smooth_columns(joints)), dtype=np.float64)


def _imperfect(points: PointFit, parts: tuple[str, ...], shots: _Whitened) -> Array:
    data, x = points.observations.points, points.found.x
    model, parameters = data.model, data.parameters(x)
    places = model.mechanism.parameters.places(parts)
    columns = data.rotations(x) @ model.by_geometry(parameters, places)
    return np.asarray(np.linalg.solve(shots.root, columns[shots.rows]), dtype=np.float64)


def _causes(points: PointFit, space: ParameterSpace, shots: _Whitened) -> Iterator[Cause]:
    data, x = points.observations.points, points.found.x
    places = space.places(space.arm_lengths)
    by_lengths = data.rotations(x) @ data.model.by_geometry(data.parameters(x), places)
    by_lengths, by_joints = by_lengths[shots.rows], shots.linearized.by_joints
    for place, offset in enumerate(space.offsets.tolist()):
        yield Cause("joint", space.geometry[offset], by_joints[:, :, place : place + 1])
    for place, name in enumerate(space.arm_lengths):
        yield Cause("length", name, by_lengths[:, :, place : place + 1])
    frame = shots.linearized.jacobian[:, :, -FRAME_COLUMNS:]
    yield Cause("frame", "frame", frame)
    yield Cause("drift", "drift", frame)
    yield Cause("drift", "lengths", by_lengths.sum(axis=2, keepdims=True))
