"""Simulated campaigns of a study: what they share, and each estimate beside the truth."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError, OptionsInvalid
from campaigns.estimation.estimators import Model
from campaigns.estimation.information import WorkspaceSample, position_std_mm, predict_points
from campaigns.estimation.observability import observability, unobservable_combinations
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.estimation.rigid_transforms import Transform, fit_transform
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2, roots
from campaigns.identification.fit import fit_shots
from campaigns.identification.model_selection import select_geometry
from campaigns.identification.observations import Inputs, point_observations
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import REFLECTOR_CONSTANT, ParameterSelection
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.mechanisms.parameters import ParameterSpace
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, poses_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

Noise = Callable[[Array, np.random.Generator], Array]
"""Errors (N, 3), mm, of an instrument of one's own at points (N, 3) in its frame."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StudySetup:
    """Setup that all campaigns of a study share."""

    nominal: Kinematics
    shots: Shots
    """Shots of the plan to identify from; each campaign draws their points."""
    free: tuple[str, ...]
    instrument: TrackerUncertainty
    """Uncertainty that the simulated tracker states, and has unless there is a `noise`."""
    tracker_from_base: Transform
    workspace: Array
    """Poses (N, t) at which positions are judged."""
    seed: int
    noise: Noise | None = None

    @property
    def dof(self) -> int:
        """Number of measured coordinates less parameters and the frame's six."""
        return 3 * len(self.shots) - len(self.free) - FRAME_COLUMNS

    def inputs(self, points_mm: Array) -> Inputs:
        """Return the inputs of the fit of points (N, 3) in the tracker's frame."""
        shots = replace(self.shots, points_in_tracker_mm=points_mm)
        options = IdentificationOptions(instrument=self.instrument)
        return Inputs.of(self.nominal, shots, ParameterSelection(self.free), options)


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignEstimate:
    """Estimate of one campaign's free parameters beside the truth, in file units (mm, deg)."""

    errors: tuple[float, ...]
    """Identified minus true, (F,)."""
    std: tuple[float, ...]
    """Standard deviations as the estimator states them, (F,)."""
    bound: tuple[float, ...]
    """Least standard deviations that the shots allow (Cramér and Rao), at the truth, (F,)."""
    position_mm: float
    """Real error of positions over the workspace after the best fit of the frame, rms."""
    stated_mm: float
    """The same as the estimator states it."""


@dataclass(frozen=True, slots=True)
class CampaignRow:
    """Outcome of a campaign: an estimate, or why there is none."""

    campaign: int
    """Number."""
    failure: str = ""
    estimate: CampaignEstimate | None = None


def simulate_campaigns(
    setup: StudySetup, numbers: Sequence[int], truths: Array
) -> Iterator[CampaignRow]:
    """Simulate and identify campaigns of these numbers with true parameters (C, P)."""
    sample = WorkspaceSample.of(setup.nominal, setup.free, setup.workspace)
    for number, truth in zip(numbers, truths, strict=True):
        true = Kinematics(setup.nominal.mechanism, truth)
        rng = np.random.default_rng([setup.seed, number])
        try:
            yield CampaignRow(number, estimate=_estimate(setup, true, sample, rng))
        except (NoSolution, CampaignError, np.linalg.LinAlgError) as error:
            yield CampaignRow(number, failure=str(error))


def _estimate(
    setup: StudySetup, true: Kinematics, sample: WorkspaceSample, rng: np.random.Generator
) -> CampaignEstimate:
    space, joints = setup.nominal.mechanism.parameters, setup.shots.joints
    places, units = space.places(setup.free), space.units(setup.free)
    poses = true.forward(joints, setup.shots.commanded).values_or_raise()
    fit = fit_shots(setup.inputs(_measured_mm(setup, poses, rng))).found
    if not fit.fit.converged:
        raise NoSolution(fit.fit.message)
    if fit.covariance is None or fit.seen.rank < len(places):
        raise NoSolution(f"rank {fit.seen.rank} of {len(places)}")
    count, p = len(places), setup.nominal.p.copy()
    p[places] = fit.x[:count]
    covariance = fit.covariance[:count, :count] / np.outer(units, units)
    stated_mm = position_std_mm(sample.jacobian, covariance)
    return CampaignEstimate(
        errors=tuple(((p - true.p)[places] / units).tolist()),
        std=tuple(np.sqrt(np.diag(covariance)).tolist()),
        bound=tuple((_bound(setup, true, poses) / units).tolist()),
        position_mm=_position_error_mm(setup, true, Kinematics(true.mechanism, p)),
        stated_mm=float(np.sqrt(np.mean(stated_mm**2))),
    )


