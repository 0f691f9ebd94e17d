"""Simulated campaigns of a study: a Monte Carlo test of a plan, and of the stated σ.

A study answers two questions. How well will this plan identify the robot? And are the σ that an
identification states true? For each of N campaigns

1. draw a true robot: geometry about its nominal values, every other source of error from its
   tolerance, as the fit's prior supposes, and the tracker's common errors;
2. compute the points that it reaches at the joints of the plan, and add drawn noise;
3. fit these shots as `identify` does, but for slow motion of the stand, which no draw has;
4. compare with the truth, which only a simulation has: errors of the parameters beside their
   stated σ, and errors of positions over the workspace beside the stated ones.

The robots are of the kind that the fit expects: a study shows faults of the statistics, not what
the model lacks. Each campaign has a random generator of its own, made from seed and number: a
number gives the same campaign in whatever process and order it is simulated.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import CampaignError, PlanInvalid
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.error_sources import SOURCES, tracker_columns
from campaigns.fit.events import explain
from campaigns.fit.fit import Fit, integrate_sizes
from campaigns.fit.rigid_transforms import Transform, fit_transform
from campaigns.fit.tracker_noise import point_covariance_mm2
from campaigns.fit.uncertainty import length_std, null_directions, without_frame
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from campaigns.kinematics.model import Kinematics, KinematicSolution, NoSolution
from campaigns.kinematics.parameters import Role
from campaigns.kinematics.transmission import approach_along
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import joints_of, poses_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

Noise = Callable[[Array, np.random.Generator], Array]
"""Errors (N, 3), mm, of a user's instrument at points (N, 3) in the tracker's frame."""
SPREAD = (1.0, 0.1)
"""1 σ of the drawn geometry about nominal, mm and deg: a robot that was set up with care."""
FEWEST_SHOTS = 6
"""Shots that place the tracker's frame and leave something to judge by."""


@dataclass(frozen=True, eq=False, kw_only=True)
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
    """Real errors of the instrument; None: drawn from the covariance that it states."""

    @cached_property
    def model(self) -> ErrorModel:
        """Model of all sources of error that every campaign is fitted with."""
        return error_model(self.nominal, None, self.options)

    @cached_property
    def nominal_poses(self) -> Array:
        """Poses (N, t) of the nominal robot at the shots; raise `NoSolution`."""
        shots = self.shots
        return self.nominal.forward(shots.joints, approach=shots.approach).values_or_raise()

    @cached_property
    def judged(self) -> Observations:
        """Joints of the nominal robot at the poses of the workspace; raise `NoSolution`."""
        joints = self.nominal.inverse(self.workspace).values_or_raise()
        return Observations.unmeasured(joints, self.workspace)


@dataclass(frozen=True, slots=True, kw_only=True)
class CampaignEstimate:
    """Estimate of one campaign beside the truth, in file units (mm, deg, ppm).

    Combinations of parameters that no shot determines are left out of errors and σ.
    """

    errors: tuple[float, ...]
    """Identified minus true, (F,)."""
    std: tuple[float, ...]
    """Standard deviations as stated, (F,)."""
    position_mm: float
    """Real error of positions over the workspace after the best fit of the frame, rms."""
    stated_mm: float
    """Stated error of positions over the workspace, rms."""


@dataclass(frozen=True, slots=True)
class CampaignRow:
    """Outcome of a campaign: an estimate, or why there is none."""

    campaign: int
    """Number of the campaign."""
    failure: str = ""
    estimate: CampaignEstimate | None = None


def simulate_campaigns(setup: StudySetup, numbers: Sequence[int]) -> Iterator[CampaignRow]:
    """Draw, measure and identify the campaigns of these numbers, each by its own seed."""
    # A drawn robot that cannot be assembled at some shot, or a fit that fails, is an outcome of
    # its own: it must not end the other campaigns, and it must be counted.
    for number in numbers:
        rng = np.random.default_rng([setup.seed, number])
        try:
            yield CampaignRow(number, estimate=_simulate(setup, rng))
        except (NoSolution, CampaignError, ValueError, np.linalg.LinAlgError) as error:
            yield CampaignRow(number, failure=str(error))


