"""One simulated campaign after the other: what an estimator finds when the truth is known.

Shots are the model's own with the tracker's noise added, so a study shows what noise and plan do,
at hundreds of campaigns a second; what no parameter describes is for a dry run to show. Each
campaign draws from its own number alone, so the numbers are the same wherever and in whatever
order they are computed.
"""

import hashlib
from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.numerics.fit import Fit, solve
from campaigns.numerics.forward import forward
from campaigns.numerics.frames import Transform
from campaigns.numerics.geometry import FILE_UNIT, Array, Geometry, Index, indices
from campaigns.numerics.instrument import TrackerUncertainty, point_covariance_mm2
from campaigns.numerics.pairs import distances_mm
from campaigns.numerics.residuals import (
    DistanceResiduals,
    NoAssembly,
    PointResiduals,
    PositionModel,
    Residuals,
)
from campaigns.numerics.statistics import covariance

Estimator = Literal["distances", "points"]


@dataclass(frozen=True, slots=True, eq=False)
class PairedShots:
    """Joints (N, 4) of a plan's shots, and which rows are pairs, (M, 2)."""

    joints_rad: Array
    pairs: Index


@dataclass(frozen=True, slots=True, eq=False)
class StudySetup:
    """What all campaigns of a study share."""

    nominal: Geometry
    free: tuple[str, ...]
    estimator: Estimator
    fitted: PairedShots
    unseen: PairedShots
    tracker_from_base: Transform
    uncertainty: TrackerUncertainty
    seed: int

    def digest(self, truth: str) -> str:
        """Twelve characters that differ between studies; `truth` says how robots are drawn."""
        parts = [self.nominal.vector(), self.tracker_from_base.rotation]
        parts += [self.tracker_from_base.translation_mm]
        for shots in (self.fitted, self.unseen):
            parts += [shots.joints_rad, shots.pairs.astype(np.float64)]
        text = repr((truth, self.free, self.estimator, self.uncertainty, self.seed))
        hashed = hashlib.sha256(text.encode("utf-8"))
        for part in parts:
            hashed.update(np.ascontiguousarray(part).tobytes())
        return hashed.hexdigest()[:12]


@dataclass(frozen=True, slots=True, eq=False)
class StudyTask:
    """Some campaigns of a study, and the true parameters of each, (C, 29), mm and rad."""

    setup: StudySetup
    numbers: tuple[int, ...]
    truths: Array


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What one campaign found of the free parameters, in file units (mm, deg): it is to be read."""

    errors: Array
    """Identified minus true, (F,)."""
    std: Array
    """As the estimator states it, (F,)."""
    unseen_mean_mm: float
    """Of the errors of distances never fitted, against the true robot; NaN without such pairs."""
    unseen_max_mm: float


@dataclass(frozen=True, slots=True, eq=False)
class CampaignOutcome:
    """An estimate, or why there is none."""

    number: int
    estimate: Estimate | None
    failure: str


def run_task(task: StudyTask) -> tuple[CampaignOutcome, ...]:
    """Simulate and identify; a campaign that cannot be identified is an outcome too."""
    setup = task.setup
    fitted, unseen = (
        forward(setup.nominal, shots.joints_rad).require() for shots in (setup.fitted, setup.unseen)
    )
    near = _NominalPoses(fitted, unseen)
    return tuple(
        _outcome(setup, near, number, Geometry.from_vector(truth))
        for number, truth in zip(task.numbers, task.truths, strict=True)
    )


@dataclass(frozen=True, slots=True, eq=False)
class _NominalPoses:
    """Where the forward models begin to search, (N, 4) each."""

    fitted: Array
    unseen: Array


def _outcome(
    setup: StudySetup, near: _NominalPoses, number: int, true: Geometry
) -> CampaignOutcome:
    rng = np.random.default_rng([setup.seed, number])
    try:
        points = _measured(setup, true, near.fitted, rng)
        model = PositionModel(
            setup.nominal, indices(setup.free), setup.fitted.joints_rad, near.fitted
        )
        fit = solve(_problem(setup, model, points))
        if not fit.converged:
            return CampaignOutcome(number, None, fit.message)
        return CampaignOutcome(number, _estimate(setup, near, model, fit, true), "")
    except (NoAssembly, np.linalg.LinAlgError) as error:
        return CampaignOutcome(number, None, str(error))


def _measured(setup: StudySetup, true: Geometry, near: Array, rng: np.random.Generator) -> Array:
    """The reflector in the tracker's frame, with noise, (N, 3)."""
    positions = forward(true, setup.fitted.joints_rad, near).require()[:, :3]
    exact = setup.tracker_from_base.apply(positions)
    root = np.linalg.cholesky(point_covariance_mm2(exact, setup.uncertainty))
    return np.asarray(exact + np.einsum("nij,nj->ni", root, rng.standard_normal(exact.shape)))


def _problem(setup: StudySetup, model: PositionModel, points: Array) -> Residuals:
    if setup.estimator == "points":
        stated = point_covariance_mm2(points, setup.uncertainty)
        return PointResiduals.from_points(model, points, stated)
    first, second = setup.fitted.pairs.T
    return DistanceResiduals(model, first, second, distances_mm(points, first, second))


def _estimate(
    setup: StudySetup, near: _NominalPoses, model: PositionModel, fit: Fit, true: Geometry
) -> Estimate:
    count = len(setup.free)
    identified, unit = fit.x[:count], FILE_UNIT[indices(setup.free)]
    errors = identified - true.vector()[indices(setup.free)]
    std = stated_std(setup.estimator, fit)[:count]
    unseen_mm = _unseen_errors_mm(setup.unseen, near.unseen, model.geometry(identified), true)
    mean, most = (float("nan"),) * 2
    if unseen_mm.size:
        mean, most = float(unseen_mm.mean()), float(unseen_mm.max())
    return Estimate(errors / unit, std / unit, mean, most)


def stated_std(estimator: Estimator, fit: Fit) -> Array:
    """Standard deviations as stated with the result, (P,), mm and rad.

    From the residuals' own variance for distances; from the tracker's stated one for points.
    """
    variance = 1.0
    if estimator == "distances":
        variance = float(fit.residual @ fit.residual) / (len(fit.residual) - len(fit.x))
    return np.asarray(np.sqrt(variance * np.diag(covariance(fit.jacobian))))


def _unseen_errors_mm(
    unseen: PairedShots, near: Array, identified: Geometry, true: Geometry
) -> Array:
    """Sizes of the errors of distances, (M,); raises `NoAssembly`."""
    first, second = unseen.pairs.T
    exact_mm, found_mm = (
        distances_mm(forward(robot, unseen.joints_rad, near).require()[:, :3], first, second)
        for robot in (true, identified)
    )
    return np.abs(found_mm - exact_mm)