def _measured_mm(setup: StudySetup, poses: Array, rng: np.random.Generator) -> Array:
    """Points (N, 3) with noise in the tracker's frame."""
    points_mm = setup.tracker_from_base.apply(poses[:, :3])
    if setup.noise is not None:
        return points_mm + setup.noise(points_mm, rng)
    scatter_mm = roots(point_covariance_mm2(points_mm, setup.instrument))
    drawn = rng.standard_normal(points_mm.shape)
    return np.asarray(points_mm + np.einsum("nij,nj->ni", scatter_mm, drawn))


def _bound(setup: StudySetup, true: Kinematics, poses: Array) -> Array:
    """Cramér-Rao bound of standard deviations, (F,), mm and rad.

    By Fisher's information of the coordinates at the true robot.
    """
    points_mm = setup.tracker_from_base.apply(poses[:, :3])
    in_base_axes_mm = points_mm @ setup.tracker_from_base.rotation
    noise_mm2 = point_covariance_mm2(in_base_axes_mm, setup.instrument)
    covariance, _ = predict_points(true, setup.free, setup.shots.joints, poses, noise_mm2)
    return np.sqrt(np.diag(covariance)[: len(setup.free)])


def _position_error_mm(setup: StudySetup, true: Kinematics, identified: Kinematics) -> float:
    """Root mean square over the workspace, after the best fit of the frame."""
    joints = setup.nominal.inverse(setup.workspace).values_or_raise()
    modelled, real = (
        robot.forward(joints, setup.workspace).values_or_raise()[:, :3]
        for robot in (identified, true)
    )
    left = real - fit_transform(modelled, real).apply(modelled)
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def planned_shots(shots: Sequence[PlannedShot]) -> Shots:
    """Return planned shots as measured ones whose points are not numbers yet."""
    joints, count = joints_of(shots), len(shots)
    return Shots(
        numbers=tuple(range(count)),
        purposes=tuple(shot.purpose for shot in shots),
        pairs=tuple(shot.pair for shot in shots),
        joints=joints,
        points_in_tracker_mm=np.full((count, 3), np.nan),
        stated_covariance_mm2=np.full((count, 3, 3), np.nan),
        approach=np.zeros_like(joints),
        commanded=poses_of(shots),
        measured_utc=("",) * count,
        temperature_degC=np.full(count, np.nan),
    )


def identification_shots(shots: Sequence[PlannedShot]) -> tuple[PlannedShot, ...]:
    """Return the planned shots to identify from."""
    return tuple(shot for shot in shots if shot.purpose is ShotSet.IDENTIFICATION)


def studied_parameters(
    space: ParameterSpace, model: Model, freed: Sequence[str], fixed: Sequence[str]
) -> tuple[str, ...]:
    """Names of the geometry's parameters that all campaigns find; raises `OptionsInvalid`."""
    if model in {Model.AUTO, Model.EXTENDED}:
        raise OptionsInvalid(
            f"--model {model} finds other parameters in each campaign, whose σ don't compare",
            remedy="name one, such as --model full",
        )
    if REFLECTOR_CONSTANT in freed:
        raise OptionsInvalid(
            f"--free {REFLECTOR_CONSTANT}: no fit of a study finds it", remedy="leave it out"
        )
    return select_geometry(space, model, freed, fixed)


def indistinguishable(setup: StudySetup) -> list[tuple[str, ...]]:
    """Find free parameters that move together without any effect on the nominal robot's shots.

    Raises `NoSolution` when the nominal robot cannot take them.
    """
    poses = setup.nominal.forward(setup.shots.joints).values_or_raise()
    inputs = setup.inputs(setup.tracker_from_base.apply(poses[:, :3]))
    problem = point_observations(inputs).problem
    seen = observability(problem.jacobian(problem.start()))
    return unobservable_combinations(seen, setup.free)
