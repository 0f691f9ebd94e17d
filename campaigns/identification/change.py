"""Change during a campaign: what the shots of a fit say of a step or a drift, in order of time."""

from collections.abc import Iterator

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.estimation.change_detection import Cause, Change, detect_change
from campaigns.estimation.lack_of_fit import (
    LackOfFit,
    enough_shots,
    lack_of_fit,
    smooth_columns,
)
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.identification.fit import PointFit
from campaigns.mechanisms.mechanism import ParameterSpace


def change_of(
    points: PointFit, space: ParameterSpace, *, lacks: bool = False
) -> tuple[Change, tuple[int, int]] | None:
    """Change, and the numbers of the shots before and after it; None where chance explains all.

    Single shots left out are no change; several in a row may be one, and are looked at. Where the
    model `lacks` something, what a smooth function of the joints explains is that, not a change.
    """
    fitted, found = points.observations, points.found
    order = order_of_time(fitted.times)
    rows = order[~isolated(found.kept[order])]
    shots = points.linearized().rows(rows)
    covariance = points.covariance_mm2()[rows]
    try:
        root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    both = np.concatenate([shots.jacobian, shots.residual_mm[:, :, None]], axis=2)
    whitened = np.asarray(np.linalg.solve(root, both), dtype=np.float64)
    jacobian, residual = whitened[:, :, :-1], whitened[:, :, -1]
    smooth = _smooth(points, root, rows)
    if lacks and enough_shots(len(rows), jacobian.shape[-1], smooth.shape[-1]):
        jacobian = np.concatenate([jacobian, smooth], axis=2)
    data = fitted.points
    lengths = data.rotations(found.x) @ data.model.by_geometry(
        data.parameters(found.x), space.places(space.arm_lengths)
    )
    causes = {
        cause.name: cause
        for cause in _causes(space, shots.by_joints, lengths[rows], shots.jacobian)
    }
    change = detect_change(residual, jacobian, causes, root)
    if change is None:
        return None
    numbers = [fitted.numbers[row] for row in rows.tolist()]
    if change.kind == "drift":
        return change, (numbers[0], numbers[-1])
    return change, (numbers[change.after], numbers[change.after + 1])


def lack_of_fit_of(points: PointFit) -> LackOfFit | None:
    """Test of what the model leaves of the shots that were kept; None for too few."""
    rows = np.flatnonzero(points.found.kept)
    shots = points.linearized().rows(rows)
    try:
        root = np.asarray(np.linalg.cholesky(points.covariance_mm2()[rows]), dtype=np.float64)
    except np.linalg.LinAlgError:
        return None
    both = np.concatenate([shots.jacobian, shots.residual_mm[:, :, None]], axis=2)
    whitened = np.asarray(np.linalg.solve(root, both), dtype=np.float64)
    return lack_of_fit(whitened[:, :, -1], whitened[:, :, :-1], _smooth(points, root, rows))


def _smooth(points: PointFit, root: Array, rows: Index) -> Array:
    data = points.observations.points
    columns = smooth_columns(data.model.arm_joints(data.parameters(points.found.x))[rows])
    return np.asarray(np.linalg.solve(root, columns), dtype=np.float64)


def order_of_time(times: tuple[str, ...]) -> Index:
    """Rows as they were measured; as they stand where not each has a time of its own."""
    if len(set(times)) < len(times) or not all(times):
        return np.arange(len(times))
    return np.array(sorted(range(len(times)), key=lambda row: times[row]), dtype=np.intp)


def isolated(kept: Mask) -> Mask:
    """Rows left out whose neighbours in time are kept: single gross errors."""
    out = ~kept
    beside = np.zeros_like(out)
    beside[1:] |= out[:-1]
    beside[:-1] |= out[1:]
    return np.asarray(out & ~beside)


def _causes(
    space: ParameterSpace, by_joints: Array, by_lengths: Array, jacobian: Array
) -> Iterator[Cause]:
    names = [space.geometry[place] for place in space.offsets.tolist()]
    for place, name in enumerate(names):
        yield Cause("joint", name, by_joints[:, :, place : place + 1])
    for place, name in enumerate(space.arm_lengths):
        yield Cause("length", name, by_lengths[:, :, place : place + 1])
    frame = jacobian[:, :, -FRAME_COLUMNS:]
    yield Cause("frame", "frame", frame)
    yield Cause("drift", "drift", frame)
    yield Cause("drift", "lengths", by_lengths.sum(axis=2, keepdims=True))