def _simulate(setup: StudySetup, rng: np.random.Generator) -> CampaignEstimate:
    """Draw a robot, measure it and identify it, as numbered in the module's head."""
    model, true = setup.model, _draw_unknowns(setup, rng)
    robot = model.kinematics(true)
    # The recorded joints are those of the plan; the true robot is elsewhere at them. Its pose near
    # the commanded one is the assembly that the controller would drive.
    poses = robot.forward(setup.shots.joints, setup.shots.commanded, setup.shots.approach)
    points = setup.tracker_from_base.apply(robot.points(poses.values_or_raise()))
    points = points + _instrument_errors(model, true, points) + _draw_noise(setup, points, rng)
    # From here on as `identify`: only points, stated covariances and the nominal robot are used.
    covariance = point_covariance_mm2(points, setup.options.instrument)
    shots = replace(setup.shots, points_in_tracker_mm=points, stated_covariance_mm2=covariance)
    observations = observations_of(shots, setup.nominal_poses, setup.options)
    posterior = integrate_sizes(explain(model, observations))
    errors, std = _parameter_errors(posterior, true)
    real_mm, stated_mm = _position_errors_mm(setup, posterior, robot)
    return CampaignEstimate(
        errors=tuple(errors.tolist()),
        std=tuple(std.tolist()),
        position_mm=real_mm,
        stated_mm=stated_mm,
    )


def _draw_unknowns(setup: StudySetup, rng: np.random.Generator) -> Array:
    """Draw the true unknowns of a campaign, (P,) in tolerances."""
    # Geometry's prior is broad on purpose (5 mm, 5°): robots drawn from it would be off by
    # centimetres. Its groups that are not learned get the study's spread instead.
    model = setup.model
    scale = np.ones(len(model.names))
    table = setup.nominal.mechanism.parameters
    for place, (name, group) in enumerate(zip(model.parameters, model.groups, strict=False)):
        if not SOURCES[group].is_learned and table[name].field.role is Role.GEOMETRY:
            length_mm, angle_deg = setup.spread
            spread = length_mm if table[name].unit == "mm" else np.radians(angle_deg)
            scale[place] = spread / model.tolerance[place]
    return np.asarray(scale * rng.standard_normal(len(scale)))


def _instrument_errors(model: ErrorModel, true: Array, points: Array) -> Array:
    """Return the errors (N, 3), mm, that all points of the drawn tracker have in common."""
    # Scale, transit axis and reflector's constant: one drawn number each for the whole campaign.
    errors = np.zeros_like(points)
    for source, column in tracker_columns(points).items():
        if source in model.names:
            place = model.names.index(source)
            errors += true[place] * model.tolerance[place] * column
    return errors


def _draw_noise(setup: StudySetup, points: Array, rng: np.random.Generator) -> Array:
    """Draw the noise (N, 3), mm, of the points: as stated, or by the user's instrument."""
    if setup.noise is not None:
        return setup.noise(points, rng)
    # With V = L L', L times a standard normal vector has the covariance V.
    roots = np.linalg.cholesky(point_covariance_mm2(points, setup.options.instrument))
    return np.asarray((roots @ rng.standard_normal((*points.shape, 1)))[..., 0])


def _parameter_errors(posterior: Fit, true: Array) -> tuple[Array, Array]:
    """Return errors and stated σ of the robot's parameters, (F,), in file units."""
    # Only the difference to the truth is put into the datum: a shift of all arms together is no
    # error, since no shot can show it, and σ leaves out the same directions.
    model = posterior.model
    count, null = len(model.parameters), null_directions(posterior)
    off = null.transform(posterior.x - true)
    variance = np.diag(null.transform_covariance(posterior.model_covariance))
    scale = model.file_tolerance[:count]
    return off[:count] * scale, np.sqrt(np.maximum(variance[:count], 0.0)) * scale


def _position_errors_mm(setup: StudySetup, posterior: Fit, true: Kinematics) -> tuple[float, float]:
    """Return the real error of positions and their stated 1 σ, both rms over the workspace, mm."""
    # Both robots take the joints of the nominal one at the workspace's poses. The frame of the
    # identified robot is arbitrary, so the best rigid fit is taken off before the comparison, as
    # it is in the stated σ. The true one's search begins at the poses of the identified one.
    model, judged = posterior.model, setup.judged
    identified, assembly = model.positions(posterior.x, judged, judged.near)
    modelled = KinematicSolution(assembly.poses, assembly.is_solved).values_or_raise()
    real_points = true.points(true.forward(judged.joints, modelled).values_or_raise())
    placed = fit_transform(assembly.points, real_points).apply(assembly.points)
    columns, _ = model.robot_columns(identified, judged, assembly.unknowns)
    std = length_std(without_frame(columns, assembly.points), posterior.model_covariance)
    real_mm = float(np.sqrt(((real_points - placed) ** 2).sum(axis=1).mean()))
    return real_mm, float(np.sqrt((std**2).mean()))


def planned_shots(shots: Sequence[PlannedShot]) -> Shots:
    """Return the planned shots to identify from, as measured shots whose points are NaN.

    Raise `PlanInvalid` for fewer than `FEWEST_SHOTS`.
    """
    # Each shot's side of approach comes from the whole plan, before the other shots are left out:
    # the robot passes them too, and backlash depends on where it came from.
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
