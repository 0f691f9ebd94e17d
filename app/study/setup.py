"""From a campaign's plan and a scenario to the tasks of a study."""

import math
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from app.errors import UsageInvalid
from app.folder import SCENARIO, Campaign
from campaigns.numerics.frames import Transform
from campaigns.numerics.geometry import Geometry
from campaigns.numerics.instrument import TrackerUncertainty
from campaigns.plan_file import PlannedShot, read_plan
from campaigns.planning import joints_of, numeric_geometry, pairs_of
from campaigns.shot_sets import ShotSet
from campaigns.study import Estimator, PairedShots, StudySetup, StudyTask
from sim.building import station_of, true_geometry
from sim.scenario import load_scenario
from sim.scenario_schema import Scenario
from sim.scenario_tracker import NoiseSection

CAMPAIGNS_A_TASK = 25
"""A tenth of a second's work: long against sending it, short against all of it."""
MM_PER_UM = 1e-3
PER_MM_OF_UM_PER_M = 1e-6
MPE_PER_SIGMA = math.sqrt(3.0)


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


def study_setup(
    campaign: Campaign,
    scenario: Scenario,
    estimator: Estimator,
    free: tuple[str, ...],
    seed: int,
) -> StudySetup:
    """What all campaigns share; raises `PlanInvalid`, and `UsageInvalid` for too few pairs."""
    shots = read_plan(campaign.plan_path)
    fitted = _paired(shots, ShotSet.IDENTIFICATION)
    if len(fitted.pairs) <= len(free):
        raise UsageInvalid(
            f"the plan has {len(fitted.pairs)} pairs for {len(free)} parameters: "
            "nothing would be left to state a standard deviation by",
            remedy=f"plan at least {2 * len(free) + 2} shots, or hold parameters with --fix",
        )
    station = station_of(scenario.tracker.station)
    tracker_from_base = Transform(station.base_from_tracker, station.origin_in_base_mm).inverted()
    return StudySetup(
        numeric_geometry(campaign.nominal.robot),
        free,
        estimator,
        fitted,
        _paired(shots, ShotSet.VALIDATION),
        tracker_from_base,
        uncertainty_of(scenario.tracker.noise),
        seed,
    )


def robots_drawn(scenario: Scenario) -> str:
    """What decides the true robots, as text."""
    return scenario.robot.model_dump_json()


def study_tasks(
    setup: StudySetup, scenario: Scenario, numbers: Iterable[int]
) -> Iterator[StudyTask]:
    """The campaigns of these numbers, some at a time, each with a robot of its own."""
    left = iter(numbers)
    while some := tuple(islice(left, CAMPAIGNS_A_TASK)):
        truths = [_truth(scenario, setup.seed, number) for number in some]
        yield StudyTask(setup, some, np.array(truths))


def uncertainty_of(noise: NoiseSection) -> TrackerUncertainty:
    """The simulated tracker's, across the beam the larger of azimuth's and elevation's."""
    if noise.along is None or noise.azimuth is None or noise.elevation is None:
        coordinate_mm = noise.coordinate_mm or 0.0
        return TrackerUncertainty(coordinate_mm, 0.0, coordinate_mm, 0.0)
    across = (noise.azimuth, noise.elevation)
    constant_um = max(limit.constant_um for limit in across)
    per_metre_um = max(limit.per_metre_um for limit in across)
    return TrackerUncertainty(
        noise.along.constant_um * MM_PER_UM / MPE_PER_SIGMA,
        noise.along.per_metre_um * PER_MM_OF_UM_PER_M / MPE_PER_SIGMA,
        constant_um * MM_PER_UM / MPE_PER_SIGMA,
        per_metre_um * PER_MM_OF_UM_PER_M / MPE_PER_SIGMA,
    )


def _truth(
    scenario: Scenario, seed: int, number: int
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """A robot's true parameters, (29,), mm and rad."""
    own_seed = int(np.random.SeedSequence([seed, number]).generate_state(1, np.uint64)[0])
    return Geometry.from_flat(true_geometry(scenario.robot, own_seed)).vector()


def _paired(shots: tuple[PlannedShot, ...], purpose: ShotSet) -> PairedShots:
    chosen = [shot for shot in shots if shot.purpose is purpose]
    return PairedShots(joints_of(chosen).reshape(-1, 4), pairs_of(chosen, purpose))
