"""Python API: robots, shots, identification, plans and studies without a campaign's folder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.controllers.corrected_targets import TargetCorrection
from campaigns.design.restricted_space import UNRESTRICTED, RestrictedSpace
from campaigns.errors import TargetsInvalid
from campaigns.estimation.estimators import MAY_HAVE_GEARS, Estimator, Model
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.identification import model_selection
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.result import IdentificationResult
from campaigns.planning import predicted_uncertainty
from campaigns.planning.optimal_plan import OptimalRequest, make_optimal_plan
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import Placement, PlanRequest, View, make_plan
from campaigns.robots import robot as robots
from campaigns.robots.robot import RobotFile, pose_of
from campaigns.shots import shots_csv
from campaigns.shots.shots import Shots, shots_of_rows
from campaigns.studies.engine import run_task
from campaigns.studies.study import StudySetup, StudyTask, planned_shots
from campaigns.studies.summary import StudySummary, summarise
from drivers.values import Vector3


def find_robot(name: str | Path) -> RobotFile:
    """Robot of a shipped name or of a file; raises `ConfigInvalid`."""
    return robots.find_robot(str(name)).robot


def read_shots(path: Path | str, robot: RobotFile) -> Shots:
    """Measured shots of a CSV file in the form of shots.csv; raises `ShotsInvalid`."""
    return shots_of_rows(shots_csv.read_shots(Path(path), robot.mechanism), robot.kinematics)


def identify(
    shots: Shots,
    robot: RobotFile,
    *,
    free: Sequence[str] = (),
    fix: Sequence[str] = (),
    priors: Sequence[str] = (),
    model: Model = Model.STANDARD,
    options: IdentificationOptions | None = None,
) -> IdentificationResult:
    """Identification of a nominal robot's parameters from shots, as `pkmcal identify` does it.

    Patterns and priors are as on the command line. Raises `OptionsInvalid`, `ShotsMissing` and
    `ShotsInvalid`.
    """
    models = model_selection.candidate_models(robot.mechanism.parameters, model, free, fix, priors)
    terms = model_selection.terms_to_add(robot.mechanism.parameters, model, free, fix, priors)
    how = replace(options or IdentificationOptions(), free=tuple(free))
    return model_selection.select_model(
        robot.kinematics, shots, models, how, asked=model_selection.asked_of(model), terms=terms
    )


def correct_targets(poses: Array, identified: RobotFile, nominal: RobotFile) -> Array:
    """Poses (N, t) to command to a controller that holds the nominal parameters, for wanted ones.

    In mm and rad. Raises `TargetsInvalid` for a pose that the identified robot cannot take.
    """
    models = identified.kinematics.controlled, nominal.kinematics.controlled
    correction = TargetCorrection(*models, nominal.limits)
    fault = correction.first_fault(poses)
    if fault is not None:
        row, reason = fault
        raise TargetsInvalid(f"row {row}: {reason}", remedy="change the pose")
    return correction.commanded(poses, correction.approach(poses)).values_or_raise()


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Planned shots, and what they will tell."""

    shots: tuple[PlannedShot, ...]
    precision: predicted_uncertainty.Forecast


def plan(
    robot: RobotFile,
    tracker_mm: Vector3,
    *,
    shots: int = 120,
    validation_pairs: int = 20,
    drift_shots: int | None = None,
    placement: Placement = Placement.BOUNDARY,
    estimator: Estimator = Estimator.POINTS,
    model: Model = Model.STANDARD,
    free: Sequence[str] = (),
    fix: Sequence[str] = (),
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
    space, centre = robot.mechanism.parameters, robot.workspace_centre
    known = model_selection.select_geometry(space, model, free, fix)
    x_mm, y_mm, z_mm = (np.array(tracker_mm) - centre[:3]).tolist()
    view = View(tracker_mm, (x_mm, y_mm, z_mm), float(np.radians(acceptance_deg)))
    evenly = model in MAY_HAVE_GEARS
    wanted = PlanRequest(shots, validation_pairs, drift_shots, pose_of(centre), restricted, evenly)
    instrument, rng = uncertainty or TrackerUncertainty(), np.random.default_rng(seed)
    if placement is Placement.OPTIMAL:
        request = OptimalRequest(
            plan=wanted, uncertainty=instrument, free=known, estimator=estimator
        )
        made, _ = make_optimal_plan(robot, view, request, rng)
    else:
        made = make_plan(robot, view, wanted, rng)
    setup = predicted_uncertainty.EstimationSetup(estimator, known, instrument)
    sample = predicted_uncertainty.judged_positions(robot, centre, restricted, known, made)
    place = np.array(tracker_mm)
    return Plan(
        made, predicted_uncertainty.plan_forecast(made, robot.kinematics, place, setup, sample)
    )


def study(
    robot: RobotFile,
    shots: Sequence[PlannedShot],
    tracker_mm: Vector3,
    *,
    campaigns: int = 100,
    estimator: Estimator = Estimator.POINTS,
    model: Model = Model.STANDARD,
    free: Sequence[str] = (),
    fix: Sequence[str] = (),
    uncertainty: TrackerUncertainty | None = None,
    spread: tuple[float, float] = (1.0, 0.1),
    seed: int = 1,
) -> StudySummary:
    """Monte Carlo study of a plan: errors, stated σ and Cramér-Rao bounds of drawn campaigns.

    The free parameters of each true robot are drawn about the nominal ones with standard deviations
    `spread`, in mm and deg. Raises `OptionsInvalid`, and `ShotsMissing` when fewer than two
    campaigns can be identified.
    """
    space = robot.mechanism.parameters
    known = model_selection.select_geometry(space, model, free, fix)
    setup = StudySetup(
        nominal=robot.kinematics,
        shots=planned_shots(shots),
        free=known,
        options=IdentificationOptions(
            estimator=estimator, instrument=uncertainty or TrackerUncertainty()
        ),
        tracker_from_base=Transform(np.eye(3), -np.array(tracker_mm)),
        seed=seed,
    )
    places = space.places(known)
    std = np.where(space.is_angle[places], np.radians(spread[1]), spread[0])
    truths = np.tile(robot.kinematics.p, (campaigns, 1))
    truths[:, places] += std * np.random.default_rng(seed).standard_normal((campaigns, len(std)))
    return summarise(setup, run_task(StudyTask(setup, tuple(range(campaigns)), truths)))
