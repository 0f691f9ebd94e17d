"""Refinement of a design beyond its candidates: poses moved while that lowers the criterion.

Coordinate exchange (Meyer and Nachtsheim 1995): one measurement after the other is exchanged for
the best of a few drawn about it, at a distance that grows where that helps and shrinks elsewhere.
"""

from collections.abc import Callable

import numpy as np

from campaigns.arrays import Array
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import Criterion
from campaigns.design.exchange import ADD, EXCHANGE_REGULARISATION, REMOVE, covariance_of, woodbury
from campaigns.design.pose_sampling import FeasibleRegion

NEIGHBOURS = 12
"""Places tried for each measurement in a round."""
FIRST_DISTANCE, LARGEST_DISTANCE = 0.1, 0.5
"""Standard deviation of places about a measurement, in shares of the workspace's half size."""
FURTHER, NEARER = 1.3, 0.7


def refine(
    poses: Array,
    region: FeasibleRegion,
    jacobians: Callable[[Array], Array],
    candidates: Candidates,
    criterion: Criterion,
    rounds: int,
    rng: np.random.Generator,
) -> Array:
    """Poses (N, e, t) of measurements, moved inside a region.

    `jacobians` are those of measurements (M, e, t) by the candidates' scaled unknowns, (M, k, P).
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
        for row in range(len(poses)):
            tried = np.flatnonzero(usable[row])
            found = None
            if len(tried):
                without = woodbury(covariance, held[row], REMOVE)
                best = tried[_most_telling(criterion, without, weight, seen[row, tried])]
                found = woodbury(without, seen[row, best], ADD)
            if found is None or (lowered := criterion.value(found)) >= value:
                distance[row] *= NEARER
                continue
            covariance, value = found, lowered
            held[row], poses[row] = seen[row, best], places[row, best]
            distance[row] = min(FURTHER * distance[row], LARGEST_DISTANCE)
        # free of the rounding of all updates
        covariance = covariance_of(candidates, held, EXCHANGE_REGULARISATION)
        value = criterion.value(covariance)
    return poses


def _most_telling(criterion: Criterion, covariance: Array, weight: Array, seen: Array) -> int:
    """Row of the Jacobians (K, k, P) whose measurement lowers the criterion most."""
    turned = seen @ covariance
    predicted = turned @ seen.transpose(0, 2, 1)
    sensitivity = turned @ weight @ turned.transpose(0, 2, 1)
    gains = criterion.improvement(predicted.transpose(1, 2, 0), sensitivity.transpose(1, 2, 0))
    return int(np.argmax(gains))
