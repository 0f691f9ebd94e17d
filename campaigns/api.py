"""Python API: robots, shots, identification, plans and studies without a campaign's folder."""

# These functions join the same parts as the steps of a campaign do (campaigns/workflow), but take
# and return values: no folder, journal or device is needed. What a campaign takes from
# campaign.yaml is an argument here, with the default of a new campaign. Names and words of options
# are those of the command line. Lengths are mm and angles rad, but parameters by name are as in
# files: mm, deg and ppm.

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from campaigns.arrays import AXES, Array, batch
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.controllers.export import with_identified
from campaigns.design import pose_sampling
from campaigns.design.restricted_space import UNRESTRICTED, RestrictedSpace
from campaigns.errors import PlanInvalid
from campaigns.files.table import Column, decimals_by, html_table, words
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.identification.identify import identify as identify_shots
from campaigns.identification.objects import Object, linked
from campaigns.identification.observations import asked_shots, error_model
from campaigns.identification.observed import measured_of
from campaigns.identification.options import IdentificationOptions, ModelWord
from campaigns.identification.other_kinds import Measured
from campaigns.identification.result import IdentificationResult, StoredLayer
from campaigns.identification.without_points import identify_without_points
from campaigns.planning.forecast import Forecast, forecast, judged_both
from campaigns.planning.optimal_plan import OptimalRequest, make_optimal_plan
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import Placement, PlanRequest, View, make_plan, poses_of
from campaigns.robots import robot as robots
from campaigns.robots.robot import RobotFile, pose_of
from campaigns.settings.option import checked, options_of
from campaigns.shots import observations_csv, shots_csv
from campaigns.shots.shots import Shots, shots_of_rows
from campaigns.studies.study import SPREAD, Noise, StudySetup, planned_shots, simulate_campaigns
from campaigns.studies.summary import StudySummary, summarise
from drivers.values import vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def find_robot(name: str | Path) -> RobotFile:
    """Return a robot by its shipped name or from its file.

    Args:
        name: `par4-prototype`, `par4-table1`, `h4`, `i4r`, `i4l`, `delta`, `linear-delta`,
            `hexapod`, `hexaglide`, `five-bar`, or the path of a robot file or of a Delta printer's
            `printer.cfg`.

    Returns:
        The robot: `kinematics`, `parameters`, `limits`, `mechanism`, `workspace_centre`.

    Raises:
        ConfigInvalid: Neither a shipped robot nor a valid file.

    Example:
        >>> find_robot("delta").mechanism.name
        'delta'
    """
    return robots.find_robot(str(name)).robot


def read_shots(path: Path | str, robot: RobotFile) -> Shots:
    """Return the measured shots of a CSV file in the form of shots.csv.

    Args:
        path: The file; docs/reference/files.md#shotscsv describes its columns.
        robot: The nominal robot, whose joints the columns name.

    Returns:
        The shots, for `identify`.

    Raises:
        ShotsInvalid: A cell, column or row is wrong; the message names line and value.

    Example:
        >>> shots = read_shots("shots.csv", find_robot("par4-prototype"))
    """
    return shots_of_rows(shots_csv.read_shots(Path(path), robot.mechanism), robot.kinematics)


def read_observations(
    path: Path | str, robot: RobotFile, objects: Sequence[Object] | None = None
) -> tuple[Measured, ...]:
    """Return the observations of a CSV file in the form of observations.csv.

    Args:
        path: The file; docs/reference/files.md#observationscsv describes its columns.
        robot: The nominal robot, whose joints the columns name.
        objects: The objects that its rows name; None: any, of which nothing is known beforehand.

    Returns:
        The observations, for `identify`: one `Measured` a kind and object, and one more of those
        that are held out.

    Raises:
        ObservationsInvalid: A cell, column or row is wrong, a value or an object is missing; the
            message names line and value.
        OptionsInvalid: Objects contradict each other.

    Example:
        >>> robot = find_robot("linear-delta")
        >>> heights = read_observations("observations.csv", robot, [Object("bed")])
    """
    given = None if objects is None else linked(objects)
    rows = observations_csv.read_observations(Path(path), robot.mechanism, given)
    observations_csv.require_measured(rows, str(path))
    by_name = given or {row.object: Object(row.object) for row in rows}
    return measured_of(rows, tuple(by_name.values()))


def sample_workspace(robot: RobotFile, poses: int = 100, *, seed: int = 1) -> Array:
    """Return poses spread evenly over a robot's reach.

    Args:
        robot: The robot, with the limits of its joints.
        poses: Number of poses.
        seed: Seed of the random generator; the same seed draws the same poses.

    Returns:
        Poses (N, t) of the controlled point in the base frame, mm and rad; t is 4 with θ, else 3.

    Raises:
        WorkspaceTooSmall: Too few random points of the reach's box can be reached.

    Example:
        >>> sample_workspace(find_robot("delta"), 50).shape
        (50, 3)
    """
    rng, centre = np.random.default_rng(seed), robot.workspace_centre
    return pose_sampling.workspace_poses(robot.kinematics, robot.limits, centre, poses, rng)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Identification(IdentificationResult):
    """Result of an identification with the robot that it is of."""

    nominal: RobotFile

    @property
    def robot(self) -> RobotFile:
        """Identified robot: its `kinematics`, its `parameters` with 1 σ, and `save(path)`.

        It may be saved if the nominal one may. Its provenance states model and verdict.
        """
        nominal = self.nominal
        origin = {"model": self.provenance.model, "verdict": self.judgement.verdict}
        if source := nominal.source:
            return with_identified(source, self.value, "identified", origin).robot
        parameters = self.value.parameter_set(nominal.mechanism)
        return replace(
            nominal,
            name=f"{nominal.name}-identified",
            mechanism=nominal.mechanism.with_ripples(parameters.rates),
            parameters=parameters,
            provenance=origin,
            document=None,
        )


