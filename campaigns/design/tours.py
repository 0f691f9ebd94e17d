"""Tours of poses: pairs worth a distance, little travel, joints approached from both sides.

The order of shots is a travelling salesman's problem whose cities are pairs of shots: both shots of
a pair follow each other, in either sense. A short tour saves time, and drift with it. Nearest
neighbour and 2-opt are enough: the balance of approaches lengthens the shortest tour again.

The distance between shots is the time of a coordinated move: the longest joint's travel. Joints
(N, n) are in radians of a crank, or carriages' travel in units that compare with them.
"""

from collections.abc import Iterator
from itertools import combinations_with_replacement

import numpy as np

from campaigns.arrays import Array, Index, Mask

WORTHWHILE_PAIR_MM = 250.0
"""Distance from which a pair determines enough; neighbours on the shortest tour are nearer."""
SHORTNESS_RAD_PER_MM = 0.1
"""Cost of each mm by which a pair is too short, as travel between its ends."""
EVEN_SHARE = (0.37, 0.63)
"""Share of approaches from smaller angles that separates backlash from the joints' offsets."""
LEAST_GAIN_RAD = 1e-9
"""A shorter way counts only above the rounding of the longer one."""


def neighbouring_pairs(joints: Array, points_mm: Array, start: Array) -> Index:
    """Pair an even number of rows, near each other in joints (N, n) but not in space, (N/2, 2)."""
    # 1. Tour of single shots, each as a pair of itself: consecutive shots are the first pairs.
    # 2. Exchange ends between pairs while the cost falls: the travel within pairs, and a penalty
    #    for pairs shorter than 250 mm. Each exchange lowers the cost, so the rounds end.
    single = np.repeat(np.arange(len(joints))[:, None], 2, axis=1)
    pairs = shortest_tour(joints, single, start)[:, 0].reshape(-1, 2)
    cost = travel_rad(joints[:, None], joints)
    apart = np.linalg.norm(points_mm[:, None] - points_mm, axis=2)
    cost = cost + SHORTNESS_RAD_PER_MM * np.maximum(0.0, WORTHWHILE_PAIR_MM - apart)
    while any(_exchange_end(pairs, cost, row) for row in range(len(pairs))):
        pass
    return pairs


def _exchange_end(pairs: Index, cost: Array, row: int) -> bool:
    """Exchange the row's second end for another pair's, if that saves; return whether it did."""
    # (first, second), (a, b) → (first, a), (second, b) or (first, b), (second, a): saved (M, 2)
    first, second = pairs[row]
    now = cost[first, second] + cost[pairs[:, 0], pairs[:, 1]]
    saved = now[:, None] - cost[first, pairs] - cost[second, pairs[:, ::-1]]
    saved[row] = 0.0
    other, end = np.unravel_index(int(np.argmax(saved)), saved.shape)
    if saved[other, end] <= 1e-9:
        return False
    pairs[row, 1], pairs[other, end] = pairs[other, end], second
    return True


def positive_approach_shares(joints: Array, start: Array, counted: Mask) -> Array:
    """Return the share of counted shots (N,) at which each joint came from a smaller angle, (n,).

    Moves between shots are taken as straight; joints (N, n) are in the order of the shots.
    """
    rising = np.diff(np.vstack([start, joints]), axis=0) > 0.0
    return np.asarray(rising[counted].mean(axis=0))


def balance_approaches(joints: Array, pairs: Index, start: Array, counted: Mask) -> Index:
    """Order pairs (M, 2) with little travel so that joints are approached from both sides.

    `counted` (N,) are the rows of joints whose shares count. With a handful of shots no order may
    bring every share within `EVEN_SHARE`.
    """
    # Backlash leaves a joint behind by half of it, on the side of the approach: shots that all come
    # from one side determine only its sum with the joint's offset. Beginning with the shortest
    # tour, reverse the one stretch that balances best, of equally good ones that with the least
    # travel, until all shares are even or no reversal helps.
    tour = shortest_tour(joints, pairs, start)
    if not counted.any():
        return tour
    imbalance = _imbalance(tour, joints, start, counted)
    while imbalance > 0.0:
        trials = list(_reversals(tour))
        imbalances = np.array([_imbalance(trial, joints, start, counted) for trial in trials])
        if imbalances.min() >= imbalance:
            break
        imbalance = float(imbalances.min())
        best = [trials[place] for place in np.flatnonzero(imbalances == imbalance)]
        tour = min(best, key=lambda trial: _travel(trial, joints, start))
    return tour


def _reversals(tour: Index) -> Iterator[Index]:
    """Yield the tour with each stretch reversed, the shots of its pairs too."""
    for first, last in combinations_with_replacement(range(len(tour)), 2):
        trial = tour.copy()
        trial[first : last + 1] = tour[first : last + 1][::-1, ::-1]
        yield trial


