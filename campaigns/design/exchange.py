"""Exchange of shots, with each candidate's statistics kept up to date as shots come and go.

Adding or taking away a measurement changes the covariance by a matrix of rank k (Woodbury); what
it would do to each candidate follows from one product of that thin matrix with all rows, without
touching the P x P covariance again for any of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design.candidates import Candidates
from campaigns.design.criteria import Criterion, improvement
from campaigns.estimation.observability import observability, unobservable_combinations

ADD, REMOVE = 1.0, -1.0


@dataclass(frozen=True, slots=True, eq=False)
class CandidateStatistics:
    """Covariance of the unknowns, and each candidate's prediction and sensitivity by it."""

    covariance: Array
    """C of scaled unknowns, (P, P)."""
    predicted_covariance: Array
    """J C Jᵀ of each candidate's rows J, (k, k, M)."""
    sensitivity: Array
    """J C W C Jᵀ of each candidate's rows J, (k, k, M)."""


@dataclass(frozen=True, slots=True, eq=False)
class RankKUpdater:
    """Jacobians of all candidates, laid out for fast products, and the weight W (P, P)."""

    jacobians: Array
    """(M, k, P)"""
    columns: Array
    """Jacobians by columns, (P, k, M)."""
    weight: Array

    @classmethod
    def of(cls, candidates: Candidates, weight: Array) -> "RankKUpdater":
        """Updater for candidates and a weight."""
        columns = np.ascontiguousarray(candidates.jacobians.transpose(2, 1, 0))
        return cls(candidates.jacobians, columns, weight)

    def evaluate(self, covariance: Array) -> CandidateStatistics:
        """Statistics from nothing but the covariance."""
        weighted = covariance @ self.weight @ covariance
        return CandidateStatistics(covariance, self._seen(covariance), self._seen(weighted))

    def added(self, known: CandidateStatistics, which: int) -> CandidateStatistics:
        """Statistics with a candidate taken in."""
        return self._changed(known, which, ADD)

    def removed(self, known: CandidateStatistics, which: int) -> CandidateStatistics:
        """Statistics without one that had been taken in."""
        return self._changed(known, which, REMOVE)

    def covariance_with(self, known: CandidateStatistics, which: int) -> Array:
        """The covariance if a candidate were taken in, (P, P)."""
        return woodbury(known.covariance, self.jacobians[which], ADD)

    def _seen(self, matrix: Array) -> Array:
        """J X Jᵀ of each candidate, (k, k, M)."""
        size, k, count = self.columns.shape
        turned = (matrix @ self.columns.reshape(size, -1)).reshape(size, k, count)
        return np.asarray(np.einsum("pam,pbm->abm", turned, self.columns))

    def _changed(self, known: CandidateStatistics, which: int, sign: float) -> CandidateStatistics:
        turned, middle = _woodbury_terms(known.covariance, self.jacobians[which], sign)
        # C W C changes by -(V K Rᵀ + R K Vᵀ) with R = C W V - V K (Vᵀ W V) / 2
        weighted = self.weight @ turned
        other = known.covariance @ weighted - 0.5 * turned @ (middle @ (turned.T @ weighted))
        thin = np.hstack([turned, other])
        size, k, count = self.columns.shape
        seen = (thin.T @ self.columns.reshape(size, -1)).reshape(2, k, k, count)
        by_turned, by_other = seen
        halves = np.tensordot(middle, by_turned, axes=1)
        change = np.einsum("iam,ibm->abm", halves, by_other)
        return CandidateStatistics(
            known.covariance - turned @ middle @ turned.T,
            known.predicted_covariance - np.einsum("iam,ibm->abm", halves, by_turned),
            known.sensitivity - change - change.transpose(1, 0, 2),
        )


def woodbury(covariance: Array, rows: Array, sign: float) -> Array:
    """Covariance (P, P) with a measurement's Jacobian (k, P) added or removed."""
    turned, middle = _woodbury_terms(covariance, rows, sign)
    return np.asarray(covariance - turned @ middle @ turned.T)


def _woodbury_terms(covariance: Array, rows: Array, sign: float) -> tuple[Array, Array]:
    """V (P, k) and K (k, k) such that the covariance changes by -V K Vᵀ."""
    turned = covariance @ rows.T
    middle = sign * np.linalg.inv(np.eye(len(rows)) + sign * rows @ turned)
    return turned, np.asarray(middle)