def identify(
    shots: Shots | None,
    robot: RobotFile,
    *,
    observations: Sequence[Measured] = (),
    model: ModelWord | None = None,
    free: Sequence[str] | str = (),
    fix: Sequence[str] | str = (),
    priors: Sequence[str] | str | Mapping[str, float] = (),
    options: IdentificationOptions | Mapping[str, object] | None = None,
) -> Identification:
    """Identify a nominal robot's parameters from shots, as `pkmcal identify` does.

    Args:
        shots: Joints and measured points, from `read_shots` or `Shots.of`; None: no tracker
            measured this robot.
        robot: The nominal robot.
        observations: Heights, distances, reflectors elsewhere on the platform and poses of a
            probe (`Measured`), beside shots or without any.
        model: `"paper"` for the paper's method; by default the model of all sources of error.
        free, fix: Names, patterns (`"arm*.x_mm"`) or groups of parameters that are identified
            beyond the usual ones, or held at their nominal values.
        priors: 1 σ by name or pattern, in mm, deg and ppm: `{"arm*.arm_mm": 0.05}`.
        options: Further options of `pkmcal identify` by name, with `_` for `-`, as words or
            values: `{"hold_out": "20%"}`, or as an `IdentificationOptions`. The arguments above
            take precedence. Tolerances and workspace that they leave out are the robot's.

    Returns:
        Value, uncertainty, judgement, residuals and provenance (docs/reference/python.md);
        `report()` is a text of all of it, `to_frame()` a table, `plot()` a figure, `robot` the
        identified robot.

    Raises:
        OptionsInvalid: An unknown name or value of an option.
        ShotsMissing: Too few shots for what is asked.
        ShotsInvalid: The shots cannot be this robot's: units, signs or order of joints.

    Example:
        >>> robot = find_robot("par4-prototype")
        >>> result = identify(read_shots("shots.csv", robot), robot)
        >>> print(result.report())
    """
    # The arguments become words, are joined with the other options, and all are read by the reader
    # of the command line: so a word means in Python what it means there. What options leave out,
    # words and objects alike, is completed by the robot's tolerances and a sample of its workspace,
    # which a campaign would add.
    if isinstance(priors, Mapping):
        priors = [f"{pattern}={std}" for pattern, std in priors.items()]
    if isinstance(options, IdentificationOptions):
        options = {each.name: getattr(options, each.name) for each in fields(options)}
    words = dict(options or {})
    words["tolerances"] = words.get("tolerances") or robot.tolerances
    words["tolerance"] = robot.tolerance
    if words.get("workspace") is None:
        reach = robot.kinematics, robot.limits, robot.workspace_centre
        words["workspace"] = pose_sampling.sample_workspace(*reach)
    arguments = {"free": free, "fix": fix, "prior": priors, "model": model}
    words |= {name: value for name, value in arguments.items() if value}
    wanted = options_of(IdentificationOptions, words)
    if shots is None:
        result = identify_without_points(robot.kinematics, observations, wanted)
    else:
        asked = asked_shots(shots, robot.mechanism.joints, wanted)
        result = identify_shots(robot.kinematics, asked, wanted, measured=observations)
    parts = {part.name: getattr(result, part.name) for part in fields(result)}
    return Identification(nominal=robot, **parts)


