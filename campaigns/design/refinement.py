"""Refinement of a design beyond its candidates: poses moved while that lowers the criterion.

Coordinate exchange (Meyer and Nachtsheim 1995): one measurement after the other is exchanged for
the best of a few drawn about it, at a distance that grows where that helps and shrinks elsewhere,
and of some candidates from all over, by which a design leaves a local optimum.
"""

from collections.abc import Callable

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import Criterion
from campaigns.design.exchange import ADD, EXCHANGE_REGULARISATION, REMOVE, covariance_of, woodbury
from campaigns.design.pose_sampling import FeasibleRegion

NEIGHBOURS = 24
"""Places about each measurement that are tried in a round."""
OFFERED = 200
"""Candidates that are tried for all measurements in a round."""
FIRST_DISTANCE, LARGEST_DISTANCE = 0.1, 0.5
"""Standard deviation of places about a measurement, in shares of the workspace's half size."""
FURTHER, NEARER = 1.3, 0.7


def refine(
    poses: Array,
    region: FeasibleRegion,
    jacobians: Callable[[Array], Array],
    candidates: Candidates,
    candidate_poses: Array,
    criterion: Criterion,
    rounds: int,
    rng: np.random.Generator,
) -> Array:
    """Poses (N, e, t) of measurements, all different, moved inside a region.

    `jacobians` are those of measurements (M, e, t) by the candidates' scaled unknowns, (M, k, P);
    of the candidates themselves the poses (M, e, t) are given.
    """
    poses, distance = poses.copy(), np.full(len(poses), FIRST_DISTANCE)
    extent = region.extent
    held = jacobians(poses)
    covariance = covariance_of(candidates, held, EXCHANGE_REGULARISATION)
    value = criterion.value(covariance)
    for _ in range(rounds):
        weight = criterion.weight(covariance)
        shape = (len(poses), NEIGHBOURS, *poses.shape[1:])
        steps = rng.standard_normal(shape) * distance[:, None, None, None] * extent
        flat = (poses[:, None] + steps).reshape(-1, len(extent))
        moved, allowed = region.drawn_in(flat)
        places, usable = moved.reshape(shape), np.all(allowed.reshape(shape[:3]), axis=2)
        seen = np.zeros((*shape[:2], *held.shape[1:]))
        seen[usable] = jacobians(places[usable])
        offered = rng.permutation(len(candidates))[:OFFERED]
        offered = offered[~known_places(candidate_poses[offered], poses)]
        for row in range(len(poses)):
            near = seen[row, usable[row]]
            tried = np.concatenate([near, candidates.jacobians[offered]])
            found = None
            if len(tried):
                without = woodbury(covariance, held[row], REMOVE)
                best = _most_telling(criterion, without, weight, tried)
                found = woodbury(without, tried[best], ADD)
            if found is None or (lowered := criterion.value(found)) >= value:
                distance[row] *= NEARER
                continue
            covariance, value, held[row] = found, lowered, tried[best]
            if best < len(near):
                poses[row] = places[row, usable[row]][best]
                distance[row] = min(FURTHER * distance[row], LARGEST_DISTANCE)
            else:
                poses[row] = candidate_poses[offered[best - len(near)]]
                distance[row] = FIRST_DISTANCE
                offered = np.delete(offered, best - len(near))
        # free of the rounding of all updates
        covariance = covariance_of(candidates, held, EXCHANGE_REGULARISATION)
        value = criterion.value(covariance)
    return poses


def known_places(poses: Array, others: Array) -> Mask:
    """Mask of the measurements at poses (M, e, t) that are among others, (N, e, t), too."""
    return np.asarray((poses[:, None] == others).all(axis=(2, 3)).any(axis=1))


def _most_telling(criterion: Criterion, covariance: Array, weight: Array, seen: Array) -> int:
    """Row of the Jacobians (K, k, P) whose measurement lowers the criterion most."""
    turned = seen.reshape(-1, len(covariance)) @ covariance
    weighted = (turned @ weight).reshape(seen.shape)
    turned = turned.reshape(seen.shape)
    # by components, and in one piece: the criterion is formed of all measurements at once
    predicted = np.ascontiguousarray((turned @ seen.transpose(0, 2, 1)).transpose(1, 2, 0))
    sensitivity = np.ascontiguousarray((weighted @ turned.transpose(0, 2, 1)).transpose(1, 2, 0))
    return int(np.argmax(criterion.improvement(predicted, sensitivity)))