def _imbalance(tour: Index, joints: Array, start: Array, counted: Mask) -> float:
    """Return the distance of the shares from `EVEN_SHARE`, summed over the joints."""
    order = tour.ravel()
    shares = positive_approach_shares(joints[order], start, counted[order])
    low, high = EVEN_SHARE
    return float(np.sum(np.maximum(0.0, low - shares) + np.maximum(0.0, shares - high)))


def _travel(tour: Index, joints: Array, start: Array) -> float:
    """Return the travel of the whole tour from `start`."""
    stops = np.vstack([start, joints[tour.ravel()]])
    return float(travel_rad(stops[:-1], stops[1:]).sum())


def shortest_tour(joints: Array, pairs: Index, start: Array) -> Index:
    """Order pairs (M, 2), and their shots, so that the joints' travel from `start` is short."""
    return _two_opt(_nearest_neighbour(joints, pairs, start), joints, start)


def travel_rad(from_rad: Array, to_rad: Array) -> Array:
    """Return the travel that a coordinated joint move takes time for: the largest joint's way."""
    return np.asarray(np.abs(to_rad - from_rad).max(axis=-1))


def _nearest_neighbour(joints: Array, pairs: Index, start: Array) -> Index:
    """Order pairs (M, 2): each next one is that with the nearest end, which comes first."""
    remaining, here, ordered = list(range(len(pairs))), start, []
    while remaining:
        to_ends = travel_rad(here, joints[pairs[remaining]])
        place, end = np.unravel_index(int(np.argmin(to_ends)), to_ends.shape)
        pair = pairs[remaining.pop(int(place))]
        ordered.append(pair if end == 0 else pair[::-1])
        here = joints[ordered[-1][1]]
    return np.array(ordered, dtype=np.intp).reshape(-1, 2)


# 2-opt (Croes 1958): reverse a stretch of the tour while that shortens it. A reversed stretch has
# its pairs turned round too, so the moves inside stay, and only its two joins change. Stretches are
# tried from every first pair, in later rounds only from those next to a change of the round before
# ("don't look bits", Bentley 1992). Where no change is left, all are tried once more.
def _two_opt(pairs: Index, joints: Array, start: Array) -> Index:
    """Return pairs (M, 2) after all reversals that shorten the tour; the array is changed."""
    is_due = np.ones(max(len(pairs) - 1, 0), dtype=np.bool_)
    ends = np.ascontiguousarray(joints[pairs].transpose(1, 2, 0))
    while is_due.any():
        near_changes = np.zeros_like(is_due)
        for first in np.flatnonzero(is_due).tolist():
            gains = _gains_rad(ends, start, first)
            best = int(np.argmax(gains))
            if gains[best] > LEAST_GAIN_RAD:
                last = first + best + 1
                stretch = slice(first, last + 1)
                pairs[stretch] = pairs[stretch][::-1, ::-1]
                ends[:, :, stretch] = ends[::-1, :, stretch][:, :, ::-1]
                for join in (first, last):
                    near_changes[max(join - 1, 0) : join + 2] = True
        if not near_changes.any():
            near_changes[:] = not is_due.all()
        is_due = near_changes
    return pairs


# A stretch runs from the pair `first` to a later one, its last. As it is, the tour goes
#
#     before → entry of the first … exit of the last → after
#
# and with the stretch reversed
#
#     before → exit of the last … entry of the first → after
#
# so that only these two joins change. Columns are all possible last pairs; behind the tour's last
# pair nothing follows, and a stretch up to it has no second join.
def _gains_rad(ends: Array, start: Array, first: int) -> Array:
    """Return by how much reversing the pairs from `first` to each later one shortens the tour.

    `ends` (2, n, M) are the joints at which pairs are entered and left.
    """
    entries, exits = ends
    before = start if first == 0 else exits[:, first - 1]
    entry_of_first = entries[:, first]
    exits_of_last = exits[:, first + 1 :]
    after = entries[:, first + 2 :]

    join_before = travel_rad(before, entry_of_first)
    join_behind = _travel_by_joint(exits_of_last[:, :-1], after)
    reversed_join_before = _travel_by_joint(before[:, None], exits_of_last)
    reversed_join_behind = _travel_by_joint(entry_of_first[:, None], after)

    gains = join_before - reversed_join_before
    gains[:-1] += join_behind - reversed_join_behind
    return gains


def _travel_by_joint(from_rad: Array, to_rad: Array) -> Array:
    """Return the travel (M,) between joints (n, M), which are faster to compare in this order."""
    return np.asarray(np.abs(to_rad - from_rad).max(axis=0))
