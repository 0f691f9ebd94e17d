"""Identifies a robot's geometry from measured shots, and says honestly what came of it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from campaigns.dataset import Dataset
from campaigns.errors import ShotsMissing
from campaigns.numerics.fit import Fit, solve
from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import (
    FILE_UNIT,
    FREE_BY_DEFAULT,
    NAMES,
    Array,
    Geometry,
    Index,
    Mask,
    indices,
)
from campaigns.numerics.pairs import distances_mm
from campaigns.numerics.residuals import DistanceResiduals, PositionModel
from campaigns.numerics.statistics import (
    Observability,
    Spread,
    covariance,
    observability,
    spread,
    unobservable_combinations,
)
from campaigns.shot_sets import ShotSet

Estimator = Literal["distances"]
Verdict = Literal["pass", "fail", "not decided"]

ROUNDING_MM = 1e-6
STATIONARY_COSINE = 1e-3
"""Of the angle between the residual and a column of the Jacobian; a minimum reached gives 1e-6."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter before and after, in file units (mm or deg); `std` is None when unknown."""

    name: str
    nominal: float
    value: float
    std: float | None
    free: bool

    @property
    def delta(self) -> float:
        """Identified minus nominal."""
        return self.value - self.nominal


@dataclass(frozen=True, slots=True)
class BeforeAfter:
    """Errors in mm with the nominal and with the identified geometry."""

    before: Spread
    after: Spread


@dataclass(frozen=True, slots=True)
class Excluded:
    """A pair that was left out, and why."""

    pair: int
    reason: str


@dataclass(frozen=True, slots=True)
class Identification:
    """What was found, how well it is known, and whether it may be used."""

    estimator: Estimator
    converged: bool
    explanation: str
    iterations: int
    rank: int
    condition: float
    dof: int
    parameters: tuple[Parameter, ...]
    residuals: BeforeAfter
    unseen: BeforeAfter | None
    excluded: tuple[Excluded, ...]
    unobservable: tuple[tuple[str, ...], ...]
    verdict: Verdict
    reasons: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """Rows (M, 2) of the pairs that can be used, and those that cannot."""

    fitted: Index
    unseen: Index
    excluded: tuple[Excluded, ...]


@dataclass(frozen=True, slots=True)
class _Unseen:
    """The pairs that were never fitted: their errors, and those that the new model cannot take."""

    errors: BeforeAfter | None
    lost: tuple[Excluded, ...]


def identify_distances(
    nominal: Geometry, data: Dataset, free: Sequence[str] = FREE_BY_DEFAULT
) -> Identification:
    """The paper's estimator: least squares of distances of pairs (eq. 19).

    Standard deviations come from the residuals' own variance. Raises `ShotsMissing` for fewer pairs
    than parameters.
    """
    names = tuple(free)
    pairs = _usable_pairs(nominal, data)
    _check_enough(pairs, names)
    problem = _problem(nominal, data, pairs.fitted, names)
    before = problem.residual(problem.start())
    fit = _honest(solve(problem))
    seen = observability(fit.jacobian)
    identified = problem.model.geometry(fit.x)
    unseen = _unseen(nominal, identified, data, pairs.unseen)
    residuals = BeforeAfter(spread(before), spread(fit.residual))
    unobservable = tuple(unobservable_combinations(seen, names))
    against = tuple(_reasons_against(fit, unobservable, unseen))
    verdict, reasons = _verdict(against, residuals, unseen.errors)
    return Identification(
        "distances",
        fit.converged,
        fit.message,
        fit.evaluations,
        seen.rank,
        seen.condition,
        len(pairs.fitted) - seen.rank,
        _parameters(nominal, identified, names, _std(fit, seen)),
        residuals,
        unseen.errors,
        pairs.excluded + unseen.lost,
        unobservable,
        verdict,
        reasons,
    )


def _usable_pairs(nominal: Geometry, data: Dataset) -> _Pairs:
    """Whole pairs of shots at which the nominal robot can be assembled."""
    found = forward(nominal, data.joints_rad).found
    usable: list[Index] = []
    excluded: list[Excluded] = []
    for purpose in (ShotSet.IDENTIFICATION, ShotSet.VALIDATION):
        halves = data.half_pairs(purpose)
        excluded += [
            Excluded(_pair(data, row), f"shot {data.numbers[row]} has no partner") for row in halves
        ]
        rows = data.pair_rows(purpose)
        whole = found[rows].all(axis=1)
        excluded += _without_assembly(data, rows[~whole], found, "nominal")
        usable.append(rows[whole])
    return _Pairs(usable[0], usable[1], tuple(excluded))


def _without_assembly(data: Dataset, pairs: Index, found: Mask, which: str) -> list[Excluded]:
    """Say of pairs (M, 2) at which of their shots there is no assembly."""
    return [
        Excluded(
            _pair(data, row),
            f"the {which} robot cannot be assembled at the joints of shot {data.numbers[row]}",
        )
        for pair in pairs.tolist()
        for row in pair
        if not found[row]
    ]


