"""What a study simulates: its options, plan, robots and noise."""

import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from app.new_campaign import SCENARIO, cell_text
from app.study.rods import told_by, vector_of_parts
from app.wiring import require_same_mechanism
from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.estimation.datum import DatumSample, datum_parameters
from campaigns.estimation.estimators import Model
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.identification.options import Fixed, Freed
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.plan_file import PlannedShot, read_plan
from campaigns.planning.plans import joints_of
from campaigns.settings.option import Option
from campaigns.studies import study
from campaigns.version import VERSION
from sim.factory import build_of, true_geometry
from sim.geometry import geometry_of
from sim.scenarios.scenario import load_scenario, parse_scenario
from sim.scenarios.schema import Scenario
from sim.tracker.optics import Noise

MOST_CAMPAIGNS = 100_000
TABLE_SCHEMA = "pkmcal/study-table/2"
UNFIT_FOR_FILES = re.compile(r"[^\w.-]+")


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyOptions:
    """What is simulated and identified."""

    campaigns: Annotated[
        int,
        Option(
            "Campaigns in all, those already there included.",
            metavar="N",
            least=2,
            most=MOST_CAMPAIGNS,
        ),
    ]
    plan: Annotated[Path | None, Option("A plan, if not the plan.csv in DIR.", metavar="FILE")] = (
        None
    )
    scenario: Annotated[
        str | None,
        Option("What robots and noise to draw, if not by the campaign's own cell.", metavar="NAME"),
    ] = None
    model: Annotated[Model, Option("What the fits find.")] = Model.STANDARD
    free: Freed = ()
    fix: Fixed = ()
    seed: Annotated[int, Option("Seed of all that is drawn.", metavar="N", least=0)] = 1
    workers: Annotated[
        int | None, Option("Local processes.", metavar="N", least=1, default="one a processor")
    ] = None
    to: Annotated[Path | None, Option("Where tables go, if not DIR/study.", metavar="FOLDER")] = (
        None
    )


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Plan, scenario and model of a study, and what its campaigns share."""

    plan: str
    scenario: Scenario
    model: Model
    setup: study.StudySetup

    @property
    def words(self) -> dict[str, str]:
        """What distinguishes it from others, by the names of documents."""
        return {"plan": self.plan, "scenario": self.scenario.name, "model": self.model.value}

    @property
    def file_name(self) -> str:
        """Name of its files without their endings; of the usual model nothing."""
        words = [self.plan, self.scenario.name]
        words += [self.model.value] * (self.model is not Model.STANDARD)
        return UNFIT_FOR_FILES.sub("_", "-".join(words))

    def table_head(self) -> dict[str, object]:
        """First line of its table, with twelve characters that differ between studies."""
        setup, robot = self.setup, self.scenario.robot.model_dump_json()
        words = (VERSION, robot, setup.nominal.mechanism.name, setup.free, setup.seed)
        hashed = hashlib.sha256(repr((*words, setup.instrument)).encode())
        frame = setup.tracker_from_base
        arrays = (frame.rotation, frame.translation_mm, setup.shots.joints, setup.workspace)
        for array in (setup.nominal.p, *arrays):
            hashed.update(np.ascontiguousarray(array).tobytes())
        digest = hashed.hexdigest()[:12]
        return {"schema": TABLE_SCHEMA, "parameters": list(setup.free), "study": digest}

    def simulate(self, numbers: Sequence[int]) -> tuple[study.CampaignRow, ...]:
        """Draw, measure and identify the campaigns of these numbers."""
        sample = DatumSample(self.setup.nominal)
        robots = (drawn_robot(self.setup, self.scenario, number) for number in numbers)
        truths = [datum_parameters(self.setup.nominal, robot, sample).p for robot in robots]
        return tuple(study.simulate_campaigns(self.setup, numbers, np.array(truths)))


def study_of(campaign: Campaign, asked: StudyOptions) -> Study:
    """Study of a campaign by these options.

    Raises `ConfigInvalid` for a robot that cannot be simulated, `PlanInvalid`, `ScenarioInvalid`,
    and `OptionsInvalid` for shots that cannot give the free parameters.
    """
    plan, scenario = asked.plan or campaign.plan_path, study_scenario(campaign, asked.scenario)
    require_same_mechanism(campaign, scenario)
    robot = campaign.robot
    shots = study.identification_shots(read_plan(plan, robot.mechanism))
    _check_assembled(plan, robot.kinematics, shots)
    station = scenario.tracker.station.pose()
    base_from_tracker = Transform(station.base_from_tracker, station.origin_in_base_mm)
    setup = study.StudySetup(
        nominal=robot.kinematics,
        shots=study.planned_shots(shots),
        free=study.studied_parameters(
            robot.mechanism.parameters, asked.model, asked.free, asked.fix
        ),
        instrument=_noise_of(scenario),
        tracker_from_base=base_from_tracker.inverted(),
        workspace=_workspace_of(campaign),
        seed=asked.seed,
    )
    _check_enough(setup, plan)
    return Study(plan.stem, scenario, asked.model, setup)


def study_scenario(campaign: Campaign, name: str | None) -> Scenario:
    """The scenario asked for, or the campaign's own; raises `OptionsInvalid`, `ScenarioInvalid`."""
    if name is not None:
        return parse_scenario(cell_text(campaign.robot, name), name)
    own: Path = campaign.path(SCENARIO)
    if own.exists():
        return load_scenario(str(own))
    raise OptionsInvalid(
        "this campaign is for real devices: nothing says what robots to simulate",
        remedy="name a scenario, such as --scenario paper-simulation",
    )


