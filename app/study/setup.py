"""From a campaign's plan and a scenario to what a study's campaigns share, and to its tasks."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from app.exits import UsageInvalid
from app.folder import SCENARIO, Campaign
from campaigns.errors import PlanInvalid
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import Geometry
from campaigns.planning.plan_file import PlannedShot, read_plan
from campaigns.planning.plans import joints_of, pairs_of
from campaigns.robots.robot import numeric_geometry
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.study import PairedShots, StudySetup, StudyTask, indistinguishable
from sim.building import station_of, true_geometry
from sim.scenarios.scenario import load_scenario
from sim.scenarios.schema import Scenario
from sim.scenarios.tracker import NoiseSection

HOLD_THE_FRAME = ("arm0.x_mm", "arm0.y_mm", "arm0.z_mm", "arm0.azimuth_deg")
CAMPAIGNS_A_TASK = 25
"""A tenth of a second's work: long against sending it, short against all of it."""


def study_scenario(campaign: Campaign, name: str | None) -> Scenario:
    """The scenario asked for, or the campaign's own; raises `UsageInvalid`, `ScenarioInvalid`."""
    if name is not None:
        return load_scenario(name)
    own: Path = campaign.path(SCENARIO)
    if own.exists():
        return load_scenario(str(own))
    raise UsageInvalid(
        "this campaign is for real devices: nothing says what robots to simulate",
        remedy="name a scenario, such as --scenario paper-simulation",
    )


@dataclass(frozen=True, slots=True)
class StudyOptions:
    """What is compared, and what all combinations share.

    Without plans, scenarios or estimators: the campaign's own plan and cell, and points.
    """

    plans: Sequence[Path]
    scenarios: Sequence[str]
    estimators: Sequence[Estimator]
    free: tuple[str, ...]
    seed: int


def study_setup(
    campaign: Campaign, plan: Path, scenario: Scenario, estimator: Estimator, asked: StudyOptions
) -> StudySetup:
    """What all campaigns of a combination share.

    The unseen pairs are those of the campaign's own plan, so that plans are judged by the same.
    Raises `PlanInvalid`, and `UsageInvalid` for shots that cannot give the free parameters.
    """
    shots, own_shots = read_plan(plan), read_plan(campaign.plan_path)
    nominal = numeric_geometry(campaign.nominal.robot)
    station = station_of(scenario.tracker.station)
    base_from_tracker = Transform(station.base_from_tracker, station.origin_in_base_mm)
    setup = StudySetup(
        nominal,
        asked.free,
        estimator,
        _paired(plan, nominal, shots, ShotSet.IDENTIFICATION),
        _paired(campaign.plan_path, nominal, own_shots, ShotSet.VALIDATION),
        base_from_tracker.inverted(),
        _noise_of(scenario),
        asked.seed,
    )
    _check_enough(setup, plan)
    return setup


def robots_drawn(scenario: Scenario) -> str:
    """What decides the true robots, as text."""
    return scenario.robot.model_dump_json()


def left_out(scenario: Scenario) -> tuple[str, ...]:
    """What the scenario has and a study has not: whatever no parameter of the model describes."""
    robot = scenario.robot
    effects = {
        "rods of unequal length": (robot.tolerances.rod_mm, *robot.rod_errors_mm),
        "tilted axes": (robot.tolerances.axis_tilt_mrad, *robot.axis_tilts_mrad),
        "backlash": robot.backlash_arcmin,
        "repeatability": (robot.repeatability.joint_arcsec, robot.repeatability.position_mm),
        "warm arms": (robot.thermal.rise_degC,),
        "faults": scenario.faults,
    }
    return tuple(name for name, sizes in effects.items() if any(sizes))


def study_tasks(
    setup: StudySetup, scenario: Scenario, numbers: Iterable[int]
) -> Iterator[StudyTask]:
    """The campaigns of these numbers, some at a time, each with a robot of its own."""
    left = iter(numbers)
    while some := tuple(islice(left, CAMPAIGNS_A_TASK)):
        robots = (_drawn(scenario, setup.seed, number) for number in some)
        truths = [in_frame_of(setup.nominal, robot).vector() for robot in robots]
        yield StudyTask(setup, some, np.array(truths))


def in_frame_of(nominal: Geometry, robot: Geometry) -> Geometry:
    """The same robot seen from a base whose first motor is where, and turned as, in the nominal.

    No shot tells where the base is, so identification puts it there by holding those parameters.
    """
    turn_rad = float(nominal.azimuth_rad[0] - robot.azimuth_rad[0])
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turned_from_base = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    from_first_mm = (robot.motor_mm - robot.motor_mm[0]) @ turned_from_base.T
    return replace(
        robot,
        motor_mm=nominal.motor_mm[0] + from_first_mm,
        azimuth_rad=robot.azimuth_rad + turn_rad,
    )


def uncertainty_of(noise: NoiseSection) -> TrackerUncertainty:
    """The simulated tracker's, as its data sheet would have it."""
    return TrackerUncertainty.of_limits(*noise.data_sheet)


def _noise_of(scenario: Scenario) -> TrackerUncertainty:
    """Raises `UsageInvalid` when there is none."""
    noise = uncertainty_of(scenario.tracker.noise)
    if min(noise.along_mm + noise.along_per_mm, noise.across_mm + noise.across_per_mm) <= 0.0:
        raise UsageInvalid(
            f"scenario {scenario.name}: its tracker has no noise, so every σ would be 0",
            remedy="give tracker.noise in the cell file values above 0",
        )
    return noise


def _drawn(scenario: Scenario, seed: int, number: int) -> Geometry:
    """The robot of one campaign, as the simulated cell would draw it."""
    own_seed = int(np.random.SeedSequence([seed, number]).generate_state(1, np.uint64)[0])
    return Geometry.from_flat(true_geometry(scenario.robot, own_seed))


def _paired(
    plan: Path, nominal: Geometry, shots: tuple[PlannedShot, ...], purpose: ShotSet
) -> PairedShots:
    """The shots of a set; raises `PlanInvalid` for one that the nominal robot cannot take."""
    chosen = [shot for shot in shots if shot.purpose is purpose]
    joints_rad = joints_of(chosen).reshape(-1, 4)
    for shot, found in zip(chosen, forward(nominal, joints_rad).found, strict=True):
        if not found:
            raise PlanInvalid(
                f"{plan}: shot {shot.shot}: the nominal robot cannot be assembled at its joints",
                remedy="correct the shot, or plan anew with `pkmcal plan`",
            )
    return PairedShots(joints_rad, pairs_of(chosen, purpose))


def _check_enough(setup: StudySetup, plan: Path) -> None:
    """Raise `UsageInvalid` when the shots cannot give the parameters and something to spare."""
    sought = f"{len(setup.free)} parameters by {setup.estimator.value}"
    if setup.dof < 1:
        shots, pairs = len(setup.fitted.joints_rad), len(setup.fitted.pairs)
        raise UsageInvalid(
            f"{plan}: {shots} shots in {pairs} pairs are too few for {sought}",
            remedy="plan more shots, or hold parameters with --fix",
        )
    if together := indistinguishable(setup):
        raise UsageInvalid(
            f"{plan}: {sought} cannot be told apart: {', '.join(together[0])} move together",
            remedy=f"hold one of them, as with --fix {together[0][0]}, or plan other shots",
        )
    if shifted := [name for name in setup.free if name in HOLD_THE_FRAME]:
        raise UsageInvalid(
            f"{', '.join(shifted)} cannot be free in a study: true robots are told in the frame "
            "that the first motor holds",
            remedy="leave it out of --free; what another motor holds is told as well by this one",
        )
