"""Setup of a study: its options, plan, robots and noise, from a campaign's files.

The plan gives joints and sides of approach, the campaign's robot file geometry and tolerances, the
scenario the tracker's place and its noise. Together they are a `StudySetup`, which every worker
gets; the table's first line holds a digest of it, so that a table is only continued by the study
that began it.
"""

import hashlib
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from app.new_campaign import SCENARIO, cell_text
from app.wiring import require_same_mechanism
from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.fit.rigid_transforms import Transform
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.identification.options import Fixed, IdentificationOptions
from campaigns.kinematics.model import Kinematics
from campaigns.planning.plan_file import PlannedShot, read_plan
from campaigns.planning.plans import joints_of
from campaigns.settings.option import Option
from campaigns.studies import study
from campaigns.version import VERSION
from campaigns.workflow.identification import identification_options
from sim.scenarios.scenario import load_scenario, parse_scenario
from sim.scenarios.schema import Scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyOptions:
    """Options of a study."""

    campaigns: Annotated[
        int,
        Option(
            "Number of campaigns, including those of earlier calls.",
            metavar="N",
            least=2,
            most=100_000,
        ),
    ]
    plan: Annotated[
        Path | None, Option("Plan to simulate. Default: plan.csv in DIR.", metavar="FILE")
    ] = None
    scenario: Annotated[
        str | None,
        Option(
            "Scenario whose tracker and noise are simulated. Default: the campaign's own cell.",
            metavar="NAME",
        ),
    ] = None
    fix: Fixed = ()
    seed: Annotated[int, Option("Seed of all that is drawn.", metavar="N", least=0)] = 1
    workers: Annotated[
        int | None, Option("Number of local processes.", "N", least=1, default="one per processor")
    ] = None
    scheduler: Annotated[
        str | None,
        Option("Dask scheduler, whose workers compute instead of this computer.", metavar="URL"),
    ] = None
    to: Annotated[
        Path | None, Option("Folder for the tables. Default: DIR/study.", metavar="FOLDER")
    ] = None


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Plan and scenario of a study, and what its campaigns share."""

    plan: str
    scenario: Scenario
    setup: study.StudySetup

    @property
    def file_name(self) -> str:
        """Name of its files without their endings."""
        return re.sub(r"[^\w.-]+", "_", f"{self.plan}-{self.scenario.name}")

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the robot's parameters that every campaign identifies."""
        return self.setup.model.parameters

    def table_head(self) -> dict[str, object]:
        """Return the first line of its table, with twelve characters that differ by study."""
        # Everything that changes a campaign's numbers goes into the digest, the version too: two
        # versions may fit differently. The number of campaigns does not, for a study may grow.
        setup, model = self.setup, self.setup.model
        words = (VERSION, setup.nominal.mechanism.name, model.names, setup.seed, setup.spread)
        hashed = hashlib.sha256(repr((*words, setup.options.instrument)).encode())
        frame = setup.tracker_from_base
        arrays = (frame.rotation, frame.translation_mm, setup.shots.joints, setup.workspace)
        for array in (setup.nominal.p, model.tolerance, *arrays):
            hashed.update(np.ascontiguousarray(array).tobytes())
        digest = hashed.hexdigest()[:12]
        return {
            "schema": "pkmcal/study-table/3",
            "parameters": list(model.parameters),
            "study": digest,
        }

    def simulate(self, numbers: Sequence[int]) -> Iterator[study.CampaignRow]:
        """Draw, measure and identify the campaigns of these numbers, one after the other."""
        return study.simulate_campaigns(self.setup, numbers)


def study_of(campaign: Campaign, asked: StudyOptions) -> Study:
    """Return the study of a campaign with these options.

    Raise `ConfigInvalid` for a robot that cannot be simulated, `PlanInvalid`, `ScenarioInvalid` and
    `OptionsInvalid`.
    """
    plan, scenario = asked.plan or campaign.plan_path, study_scenario(campaign, asked.scenario)
    require_same_mechanism(campaign, scenario)
    robot = campaign.robot
    shots = read_plan(plan, robot.mechanism)
    _check_assembled(plan, robot.kinematics, shots)
    station = scenario.tracker.station.pose()
    base_from_tracker = Transform(station.base_from_tracker, station.origin_in_base_mm)
    options = identification_options(campaign, IdentificationOptions(fix=asked.fix))
    setup = study.StudySetup(
        nominal=robot.kinematics,
        shots=study.planned_shots(shots),
        options=replace(options, instrument=_noise_of(scenario, campaign)),
        tracker_from_base=base_from_tracker.inverted(),
        workspace=_workspace_of(campaign),
        seed=asked.seed,
    )
    return Study(plan.stem, scenario, setup)


def study_scenario(campaign: Campaign, name: str | None) -> Scenario:
    """Return the named scenario, or the campaign's own.

    Raise `OptionsInvalid` and `ScenarioInvalid`.
    """
    if name is not None:
        return parse_scenario(cell_text(campaign.robot, name), name)
    scenario_file: Path = campaign.path(SCENARIO)
    if scenario_file.exists():
        return load_scenario(str(scenario_file))
    raise OptionsInvalid(
        "this campaign is for real devices: nothing says what robots to simulate",
        remedy="name a scenario, such as --scenario paper-simulation",
    )


def _noise_of(scenario: Scenario, campaign: Campaign) -> TrackerUncertainty:
    """Return the simulated tracker's noise, with the common errors that the campaign expects.

    Raise `OptionsInvalid` for a tracker without noise.
    """
    # Scatter of each point as the scenario draws it; common errors (scale, axes, reflector) by the
    # campaign's data sheet, since the fit gets its priors from there.
    noise = TrackerUncertainty.of_limits(**scenario.tracker.noise.data_sheet)
    if min(noise.along_mm + noise.along_per_mm, noise.across_mm + noise.across_per_mm) <= 0.0:
        raise OptionsInvalid(
            f"scenario {scenario.name}: its tracker has no noise, so every σ would be 0",
            remedy="give tracker.noise in the cell file values above 0",
        )
    instrument = campaign.instrument
    return replace(
        noise,
        scale=instrument.scale,
        axes_per_mm=instrument.axes_per_mm,
        reflector_mm=instrument.reflector_mm,
    )


def _workspace_of(campaign: Campaign) -> Array:
    """Return the poses at which positions are judged; raise `OptionsInvalid` for too few."""
    workspace = campaign.workspace_sample()
    if workspace is None:
        raise OptionsInvalid(
            f"{campaign.folder}: the robot can take hardly any pose at which positions are judged",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        )
    return workspace


def _check_assembled(plan: Path, nominal: Kinematics, shots: Sequence[PlannedShot]) -> None:
    """Raise `PlanInvalid` for a shot that the nominal robot cannot take."""
    # Else each campaign would fail by itself, without the shot's number.
    if not shots:
        return
    can_assemble = nominal.forward(joints_of(shots)).is_solved
    for shot, is_found in zip(shots, can_assemble, strict=True):
        if not is_found:
            raise PlanInvalid(
                f"{plan}: shot {shot.shot}: the nominal robot cannot be assembled at its joints",
                remedy="correct the shot, or make a new plan with `pkmcal plan`",
            )