def left_out(scenario: Scenario, model: Model) -> tuple[str, ...]:
    """What the scenario has and a study has not: whatever no parameter of the model describes."""
    robot = scenario.robot
    gears = robot.transmission
    rods = (robot.tolerances.rod_mm, *robot.rod_errors_mm)
    tilts = (robot.tolerances.axis_tilt_mrad, *robot.axis_tilts_mrad)
    effects = {
        "rods of unequal length": () if model in {Model.RODS, Model.FULL} else rods,
        "tilted axes": () if model is Model.FULL else tilts,
        "backlash": robot.backlash_arcmin,
        "repeatability": (robot.repeatability.joint_arcsec, robot.repeatability.position_mm),
        "errors of encoders and gears": (
            gears.eccentricity_um,
            gears.ripple_arcsec,
            gears.ripple_mm,
        ),
        "ratios of gears": (gears.ratio_ppm,),
        "gears that yield": (robot.weight.gear_nm_per_arcmin, robot.weight.drive_n_per_um),
        "warm parts": [part.rise_degC for part in robot.thermal.parts.values()],
        "faults": scenario.faults,
    }
    return tuple(name for name, sizes in effects.items() if any(sizes))


def uncertainty_of(noise: Noise) -> TrackerUncertainty:
    """The simulated tracker's, as its data sheet would have it."""
    return TrackerUncertainty.of_limits(**noise.data_sheet)


def drawn_robot(setup: study.StudySetup, scenario: Scenario, number: int) -> Kinematics:
    """Draw the robot of one campaign, as the simulated cell would.

    With its unequal rods and tilted axes as far as free parameters describe them.
    """
    own_seed = int(np.random.SeedSequence([setup.seed, number]).generate_state(1, np.uint64)[0])
    section, mechanism = scenario.robot, setup.nominal.mechanism
    flat = true_geometry(section, own_seed)
    level = Kinematics.of(mechanism, flat)
    if not {*setup.free} & {*mechanism.parameters.extensions}:
        return level
    geometry = geometry_of(flat, section.kind)
    build = told_by(build_of(section, geometry, own_seed), mechanism.parameters, setup.free)
    return Kinematics(mechanism, vector_of_parts(level, geometry, build))


def _noise_of(scenario: Scenario) -> TrackerUncertainty:
    """Raises `OptionsInvalid` when there is none."""
    noise = uncertainty_of(scenario.tracker.noise)
    if min(noise.along_mm + noise.along_per_mm, noise.across_mm + noise.across_per_mm) <= 0.0:
        raise OptionsInvalid(
            f"scenario {scenario.name}: its tracker has no noise, so every σ would be 0",
            remedy="give tracker.noise in the cell file values above 0",
        )
    return noise


def _workspace_of(campaign: Campaign) -> Array:
    workspace = campaign.workspace_sample()
    if workspace is None:
        raise OptionsInvalid(
            f"{campaign.folder}: the robot can take hardly any pose at which positions are judged",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        )
    return workspace


def _check_assembled(plan: Path, nominal: Kinematics, shots: Sequence[PlannedShot]) -> None:
    """Raise `PlanInvalid` for a shot that the nominal robot cannot take."""
    if not shots:
        return
    found = nominal.forward(joints_of(shots)).found
    for shot, is_found in zip(shots, found, strict=True):
        if not is_found:
            raise PlanInvalid(
                f"{plan}: shot {shot.shot}: the nominal robot cannot be assembled at its joints",
                remedy="correct the shot, or make a new plan with `pkmcal plan`",
            )


def _check_enough(setup: study.StudySetup, plan: Path) -> None:
    """Raise `OptionsInvalid` when the shots cannot give the parameters and something to spare."""
    if setup.dof < 1:
        raise OptionsInvalid(
            f"{plan}: {len(setup.shots)} shots are too few for {len(setup.free)} parameters",
            remedy="plan more shots, or fix parameters with --fix",
        )
    if together := study.indistinguishable(setup):
        raise OptionsInvalid(
            f"{plan}: {', '.join(together[0])} cannot be distinguished: they move together",
            remedy=f"fix one of them, as with --fix {together[0][0]}, or plan other shots",
        )
    held = setup.nominal.mechanism.parameters.datum
    if shifted := [name for name in setup.free if name in held]:
        raise OptionsInvalid(
            f"{', '.join(shifted)} cannot be free in a study: true robots are told in the frame "
            "that the first motor holds",
            remedy="leave it out of --free; what another motor holds is told as well by this one",
        )