INITIAL_REGULARISATION = 0.3
"""Knowledge that a greedy choice pretends at first, in shares of a mean candidate's information."""
EXCHANGE_REGULARISATION = 1e-4
"""Regularisation while exchanging: the covariance stays finite with a shot out; weighs nothing."""
LEAST_GAIN = 1e-7
"""An exchange counts when the value falls by more than this part of it."""
FRAGILE = 100.0
"""Replacing a member without which the value is so many times worse leaves rounding behind."""
ROUNDS = 40
SHORT_LIST = 600
"""Exchanges are first sought among so many candidates, or twice as many as there are members."""
MEASUREMENTS_TRIED = 170
MOST_STARTS = 12
"""Small designs end in local optima more often, and cost little to start again."""
QUICKLY_EXCHANGED = 100
"""Quick growth exchanges no more members than these: beyond, greedy additions do as well."""


class Unobservable(ValueError):
    """Parameters that no choice of the candidates can tell apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """Rows of the chosen candidates, (N,), all different, and the criterion's value."""

    chosen: Index
    value: float


def optimal_design(
    candidates: Candidates,
    criterion: Criterion,
    count: int,
    rng: np.random.Generator,
    starts: int | None = None,
) -> Design:
    """The best of several exchanges, the first from a greedy choice, the others from random ones.

    Raises `ValueError` for a count above that of the candidates or below what the unknowns need,
    and `Unobservable`.
    """
    _check_count(candidates, count)
    if starts is None:
        starts = int(np.clip(MEASUREMENTS_TRIED // count, 1, MOST_STARTS))
    nothing = np.empty(0, dtype=np.intp)
    greedy = augment_greedily(candidates, criterion, nothing, count)
    others = [rng.choice(len(candidates), count, replace=False) for _ in range(starts - 1)]
    listed = _short_list(candidates, criterion, greedy)
    tried = [_exchanged_among(candidates, criterion, m, listed) for m in (greedy, *others)]
    best = min(tried, key=lambda design: design.value)
    return _exchanged_among_all(candidates, criterion, best.chosen)


def augment_design(
    candidates: Candidates, criterion: Criterion, chosen: Index, count: int
) -> Design:
    """Larger design from a smaller one: greedy additions, then exchange. Raises `ValueError`."""
    _check_count(candidates, count)
    return exchange(candidates, criterion, augment_greedily(candidates, criterion, chosen, count))


def augment_quickly(
    candidates: Candidates, criterion: Criterion, chosen: Index, count: int
) -> Index:
    """A larger choice from a smaller one, (count,), a few percent from what an exchange gives.

    Greedy additions, and for a small choice, where they go wrong most, exchange among a short list.
    """
    grown = augment_greedily(candidates, criterion, chosen, count)
    if count > QUICKLY_EXCHANGED:
        return grown
    listed = _short_list(candidates, criterion, grown)
    return _exchanged_among(candidates, criterion, grown, listed).chosen


def augment_greedily(
    candidates: Candidates, criterion: Criterion, chosen: Index, count: int
) -> Index:
    """`chosen` and, one after the other, the candidates that tell most, (count,)."""
    members = chosen.tolist()
    covariance = _covariance(candidates, chosen, INITIAL_REGULARISATION)
    updater = RankKUpdater.of(candidates, criterion.weight)
    known = updater.evaluate(covariance)
    while len(members) < count:
        members.append(_best(known, members))
        known = updater.added(known, members[-1])
    return np.array(members, dtype=np.intp)


def exchange(candidates: Candidates, criterion: Criterion, chosen: Index) -> Design:
    """The chosen candidates replaced one by one while that lowers the criterion's value."""
    listed = _short_list(candidates, criterion, chosen)
    design = _exchanged_among(candidates, criterion, chosen, listed)
    return _exchanged_among_all(candidates, criterion, design.chosen)


def _short_list(candidates: Candidates, criterion: Criterion, chosen: Index) -> Index:
    """The candidates that would tell most besides the chosen ones, (S,)."""
    _, known = _evaluated(candidates, criterion, chosen)
    gains = improvement(known.predicted_covariance, known.sensitivity)
    return np.argsort(-gains)[: max(SHORT_LIST, 2 * len(chosen))]


def _exchanged_among(
    candidates: Candidates, criterion: Criterion, chosen: Index, listed: Index
) -> Design:
    """Exchanged for none but those listed and the members there were."""
    rows = np.union1d(chosen, listed)
    few = replace(candidates, jacobians=candidates.jacobians[rows])
    design = _exchanged_among_all(few, criterion, np.searchsorted(rows, chosen))
    return replace(design, chosen=rows[design.chosen])


def _exchanged_among_all(candidates: Candidates, criterion: Criterion, chosen: Index) -> Design:
    """Members replaced one by one until a round lowers the criterion's value by nothing."""
    design = Design(
        chosen, criterion.value(_covariance(candidates, chosen, EXCHANGE_REGULARISATION))
    )
    for _ in range(ROUNDS):
        members = _exchange_pass(candidates, criterion, design)
        value = criterion.value(_covariance(candidates, members, EXCHANGE_REGULARISATION))
        if value >= (1.0 - LEAST_GAIN) * design.value:
            break
        design = Design(members, value)
    return design


def _exchange_pass(candidates: Candidates, criterion: Criterion, design: Design) -> Index:
    """Members after a pass, each replaced if another candidate gives a better value."""
    members, value = design.chosen.copy(), design.value
    updater, known = _evaluated(candidates, criterion, members)
    for place, member in enumerate(members):
        without = updater.removed(known, int(member))
        best = _best(without, np.delete(members, place))
        found = criterion.value(updater.covariance_with(without, best))
        if found >= (1.0 - LEAST_GAIN) * value:
            continue
        members[place], value = best, found
        known = updater.added(without, best)
        if criterion.value(without.covariance) > FRAGILE * value:
            updater, known = _evaluated(candidates, criterion, members)
    return members


def _evaluated(
    candidates: Candidates, criterion: Criterion, members: Index
) -> tuple[RankKUpdater, CandidateStatistics]:
    """Statistics from the information itself, free of the rounding of all updates before."""
    covariance = _covariance(candidates, members, EXCHANGE_REGULARISATION)
    updater = RankKUpdater.of(candidates, criterion.weight)
    return updater, updater.evaluate(covariance)


def _best(known: CandidateStatistics, taken: Sequence[int] | Index) -> int:
    gains = improvement(known.predicted_covariance, known.sensitivity)
    gains[np.asarray(taken, dtype=np.intp)] = -np.inf
    return int(np.argmax(gains))


def _covariance(candidates: Candidates, chosen: Index, pretended: float) -> Array:
    """Covariance of scaled unknowns, as if that share of a mean candidate were known besides."""
    information = candidates.information(chosen) + pretended * candidates.mean_information
    return np.asarray(np.linalg.inv(information))


def minimum_measurements(candidates: Candidates) -> int:
    """Fewest measurements that tell all unknowns apart, if they are not chosen badly.

    That is more than equations over unknowns: after some shots another one tells little but its own
    turn. Raises `Unobservable`.
    """
    check_observable(candidates.jacobian(np.arange(len(candidates))), candidates.names)
    unknowns = len(candidates.scale)
    counts = range(-(-unknowns // candidates.jacobians.shape[1]), len(candidates) + 1)
    return next(
        count
        for count in counts
        if observability(candidates.jacobian(np.arange(count))).rank == unknowns
    )


def check_observable(jacobian: Array, names: tuple[str, ...]) -> None:
    """Raise `Unobservable` if all there is to measure, (M, P), cannot tell the parameters apart."""
    seen = observability(np.asarray(np.linalg.qr(jacobian, mode="r")))
    if seen.rank < len(seen.singular_values):
        together = unobservable_combinations(seen, names)
        each = (f"{', '.join(combination)} move together" for combination in together)
        raise Unobservable(f"{'; '.join(each)}, whatever is measured")


def _check_count(candidates: Candidates, count: int) -> None:
    if count > len(candidates):
        raise ValueError(f"{count} measurements to choose, but only {len(candidates)} candidates")
    least = minimum_measurements(candidates)
    if count < least:
        raise ValueError(
            f"{count} measurements cannot tell {len(candidates.scale)} unknowns apart: "
            f"{least} or more are needed"
        )
