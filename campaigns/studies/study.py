"""Simulated campaigns of a study: robots and noise are drawn, each is fitted as by `identify`.

Robots are drawn as the fit expects them: geometry about its nominal values, every other source of
error at its tolerance. So the stated σ must be true if they are worked out rightly, and the study
shows what a plan gives. Robots of another kind are simulated by `dry-run`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError, PlanInvalid
from campaigns.fit.changes import fit_with_changes
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.error_sources import SOURCES, tracker_columns
from campaigns.fit.posterior import Posterior
from campaigns.fit.rigid_transforms import Transform, fit_transform
from campaigns.fit.tracker_noise import point_covariance_mm2
from campaigns.fit.uncertainty import null_directions, position_std_mm
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.kinematics.mechanism import Kinematics, NoSolution
from campaigns.kinematics.transmission import approach_along
from campaigns.planning.forecast import judged_at
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, poses_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

Noise = Callable[[Array, np.random.Generator], Array]
"""Errors (N, 3), mm, of an instrument of one's own at points (N, 3) in its frame."""
SPREAD = (1.0, 0.1)
"""1 σ of the drawn geometry about nominal, mm and deg: a robot that was set up with care."""
FEWEST_SHOTS = 6
"""Shots that place the tracker's frame and leave something to judge by."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class StudySetup:
    """Setup that all campaigns of a study share."""

    nominal: Kinematics
    shots: Shots
    """Shots of the plan to identify from; each campaign draws their points."""
    options: IdentificationOptions
    """Options of every fit; its instrument is what the simulated tracker states."""
    tracker_from_base: Transform
    workspace: Array
    """Poses (N, t) at which positions are judged."""
    seed: int
    spread: tuple[float, float] = SPREAD
    """1 σ of the drawn geometry about nominal, mm and deg."""
    noise: Noise | None = None
    """What the instrument really does; None: what it states."""

    def model(self) -> ErrorModel:
        """Return the model of all sources of error that every campaign is fitted with."""
        return error_model(self.nominal, None, self.options)


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignEstimate:
    """Estimate of one campaign beside the truth, in file units (mm, deg, ppm).

    Of combinations of parameters that no shot determines, errors and σ have no part.
    """

    errors: tuple[float, ...]
    """Identified minus true, (F,)."""
    std: tuple[float, ...]
    """Standard deviations as stated, (F,)."""
    position_mm: float
    """Real error of positions over the workspace after the best fit of the frame, rms."""
    stated_mm: float
    """Error of positions as it is stated."""


@dataclass(frozen=True, slots=True)
class CampaignRow:
    """Outcome of a campaign: an estimate, or why there is none."""

    campaign: int
    """Number."""
    failure: str = ""
    estimate: CampaignEstimate | None = None


def simulate_campaigns(setup: StudySetup, numbers: Sequence[int]) -> Iterator[CampaignRow]:
    """Draw, measure and identify the campaigns of these numbers, each by its own seed."""
    model = setup.model()
    for number in numbers:
        rng = np.random.default_rng([setup.seed, number])
        try:
            yield CampaignRow(number, estimate=_estimate(setup, model, rng))
        except (NoSolution, CampaignError, ValueError, np.linalg.LinAlgError) as error:
            yield CampaignRow(number, failure=str(error))


def _estimate(setup: StudySetup, model: ErrorModel, rng: np.random.Generator) -> CampaignEstimate:
    true = _drawn(setup, model, rng)
    robot = model.kinematics(true)
    poses = robot.forward(setup.shots.joints, setup.shots.commanded, setup.shots.approach)
    points = setup.tracker_from_base.apply(poses.values_or_raise()[:, :3])
    points = points + _instrument_errors(model, true, points) + _noise(setup, points, rng)
    covariance = point_covariance_mm2(points, setup.options.instrument)
    shots = replace(setup.shots, points_in_tracker_mm=points, stated_covariance_mm2=covariance)
    near = setup.nominal.forward(shots.joints, approach=shots.approach).values_or_raise()
    posterior, _ = fit_with_changes(model, observations_of(shots, near, setup.options))
    errors, std = _parameter_errors(posterior, true)
    real_mm, stated_mm = _positions(setup, posterior, robot)
    return CampaignEstimate(
        errors=tuple(errors.tolist()),
        std=tuple(std.tolist()),
        position_mm=real_mm,
        stated_mm=stated_mm,
    )


def _drawn(setup: StudySetup, model: ErrorModel, rng: np.random.Generator) -> Array:
    """Draw the true unknowns of a campaign, (P,) in tolerances."""
    scale = np.ones(len(model.names))
    table = setup.nominal.mechanism.parameters
    for place, (name, group) in enumerate(zip(model.parameters, model.groups, strict=False)):
        if not SOURCES[group].is_learned:
            length_mm, angle_deg = setup.spread
            spread = length_mm if table[name].unit == "mm" else np.radians(angle_deg)
            scale[place] = spread / model.tolerance[place]
    return np.asarray(scale * rng.standard_normal(len(scale)))


def _instrument_errors(model: ErrorModel, true: Array, points: Array) -> Array:
    """Return the errors (N, 3), mm, that all points of the drawn tracker have in common."""
    errors = np.zeros_like(points)
    for source, column in tracker_columns(points).items():
        if source in model.names:
            place = model.names.index(source)
            errors += true[place] * model.tolerance[place] * column
    return errors


def _noise(setup: StudySetup, points: Array, rng: np.random.Generator) -> Array:
    if setup.noise is not None:
        return setup.noise(points, rng)
    roots = np.linalg.cholesky(point_covariance_mm2(points, setup.options.instrument))
    return np.asarray((roots @ rng.standard_normal((*points.shape, 1)))[..., 0])


def _parameter_errors(posterior: Posterior, true: Array) -> tuple[Array, Array]:
    """Return errors and stated σ of the robot's parameters, (F,), in file units."""
    model = posterior.model
    count, null = len(model.parameters), null_directions(posterior)
    off = null.transform(posterior.x - true)
    variance = np.diag(null.transform_covariance(posterior.model_covariance))
    scale = model.file_tolerance[:count]
    return off[:count] * scale, np.sqrt(np.maximum(variance[:count], 0.0)) * scale


