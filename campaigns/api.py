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
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.identification.identify import identify as identify_shots
from campaigns.identification.observations import asked_shots, error_model
from campaigns.identification.options import IdentificationOptions, ModelWord
from campaigns.identification.result import IdentificationResult
from campaigns.planning.forecast import Forecast, forecast, judged_positions
from campaigns.planning.optimal_plan import OptimalRequest, make_optimal_plan
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import Placement, PlanRequest, View, make_plan, poses_of
from campaigns.robots import robot as robots
from campaigns.robots.robot import RobotFile, pose_of
from campaigns.settings.option import checked, options_of
from campaigns.shots import shots_csv
from campaigns.shots.shots import Shots, shots_of_rows
from campaigns.studies.study import SPREAD, Noise, StudySetup, planned_shots, simulate_campaigns
from campaigns.studies.summary import StudySummary, summarise
from drivers.values import vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def find_robot(name: str | Path) -> RobotFile:
    """Return the robot of a shipped name or of a file; raise `ConfigInvalid`."""
    return robots.find_robot(str(name)).robot


def read_shots(path: Path | str, robot: RobotFile) -> Shots:
    """Return the measured shots of a CSV file in the form of shots.csv; raise `ShotsInvalid`."""
    return shots_of_rows(shots_csv.read_shots(Path(path), robot.mechanism), robot.kinematics)


def sample_workspace(robot: RobotFile, poses: int = 100, *, seed: int = 1) -> Array:
    """Return poses (N, t) spread evenly over a robot's reach; raise `WorkspaceTooSmall`."""
    rng, centre = np.random.default_rng(seed), robot.workspace_centre
    return pose_sampling.workspace_poses(robot.kinematics, robot.limits, centre, poses, rng)


def identify(
    shots: Shots,
    robot: RobotFile,
    *,
    model: ModelWord | None = None,
    free: Sequence[str] | str = (),
    fix: Sequence[str] | str = (),
    priors: Sequence[str] | str | Mapping[str, float] = (),
    options: IdentificationOptions | Mapping[str, object] | None = None,
) -> IdentificationResult:
    """Identify a nominal robot's parameters from shots, as `pkmcal identify` does.

    `options` are those of `pkmcal identify` by name, with `_` for `-`, in its words or as values;
    the other arguments take precedence over them. Priors may also be σ by pattern, in mm, deg and
    ppm. Raise `OptionsInvalid`, `ShotsMissing` and `ShotsInvalid`.
    """
    if isinstance(priors, Mapping):
        priors = [f"{pattern}={std}" for pattern, std in priors.items()]
    if isinstance(options, IdentificationOptions):
        words = {each.name: getattr(options, each.name) for each in fields(options)}
    else:
        reach = robot.kinematics, robot.limits, robot.workspace_centre
        sample = pose_sampling.sample_workspace(*reach)
        words = {"tolerances": robot.tolerances, "workspace": sample} | dict(options or {})
    given = {"free": free, "fix": fix, "prior": priors, "model": model}
    wanted = options_of(IdentificationOptions, words | {k: v for k, v in given.items() if v})
    return identify_shots(robot.kinematics, asked_shots(shots, wanted), wanted)


def correct_targets(poses: ArrayLike, identified: RobotFile, nominal: RobotFile) -> Array:
    """Return the poses (N, t) to command to a controller with the nominal parameters.

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
    precision: Forecast

    def __repr__(self) -> str:
        worst_mm = self.precision.position_std_mm.max()
        return f"<Plan: {len(self.shots)} shots, 1 σ of any position ≤ {worst_mm:.4f} mm>"

    def plot(self) -> "Figure":
        """Return the figure of the planned poses from above and from the side, mm."""
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
    fix: Sequence[str] | str = (),
    acceptance_deg: float = 25.0,
    uncertainty: TrackerUncertainty | None = None,
    seed: int = 1,
    restricted: RestrictedSpace = UNRESTRICTED,
) -> Plan:
    """Plan identification shots, validation pairs and drift shots, with the predicted σ.

    `tracker_mm` is the tracker's place in the base frame; the reflector faces it, and is seen
    within `acceptance_deg`. Poses keep to the `restricted` space. Raise `PlanInvalid` and
    `OptionsInvalid`.
    """
    place = vector(batch(tracker_mm, AXES, "tracker_mm")[0])
    placement = checked(Placement, placement, "placement")
    if shots % 2:
        raise PlanInvalid(f"shots is {shots}, must be even", remedy="ask for one more")
    instrument, rng = uncertainty or TrackerUncertainty(), np.random.default_rng(seed)
    how = options_of(
        IdentificationOptions,
        {"fix": fix, "instrument": instrument, "tolerances": robot.tolerances},
    )
    model, centre = error_model(robot.kinematics, None, how), robot.workspace_centre
    x_mm, y_mm, z_mm = (np.array(place) - centre[:3]).tolist()
    view = View(place, (x_mm, y_mm, z_mm), float(np.radians(acceptance_deg)))
    wanted = PlanRequest(shots, validation_pairs, drift_shots, pose_of(centre), restricted)
    if placement is Placement.OPTIMAL:
        request = OptimalRequest(plan=wanted, model=model, uncertainty=instrument)
        made = make_optimal_plan(robot, view, request, rng)
    else:
        made = make_plan(robot, view, wanted, rng)
    planner = RobotModel(robot.kinematics, robot.limits, centre, restricted)
    judged = judged_positions(model, planner, poses_of(made))
    return Plan(made, forecast(made, model, np.array(place), instrument, judged))


def study(
    robot: RobotFile,
    shots: Sequence[PlannedShot],
    tracker_mm: Sequence[float],
    *,
    campaigns: int = 100,
    fix: Sequence[str] | str = (),
    uncertainty: TrackerUncertainty | None = None,
    noise: Noise | None = None,
    spread: tuple[float, float] = SPREAD,
    seed: int = 1,
) -> StudySummary:
    """Simulate campaigns of a plan and compare errors with the stated σ.

    The geometry of each true robot is drawn about the nominal one with standard deviations
    `spread`, in mm and deg, its other sources of error with their tolerances. `uncertainty` is what
    the instrument states of its points, `noise` what it really does, by default that. Raise
    `OptionsInvalid`, `WorkspaceTooSmall`, `PlanInvalid`, and `ShotsMissing` when fewer than two
    campaigns can be identified.
    """
    instrument = uncertainty or TrackerUncertainty()
    setup = StudySetup(
        nominal=robot.kinematics,
        shots=planned_shots(shots),
        options=options_of(
            IdentificationOptions,
            {"fix": fix, "instrument": instrument, "tolerances": robot.tolerances},
        ),
        tracker_from_base=Transform(np.eye(3), -batch(tracker_mm, AXES, "tracker_mm")[0]),
        workspace=sample_workspace(robot),
        seed=seed,
        spread=spread,
        noise=noise,
    )
    return summarise(setup.model().parameters, simulate_campaigns(setup, range(campaigns)))