def correct_targets(
    poses: ArrayLike, identified: RobotFile, nominal: RobotFile, layers: Sequence[StoredLayer] = ()
) -> Array:
    """Return the poses to command to a controller that keeps the nominal parameters.

    Args:
        poses: Wanted poses (N, t) of the controlled point, mm and rad.
        identified: The robot as it was identified.
        nominal: The robot with the parameters of its controller.
        layers: Errors that no parameter describes, `result.value.layers` of the identification.

    Returns:
        Poses (N, t) at which the controller makes the joints that the wanted ones need.

    Raises:
        TargetsInvalid: The identified robot cannot take a pose; the message names its row.

    Example:
        >>> identified = find_robot("cell-7/robot-compensated.yaml")
        >>> correct_targets([[50.0, 0.0, -700.0]], identified, find_robot("delta"))
    """
    poses = batch(poses, [axis.name for axis in nominal.mechanism.task], "poses")
    models = identified.kinematics.controlled, nominal.kinematics.controlled
    correction = TargetCorrection(*models, nominal.limits, layers=tuple(layers))
    correction.require_possible(poses, lambda row: f"row {row}")
    return correction.commanded(poses, correction.approach(poses)).values_or_raise()


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Planned shots, and the predicted uncertainty.

    Attributes:
        shots: The shots in measuring order, each with its pose, joints and purpose.
        precision: Predicted 1 σ: `std` of each parameter by name, mm, deg or ppm, and
            `position_std_mm` (N,) of positions over the workspace.
    """

    shots: tuple[PlannedShot, ...]
    precision: Forecast

    def __repr__(self) -> str:
        worst_mm = self.precision.position_std_mm.max()
        return f"<Plan: {len(self.shots)} shots, 1 σ of any position ≤ {worst_mm:.4f} mm>"

    def _repr_html_(self) -> str:
        """Return the predicted σ of each parameter as a table for notebooks."""
        precision = self.precision
        columns: tuple[Column[tuple[str, float]], ...] = (
            words("parameter", lambda row: row[0]),
            Column("predicted σ", lambda row: row[1], decimals=lambda row: decimals_by(row[1])),
            words("unit", lambda row: precision.units[row[0]]),
        )
        return html_table(repr(self).strip("<>"), columns, precision.std.items())

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
    """Plan identification shots, validation pairs and drift shots, and predict their σ.

    Args:
        robot: The nominal robot.
        tracker_mm: The tracker's place in the base frame, mm; the reflector faces it.
        shots: Identification shots, an even number.
        validation_pairs: Number of pairs that the fit never uses.
        drift_shots: Number of visits of the drift pose; by default one in 20 shots.
        placement: `"boundary"`, the paper's, or `"optimal"`.
        fix: Names, patterns or groups of parameters held at their nominal values.
        acceptance_deg: Largest angle between the beam and the reflector's direction.
        uncertainty: The tracker's standard uncertainty; by default that of a common tracker.
        seed: Seed of the random generator.
        restricted: Space in which the robot may move; by default it is not restricted.

    Returns:
        The shots in measuring order, and the predicted σ of parameters and positions.

    Raises:
        PlanInvalid: There is no such plan: too few shots, or an odd number.
        OptionsInvalid: An unknown name or value of an option.
        WorkspaceTooSmall: Too few poses can be reached and seen by the tracker.

    Example:
        >>> made = plan(find_robot("delta"), (2400.0, -300.0, -600.0), shots=60, seed=3)
        >>> made.precision.position_std_mm.max() < 0.2
        True
    """
    place = vector(batch(tracker_mm, AXES, "tracker_mm")[0])
    placement = checked(Placement, placement, "placement")
    if shots % 2:
        raise PlanInvalid(f"shots is {shots}, must be even", remedy="ask for one more")
    instrument, rng = uncertainty or TrackerUncertainty(), np.random.default_rng(seed)
    fit_options = options_of(
        IdentificationOptions,
        {"fix": fix, "instrument": instrument, "tolerances": robot.tolerances},
    )
    model, centre = error_model(robot.kinematics, None, fit_options), robot.workspace_centre
    x_mm, y_mm, z_mm = (np.array(place) - centre[:3]).tolist()
    view = View(place, (x_mm, y_mm, z_mm), float(np.radians(acceptance_deg)))
    wanted = PlanRequest(shots, validation_pairs, drift_shots, pose_of(centre), restricted)
    if placement is Placement.OPTIMAL:
        request = OptimalRequest(plan=wanted, model=model, uncertainty=instrument)
        planned = make_optimal_plan(robot, view, request, rng)
    else:
        planned = make_plan(robot, view, wanted, rng)
    planner = RobotModel(robot.kinematics, robot.limits, centre, restricted)
    judged, turns = judged_both(model, planner, poses_of(planned))
    return Plan(planned, forecast(planned, model, np.array(place), instrument, judged, turns))


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
    """Simulate campaigns of a plan and compare their errors with the stated σ.

    The geometry of each true robot is drawn about the nominal one with standard deviations
    `spread`, its other sources of error with their tolerances.

    Args:
        robot: The nominal robot.
        shots: The plan's shots, `plan(…).shots`.
        tracker_mm: The tracker's place in the base frame, mm.
        campaigns: Number of campaigns.
        fix: Names, patterns or groups of parameters held at their nominal values.
        uncertainty: Standard uncertainty that the instrument states for its points.
        noise: Errors that the instrument really makes: a function of points (N, 3) in its frame,
            mm, and a random generator, that returns errors (N, 3); by default as stated.
        spread: Standard deviations of lengths and places, mm, and of angles, deg.
        seed: Seed of the first campaign.

    Returns:
        For each parameter bias, empirical and stated σ, their ratio, and the coverage of 95 %.

    Raises:
        ShotsMissing: Fewer than two campaigns could be identified.
        OptionsInvalid, PlanInvalid, WorkspaceTooSmall: As of `plan` and `sample_workspace`.

    Example:
        >>> summary = study(robot, made.shots, (2400.0, -300.0, -600.0), campaigns=10)
        >>> [(row.name, row.ratio, row.covered) for row in summary.parameters]
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
    return summarise(setup.model.parameters, simulate_campaigns(setup, range(campaigns)))