def _pair(data: Dataset, row: int) -> int:
    pair = data.pairs[row]
    assert pair is not None, "only shots of pairs are asked for"
    return pair


def _check_enough(pairs: _Pairs, names: tuple[str, ...]) -> None:
    if len(pairs.fitted) >= len(names):
        return
    left_out = f" ({len(pairs.excluded)} left out)" if pairs.excluded else ""
    raise ShotsMissing(
        f"{len(pairs.fitted)} pairs{left_out} cannot give {len(names)} parameters",
        remedy=f"measure at least {len(names)} pairs, better 60; or hold parameters",
    )


def _problem(
    nominal: Geometry, data: Dataset, pairs: Index, names: tuple[str, ...]
) -> DistanceResiduals:
    places = np.arange(pairs.size).reshape(pairs.shape)
    model = PositionModel(nominal, indices(names), data.joints_rad[pairs.ravel()])
    measured_mm = data.measured_distances_mm(pairs)
    return DistanceResiduals(model, places[:, 0], places[:, 1], measured_mm)


def _honest(fit: Fit) -> Fit:
    """A solver that stopped before the edge of what can be assembled has not converged.

    At a minimum the residual is perpendicular to every column of the Jacobian, unless it is so
    small that only rounding is left of it.
    """
    size = float(np.linalg.norm(fit.residual))
    if size <= ROUNDING_MM * np.sqrt(len(fit.residual)):
        return fit
    columns = np.linalg.norm(fit.jacobian, axis=0)
    cosines = np.abs(fit.jacobian.T @ fit.residual) / (np.where(columns > 0.0, columns, 1.0) * size)
    if cosines.max() <= STATIONARY_COSINE:
        return fit
    message = "not converged: the solver stopped where the distances still fit better nearby"
    return replace(fit, converged=False, message=message)


def _std(fit: Fit, seen: Observability) -> Array | None:
    """Standard deviations in mm and rad; None where the data cannot give them."""
    dof = len(fit.residual) - len(fit.x)
    if seen.rank < len(fit.x) or dof == 0:
        return None
    variance = float(fit.residual @ fit.residual) / dof
    return np.asarray(np.sqrt(variance * np.diag(covariance(fit.jacobian))))


def _parameters(
    nominal: Geometry, identified: Geometry, names: tuple[str, ...], std: Array | None
) -> tuple[Parameter, ...]:
    known: dict[str, float] = {}
    if std is not None:
        known = dict(zip(names, (std / FILE_UNIT[indices(names)]).tolist(), strict=True))
    old, new = nominal.flat(), identified.flat()
    return tuple(
        Parameter(name, old[name], new[name], known.get(name), name in names) for name in NAMES
    )


def _unseen(nominal: Geometry, identified: Geometry, data: Dataset, pairs: Index) -> _Unseen:
    """Errors of the pairs (M, 2) that were not fitted, with both geometries."""
    solution = forward(identified, data.joints_rad)
    whole = solution.found[pairs].all(axis=1)
    lost = tuple(_without_assembly(data, pairs[~whole], solution.found, "identified"))
    kept = pairs[whole]
    if len(kept) == 0:
        return _Unseen(None, lost)
    measured_mm = data.measured_distances_mm(kept)
    poses = forward(nominal, data.joints_rad).values, solution.values
    before, after = (
        spread(distances_mm(values[:, :3], kept[:, 0], kept[:, 1]) - measured_mm)
        for values in poses
    )
    return _Unseen(BeforeAfter(before, after), lost)


def _reasons_against(
    fit: Fit, unobservable: tuple[tuple[str, ...], ...], unseen: _Unseen
) -> Iterator[str]:
    """Why the result must not be used."""
    if not fit.converged:
        yield fit.message
    for names in unobservable:
        yield f"the data cannot tell apart: {', '.join(names)}"
    for lost in unseen.lost:
        yield f"unseen pair {lost.pair}: {lost.reason}"
    errors = unseen.errors
    if errors is not None and not errors.after.rms <= errors.before.rms:
        yield f"unseen pairs got worse: rms {errors.before.rms:.4f} → {errors.after.rms:.4f} mm"


def _verdict(
    against: tuple[str, ...], residuals: BeforeAfter, unseen: BeforeAfter | None
) -> tuple[Verdict, tuple[str, ...]]:
    """Whether the result may be used; the reasons against it, or for it."""
    if against:
        return "fail", against
    if unseen is None:
        nothing_shown = "no validation pairs: nothing shows that the result holds elsewhere"
        return "not decided", (nothing_shown,)
    before, after = unseen.before, unseen.after
    gain = (
        f"unseen pairs: mean {before.mean_abs:.3f} → {after.mean_abs:.3f} mm, "
        f"max {before.max_abs:.3f} → {after.max_abs:.3f} mm"
    )
    fitted = f"fitted pairs: rms {residuals.before.rms:.3f} → {residuals.after.rms:.4f} mm"
    return "pass", (gain, fitted)
