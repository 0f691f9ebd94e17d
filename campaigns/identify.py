"""Identifies a robot's geometry from measured shots, and says honestly what came of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.dataset import Dataset
from campaigns.errors import ShotsMissing
from campaigns.numerics.fit import Fit, solve
from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import FILE_UNIT, FREE_BY_DEFAULT, NAMES, Array, Geometry, indices
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

    def geometry_flat(self) -> dict[str, float]:
        """The identified parameter set in file units."""
        return {parameter.name: parameter.value for parameter in self.parameters}

    def std_flat(self) -> dict[str, float]:
        """Standard deviations of the free parameters in file units."""
        return {p.name: p.std for p in self.parameters if p.std is not None}


def identify_distances(
    nominal: Geometry, data: Dataset, free: Sequence[str] = FREE_BY_DEFAULT
) -> Identification:
    """The paper's estimator: least squares of distances of pairs (eq. 19).

    Standard deviations come from the residuals' own variance. Raises `ShotsMissing` for fewer pairs
    than parameters.
    """
    names = tuple(free)
    pairs = data.pair_rows(ShotSet.IDENTIFICATION)
    _check_enough(pairs, names)
    rows = pairs.ravel()
    first, second = np.arange(0, len(rows), 2), np.arange(1, len(rows), 2)
    measured = data.measured_distances_mm(pairs)
    model = PositionModel(nominal, indices(names), data.joints_rad[rows])
    problem = DistanceResiduals(model, first, second, measured)
    before = problem.residual(problem.start())
    fit = solve(problem)
    seen = observability(fit.jacobian)
    identified = model.geometry(fit.x)
    unseen = _unseen(nominal, identified, data)
    residuals = BeforeAfter(spread(before), spread(fit.residual))
    verdict, reasons = _verdict(fit, seen, residuals, unseen)
    return Identification(
        "distances",
        fit.converged,
        fit.message,
        fit.evaluations,
        seen.rank,
        seen.condition,
        len(pairs) - seen.rank,
        _parameters(nominal, identified, names, _std(fit, seen, len(pairs))),
        residuals,
        unseen,
        (),
        tuple(unobservable_combinations(seen, names)),
        verdict,
        reasons,
    )


def _check_enough(pairs: Array, names: tuple[str, ...]) -> None:
    if len(pairs) < len(names):
        raise ShotsMissing(
            f"{len(pairs)} pairs cannot give {len(names)} parameters",
            remedy=f"measure at least {len(names)} pairs, better 60; or hold parameters",
        )


def _std(fit: Fit, seen: Observability, rows: int) -> Array | None:
    """Standard deviations in mm and rad; None where the data cannot give them."""
    free = rows - len(fit.x)
    if seen.rank < len(fit.x) or free == 0:
        return None
    variance = float(fit.residual @ fit.residual) / free
    return np.sqrt(variance * np.diag(covariance(fit.jacobian)))


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


def distance_errors_mm(geometry: Geometry, data: Dataset, pairs: Array) -> Array:
    """Modelled minus measured distances of pairs (M, 2), (M,). Raises `NoAssembly`."""
    positions = forward(geometry, data.joints_rad[pairs.ravel()]).require()[:, :3].reshape(-1, 2, 3)
    modelled = np.linalg.norm(positions[:, 1] - positions[:, 0], axis=1)
    return np.asarray(modelled - data.measured_distances_mm(pairs))


def _unseen(nominal: Geometry, identified: Geometry, data: Dataset) -> BeforeAfter | None:
    pairs = data.pair_rows(ShotSet.VALIDATION)
    if len(pairs) == 0:
        return None
    return BeforeAfter(
        spread(distance_errors_mm(nominal, data, pairs)),
        spread(distance_errors_mm(identified, data, pairs)),
    )


def _verdict(
    fit: Fit, seen: Observability, residuals: BeforeAfter, unseen: BeforeAfter | None
) -> tuple[Verdict, tuple[str, ...]]:
    """Whether the result may be used; the reasons against it, or for it."""
    against = []
    if not fit.converged:
        against.append(fit.message)
    if seen.rank < len(fit.x):
        against.append(
            f"rank {seen.rank} of {len(fit.x)}: the data cannot tell all parameters apart"
        )
    if unseen is not None and unseen.after.rms >= unseen.before.rms:
        against.append(
            f"unseen pairs got worse: rms {unseen.before.rms:.3f} → {unseen.after.rms:.3f} mm"
        )
    if against:
        return "fail", tuple(against)
    if unseen is None:
        return "not decided", (
            "no validation pairs: nothing shows that the result holds elsewhere",
        )
    return "pass", (
        f"unseen pairs: mean {unseen.before.mean_abs:.3f} → {unseen.after.mean_abs:.3f} mm, "
        f"max {unseen.before.max_abs:.3f} → {unseen.after.max_abs:.3f} mm",
        f"fitted pairs: rms {residuals.before.rms:.3f} → {residuals.after.rms:.4f} mm",
    )
