"""Python API: robots, shots, identification, plans and studies without a campaign's folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from campaigns.arrays import AXES, Array, batch
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.design import pose_sampling
from campaigns.design.restricted_space import UNRESTRICTED, RestrictedSpace
from campaigns.errors import PlanInvalid
from campaigns.estimation.estimators import MAY_HAVE_GEARS, Estimator, Model
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.identification.model_selection import asked_shots, identify_model, select_geometry
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import IdentificationResult
from campaigns.planning import predicted_uncertainty
from campaigns.planning.optimal_plan import OptimalRequest, make_optimal_plan
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import Placement, PlanRequest, View, make_plan
from campaigns.robots import robot as robots
from campaigns.robots.robot import RobotFile, pose_of
from campaigns.settings.option import checked, options_of
from campaigns.shots import shots_csv
from campaigns.shots.shots import Shots, shots_of_rows
from campaigns.studies.study import (
    Noise,
    StudySetup,
    identification_shots,
    planned_shots,
    simulate_campaigns,
    studied_parameters,
)
from campaigns.studies.summary import StudySummary, summarise
from drivers.values import vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def find_robot(name: str | Path) -> RobotFile:
    """Robot of a shipped name or of a file; raises `ConfigInvalid`."""
    return robots.find_robot(str(name)).robot


def read_shots(path: Path | str, robot: RobotFile) -> Shots:
    """Measured shots of a CSV file in the form of shots.csv; raises `ShotsInvalid`."""
    return shots_of_rows(shots_csv.read_shots(Path(path), robot.mechanism), robot.kinematics)


def sample_workspace(robot: RobotFile, poses: int = 100, *, seed: int = 1) -> Array:
    """Poses (N, t), mm and rad, spread evenly over a robot's reach; raises `WorkspaceTooSmall`."""
    rng, centre = np.random.default_rng(seed), robot.workspace_centre
    return pose_sampling.workspace_poses(robot.kinematics, robot.limits, centre, poses, rng)


def identify(
    shots: Shots,
    robot: RobotFile,
    *,
    free: Sequence[str] | str = (),
    fix: Sequence[str] | str = (),
    priors: Sequence[str] | str | Mapping[str, float] = (),
    model: Model | str | None = None,
    options: IdentificationOptions | Mapping[str, object] | None = None,
) -> IdentificationResult:
    """Identify a nominal robot's parameters from shots, as `pkmcal identify` does by itself.

    `options` are those of `pkmcal identify` by name, with `_` for `-`, in its words or as values;
    `free`, `fix`, `priors` and `model` take precedence over them. Priors may also be σ by pattern,
    mm and deg. Raises `OptionsInvalid`, `ShotsMissing` and `ShotsInvalid`.
    """
    if isinstance(priors, Mapping):
        priors = [f"{pattern}={std}" for pattern, std in priors.items()]
    if isinstance(options, IdentificationOptions):
        words = {each.name: getattr(options, each.name) for each in fields(options)}
    else:
        reach = robot.kinematics, robot.limits, robot.workspace_centre
        sample = pose_sampling.sample_workspace(*reach)
        words = {"tolerance": robot.tolerance, "workspace": sample} | dict(options or {})
    given = {"free": free, "fix": fix, "prior": priors, "model": model}
    wanted = options_of(IdentificationOptions, words | {k: v for k, v in given.items() if v})
    return identify_model(robot.kinematics, asked_shots(shots, wanted), wanted)


def point_residuals(
    shots: Shots,
    robot: RobotFile,
    *,
    model: Model | str = Model.STANDARD,
    free: Sequence[str] | str = (),
    fix: Sequence[str] | str = (),
    uncertainty: TrackerUncertainty | None = None,
) -> PointResiduals:
    """Whitened residuals of points with their analytic Jacobian, for an estimator of one's own.

    Its `start()`, `residual(x)` and `jacobian(x)` are what a least-squares solver takes; x holds
    the free parameters, mm and rad, then six of the tracker's frame.
    `model.kinematics(parameters(x))` is the robot at x. Raises `OptionsInvalid`, `NoSolution`, and
    `ValueError` for points that fix no frame.
    """
    space = robot.mechanism.parameters
    names = select_geometry(space, checked(Model, model, "model"), free, fix)
    nominal, places = robot.kinematics, space.places(names)
    near = nominal.forward(shots.joints, approach=shots.approach).values_or_raise()
    return PointResiduals.from_points(
        PositionModel(nominal, places, shots.joints, near, approach=shots.approach),
        shots.points_in_tracker_mm,
        shots.covariance_mm2(uncertainty or TrackerUncertainty()),
    )