def _positions(setup: StudySetup, posterior: Posterior, true: Kinematics) -> tuple[float, float]:
    """Return real and stated errors of positions over the workspace, rms, mm."""
    identified = posterior.model.kinematics(posterior.x)
    joints = setup.nominal.inverse(setup.workspace).values_or_raise()
    modelled, real = (
        robot.forward(joints, setup.workspace).values_or_raise() for robot in (identified, true)
    )
    best_fit = fit_transform(modelled[:, :3], real[:, :3]).apply(modelled[:, :3])
    judged = judged_at(posterior.model, identified, joints, modelled)
    std = position_std_mm(judged, posterior.model_covariance)
    return float(np.sqrt(((real[:, :3] - best_fit) ** 2).sum(axis=1).mean())), float(
        np.sqrt((std**2).mean())
    )


def planned_shots(shots: Sequence[PlannedShot]) -> Shots:
    """Return the planned shots to identify from, as measured ones whose points are not known yet.

    Raise `PlanInvalid` for fewer than place the tracker's frame.
    """
    is_wanted = np.array([shot.purpose is ShotSet.IDENTIFICATION for shot in shots], dtype=bool)
    count = int(is_wanted.sum())
    if count < FEWEST_SHOTS:
        raise PlanInvalid(
            f"{count} shots to identify from are too few for a study",
            remedy=f"plan at least {FEWEST_SHOTS}, better 60",
        )
    joints = joints_of(shots)
    return Shots(
        numbers=tuple(range(count)),
        purposes=(ShotSet.IDENTIFICATION,) * count,
        pairs=tuple(shot.pair for shot, wanted in zip(shots, is_wanted, strict=True) if wanted),
        joints=joints[is_wanted],
        points_in_tracker_mm=np.full((count, 3), np.nan),
        stated_covariance_mm2=np.full((count, 3, 3), np.nan),
        approach=approach_along(joints)[is_wanted],
        commanded=poses_of(shots)[is_wanted],
        measured_utc=("",) * count,
        temperature_degC=np.full(count, np.nan),
    )