def correct_targets(poses: ArrayLike, identified: RobotFile, nominal: RobotFile) -> Array:
    """Poses (N, t) to command to a controller that holds the nominal parameters, for wanted ones.

    In mm and rad. Raises `TargetsInvalid` for a pose that the identified robot cannot take.
    """
    poses = batch(poses, [axis.name for axis in nominal.mechanism.task], "poses")
    models = identified.kinematics.controlled, nominal.kinematics.controlled
    correction = TargetCorrection(*models, nominal.limits)
    correction.require_possible(poses, lambda row: f"row {row}")
    return correction.commanded(poses, correction.approach(poses)).values_or_raise()


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Planned shots, and what they will tell."""

    shots: tuple[PlannedShot, ...]
    precision: predicted_uncertainty.Forecast

    def __repr__(self) -> str:
        worst_mm = self.precision.position_std_mm.max()
        return f"<Plan: {len(self.shots)} shots, 1 σ of any position ≤ {worst_mm:.4f} mm>"

    def plot(self) -> "Figure":
        """Figure of the planned poses from above and from the side, mm."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(8.0, 4.0), layout="constrained")
        for place, (across, up) in enumerate((("x_mm", "y_mm"), ("x_mm", "z_mm")), start=1):
            axes = figure.add_subplot(1, 2, place, xlabel=across, ylabel=up, aspect="equal")
            for purpose in dict.fromkeys(shot.purpose for shot in self.shots):
                poses = [shot.pose for shot in self.shots if shot.purpose is purpose]
                values = ([getattr(pose, each) for pose in poses] for each in (across, up))
                axes.plot(*values, ".", label=purpose.value)
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
        return figure


def plan(
    robot: RobotFile,
    tracker_mm: Sequence[float],
    *,
    shots: int = 120,
    validation_pairs: int = 20,
    drift_shots: int | None = None,
    placement: Placement | str = Placement.BOUNDARY,
    model: Model | str = Model.STANDARD,
    free: Sequence[str] | str = (),
    fix: Sequence[str] | str = (),
    acceptance_deg: float = 25.0,
    uncertainty: TrackerUncertainty | None = None,
    seed: int = 1,
    restricted: RestrictedSpace = UNRESTRICTED,
) -> Plan:
    """Plan of identification shots, validation pairs and drift shots, and its predicted σ.

    `tracker_mm` is the tracker's place in the base frame; the reflector faces it, and is seen
    within `acceptance_deg`. Poses keep to the `restricted` space. Raises `PlanInvalid` and
    `OptionsInvalid`.
    """
    place = vector(batch(tracker_mm, AXES, "tracker_mm")[0])
    placement = checked(Placement, placement, "placement")
    model = checked(Model, model, "model")
    space, centre = robot.mechanism.parameters, robot.workspace_centre
    known = select_geometry(space, model, free, fix)
    x_mm, y_mm, z_mm = (np.array(place) - centre[:3]).tolist()
    view = View(place, (x_mm, y_mm, z_mm), float(np.radians(acceptance_deg)))
    evenly = model in MAY_HAVE_GEARS
    wanted = PlanRequest(shots, validation_pairs, drift_shots, pose_of(centre), restricted, evenly)
    instrument, rng = uncertainty or TrackerUncertainty(), np.random.default_rng(seed)
    if placement is Placement.OPTIMAL:
        request = OptimalRequest(plan=wanted, uncertainty=instrument, free=known)
        made, _ = make_optimal_plan(robot, view, request, rng)
    else:
        made = make_plan(robot, view, wanted, rng)
    setup = predicted_uncertainty.EstimationSetup(Estimator.POINTS, known, instrument)
    sample = predicted_uncertainty.judged_positions(robot, centre, restricted, known, made)
    forecast = predicted_uncertainty.plan_forecast(
        made, robot.kinematics, np.array(place), setup, sample
    )
    if shots % 2 or not forecast.predicted.full_rank:
        least = predicted_uncertainty.fewest_shots(robot, view, wanted, setup)
        raise PlanInvalid(
            f"shots is {shots}, must be even and {least} or more to determine {len(known)} "
            "parameters",
            remedy="ask for more shots, or hold parameters with fix",
        )
    return Plan(made, forecast)


def study(
    robot: RobotFile,
    shots: Sequence[PlannedShot],
    tracker_mm: Sequence[float],
    *,
    campaigns: int = 100,
    model: Model | str = Model.STANDARD,
    free: Sequence[str] | str = (),
    fix: Sequence[str] | str = (),
    uncertainty: TrackerUncertainty | None = None,
    noise: Noise | None = None,
    spread: tuple[float, float] = (1.0, 0.1),
    seed: int = 1,
) -> StudySummary:
    """Monte Carlo study of a plan: errors, stated σ and Cramér-Rao bounds of drawn campaigns.

    The free parameters of each true robot are drawn about the nominal ones with standard deviations
    `spread`, in mm and deg. `uncertainty` is what the instrument states of its points, `noise` what
    it really does, by default that. Raises `OptionsInvalid`, `WorkspaceTooSmall`, and
    `ShotsMissing` when fewer than two campaigns can be identified.
    """
    space = robot.mechanism.parameters
    known = studied_parameters(space, checked(Model, model, "model"), free, fix)
    setup = StudySetup(
        nominal=robot.kinematics,
        shots=planned_shots(identification_shots(shots)),
        free=known,
        instrument=uncertainty or TrackerUncertainty(),
        tracker_from_base=Transform(np.eye(3), -batch(tracker_mm, AXES, "tracker_mm")[0]),
        workspace=sample_workspace(robot),
        seed=seed,
        noise=noise,
    )
    places = space.places(known)
    std = np.where(space.is_angle[places], np.radians(spread[1]), spread[0])
    truths = np.tile(robot.kinematics.p, (campaigns, 1))
    truths[:, places] += std * np.random.default_rng(seed).standard_normal((campaigns, len(std)))
    return summarise(known, simulate_campaigns(setup, range(campaigns), truths))
