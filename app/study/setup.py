"""What a study compares: every perturbation, scenario, plan and method; the tasks of each."""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, product
from pathlib import Path
from typing import Annotated

import numpy as np

from app.new_campaign import SCENARIO, cell_text
from app.study.results import Portion
from app.study.rods import misread, rod_robot, told_by, vector_of_parts
from app.wiring import require_same_mechanism
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.estimation.datum import DatumSample, datum_parameters
from campaigns.estimation.estimators import Estimator, Model, Weights
from campaigns.estimation.rigid_transforms import Transform
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.identification.model_selection import candidate_models
from campaigns.identification.options import Fixed, Freed, IdentificationOptions
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.plan_file import PlannedShot, read_plan
from campaigns.planning.plans import joints_of
from campaigns.settings.option import Option
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies import study
from campaigns.studies.engine import ResultTable, run_task
from campaigns.studies.perturbations import KINDS, PERTURBATIONS, sizes_of
from sim.factory import build_of, true_geometry
from sim.geometry import geometry_of
from sim.scenarios.scenario import load_scenario, parse_scenario
from sim.scenarios.schema import Scenario
from sim.tracker.optics import Noise

MOST_CAMPAIGNS = 1_000_000
CHOICES = frozenset({Model.AUTO, Model.EXTENDED})
"""Models that are chosen among others by what is measured."""
ALL = "all"
"""Stands for all perturbations but those that are told by size."""
TABLE_SCHEMA = "pkmcal/study-table/1"
UNFIT_FOR_FILES = re.compile(r"[^\w.-]+")
CAMPAIGNS_A_TASK = 25
"""With effects, one after the other: long against sending them, short against all of them."""


@dataclass(frozen=True, slots=True)
class Method:
    """What a fit compares, how it weighs distances, and what it finds."""

    estimator: Estimator
    weights: Weights = Weights.STATED
    model: Model = Model.STANDARD

    @property
    def short(self) -> str:
        """`points`, `distances` or `equal weights`."""
        equal = self.weights is Weights.EQUAL
        return "equal weights" if equal else self.estimator.value

    def __str__(self) -> str:
        """`points`, `distances` or `distances, equal weights`."""
        equal = self.weights is Weights.EQUAL
        return f"{self.estimator.value}{', equal weights' if equal else ''}"


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyOptions:
    """What is compared, and what all combinations share.

    Without plans, scenarios, estimators or models: the campaign's own plan and cell, points, and
    the standard model. Without effects nothing goes wrong.
    """

    campaigns: Annotated[
        int,
        Option(
            "Campaigns of each combination, those already there included.",
            metavar="N",
            least=2,
            most=MOST_CAMPAIGNS,
        ),
    ]
    plan: Annotated[
        tuple[Path, ...], Option("A plan, if not the plan.csv in DIR; repeatable.", metavar="FILE")
    ] = ()
    scenario: Annotated[
        tuple[str, ...],
        Option(
            "What robots and noise to draw, if not by the campaign's own cell; repeatable.",
            metavar="NAME",
        ),
    ] = ()
    estimator: Annotated[
        tuple[Estimator, ...],
        Option("What the fits compare; repeatable.", default=Estimator.POINTS),
    ] = ()
    weights: Annotated[
        tuple[Weights, ...], Option("How distances count; repeatable.", default=Weights.STATED)
    ] = ()
    effects: Annotated[
        tuple[str, ...],
        Option(
            "What goes wrong in the campaigns, of which sizes: is a pass then wrong? Repeatable.",
            metavar="all|NAME[=SIZES]",
            default="nothing",
        ),
    ] = ()
    model: Annotated[
        tuple[Model, ...],
        Option(
            "What the fits find; repeatable. auto and extended: with --effects.",
            default=Model.STANDARD,
        ),
    ] = ()
    free: Freed = ()
    fix: Fixed = ()
    seed: Annotated[int, Option("Seed of all that is drawn.", metavar="N", least=0)] = 1
    workers: Annotated[
        str | None,
        Option(
            "Local processes, or the scheduler of a Dask cluster as tcp://HOST:PORT.",
            metavar="N|URL",
            default="one a processor",
        ),
    ] = None
    to: Annotated[Path | None, Option("Where tables go, if not DIR/study.", metavar="FOLDER")] = (
        None
    )

    @property
    def methods(self) -> tuple[Method, ...]:
        """Every estimator, distances by every way to weigh them, and every model."""
        weights = dict.fromkeys(self.weights or [Weights.STATED])
        return tuple(
            Method(estimator, each, model)
            for estimator in dict.fromkeys(self.estimator or [Estimator.POINTS])
            for each in (weights if estimator is Estimator.DISTANCES else [Weights.STATED])
            for model in dict.fromkeys(self.model or [Model.STANDARD])
        )

    @property
    def perturbations(self) -> tuple[str, ...]:
        """Names of what goes wrong, each once; an empty one where nothing does.

        Raises `OptionsInvalid` for one that there is not.
        """
        for name in self.effects:
            try:
                _ = name == ALL or sizes_of(name)
            except KeyError:
                raise OptionsInvalid(
                    f"there is no effect {name}", remedy=f"choose from {ALL}, {', '.join(KINDS)}"
                ) from None
            except ValueError:
                raise OptionsInvalid(
                    f"--effects {name}: sizes are numbers above 0 with commas between, of an "
                    "effect that has one size a campaign",
                    remedy="such as warmth=60,180,600",
                ) from None
        names = [(*PERTURBATIONS,) if name == ALL else (name,) for name in self.effects]
        return tuple(dict.fromkeys(chain.from_iterable(names))) or ("",)


@dataclass(frozen=True, slots=True)
class Combination:
    """One perturbation, plan, scenario and method; its campaigns have a table of their own."""

    plan: str
    scenario: Scenario
    setup: study.StudySetup
    method: Method
    table: ResultTable[study.CampaignRow]

    @property
    def words(self) -> dict[str, str]:
        """What tells it from others, by the names of documents and tables."""
        effect = {"effect": self.setup.perturbation} if self.setup.perturbation else {}
        return {
            **effect,
            "plan": self.plan,
            "scenario": self.scenario.name,
            "estimator": str(self.method),
            "model": self.method.model.value,
        }

    def __str__(self) -> str:
        """As people are told; of the usual model nothing."""
        return " · ".join(told_words(self.words))


def told_words(words: dict[str, str]) -> list[str]:
    """Words of a combination without the usual model."""
    return [text for name, text in words.items() if (name, text) != ("model", Model.STANDARD)]


def combinations(campaign: Campaign, asked: StudyOptions, folder: Path) -> tuple[Combination, ...]:
    """All of them, by perturbation, scenario, plan and method; their tables lie in `folder`.

    Raises `PlanInvalid`, `ScenarioInvalid` and `OptionsInvalid`, the latter also for a plan without
    the hold-out pairs by which a verdict is formed.
    """
    plans = dict.fromkeys(asked.plan or [campaign.plan_path])
    names: Iterable[str | None] = dict.fromkeys(asked.scenario) or [None]
    perturbations = asked.perturbations
    revolute = campaign.robot.mechanism.joints[0].is_revolute
    lacking, other = ("carriages", "on rails") if revolute else ("cranks", "with cranks")
    for name in filter(None, perturbations):
        if any(each.period_mm if revolute else each.of_cranks for each in sizes_of(name)):
            raise OptionsInvalid(
                f"--effects {name}: a {campaign.robot.mechanism.name} has no {lacking}",
                remedy=f"leave it out, or study a robot {other}",
            )
    scenarios = [study_scenario(campaign, name) for name in names]
    unperturbed = [
        (plan, scenario, method, study_setup(campaign, plan, scenario, method, asked))
        for scenario, plan, method in product(scenarios, plans, asked.methods)
    ]
    if perturbations != ("",):
        unperturbed = [
            (plan, scenario, method, _judging(campaign, scenario, method, setup, asked))
            for plan, scenario, method, setup in unperturbed
        ]
    found = tuple(
        _combination(plan, scenario, method, replace(setup, perturbation=name), folder)
        for name in perturbations
        for plan, scenario, method, setup in unperturbed
    )
    seen: dict[Path, Combination] = {}
    for combination in found:
        if seen.setdefault(combination.table.path, combination) is not combination:
            raise OptionsInvalid(
                f"two plans or scenarios are called alike: {combination}",
                remedy="give one of the files another name (a scenario: another `name:`)",
            )
    return found


def _judging(
    campaign: Campaign,
    scenario: Scenario,
    method: Method,
    setup: study.StudySetup,
    asked: StudyOptions,
) -> study.StudySetup:
    """The same with what all of `identify` and its verdict need; raises `OptionsInvalid`."""
    if not len(setup.shots.whole_pairs(ShotSet.VALIDATION).rows):
        raise OptionsInvalid(
            f"{campaign.plan_path}: no validation pairs, without which nothing passes",
            remedy="plan with some, as `pkmcal plan` does by default",
        )
    workspace = campaign.workspace_sample()
    if workspace is None:
        raise OptionsInvalid(
            f"{campaign.folder}: the robot can take hardly any pose at which positions are judged",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        )
    models = None
    if method.model in CHOICES:
        space = setup.nominal.mechanism.parameters
        models = candidate_models(space, method.model, asked.free, asked.fix)
    return replace(
        setup,
        options=replace(setup.options, workspace=workspace),
        beyond_model=partial(rod_robot, scenario.robot, DatumSample(campaign.robot.kinematics)),
        misread=misread,
        models=models,
        model=method.model,
    )


def _combination(
    plan: Path, scenario: Scenario, method: Method, setup: study.StudySetup, folder: Path
) -> Combination:
    head: dict[str, object] = {"schema": TABLE_SCHEMA, "parameters": list(setup.free)}
    head["study"] = setup.digest(scenario.robot.model_dump_json())
    table = ResultTable(folder, study.CampaignRow, "pkmcal study", head)
    found = Combination(plan.stem, scenario, setup, method, table)
    words = (["effect"] if setup.perturbation else []) + told_words(found.words)
    name = UNFIT_FOR_FILES.sub("_", "-".join(words).replace(", ", "-"))
    return replace(found, table=replace(table, path=folder / f"{name}.jsonl"))


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


def study_setup(
    campaign: Campaign, plan: Path, scenario: Scenario, method: Method, asked: StudyOptions
) -> study.StudySetup:
    """What all campaigns of a combination share.

    The hold-out pairs are those of the campaign's own plan, so that plans are judged by the same.
    Raises `ConfigInvalid` for a robot that cannot be simulated, `PlanInvalid`, and `OptionsInvalid`
    for shots that cannot give the free parameters.
    """
    require_same_mechanism(campaign, scenario)
    robot = campaign.robot
    fitted = _of_set(read_plan(plan, robot.mechanism), ShotSet.IDENTIFICATION)
    unseen = _of_set(campaign.read_plan(), ShotSet.VALIDATION)
    for path, shots in ((plan, fitted), (campaign.plan_path, unseen)):
        _check_assembled(path, robot.kinematics, shots)
    station = scenario.tracker.station.pose()
    base_from_tracker = Transform(station.base_from_tracker, station.origin_in_base_mm)
    setup = study.StudySetup(
        nominal=robot.kinematics,
        shots=study.planned_shots((*fitted, *unseen)),
        free=study.studied_parameters(
            robot.mechanism.parameters, method.model, asked.free, asked.fix
        ),
        options=IdentificationOptions(
            estimator=method.estimator, weights=method.weights, instrument=_noise_of(scenario)
        ),
        tracker_from_base=base_from_tracker.inverted(),
        seed=asked.seed,
        is_long=asked.campaigns >= study.MANY_CAMPAIGNS,
    )
    _check_enough(setup, plan)
    return setup


def left_out(scenario: Scenario, models: Iterable[Model]) -> tuple[str, ...]:
    """What the scenario has and a study has not: whatever no parameter of a model describes."""
    robot, asked = scenario.robot, {*models}
    gears = robot.transmission
    has_skews, has_tilts = asked <= {Model.RODS, Model.FULL}, asked <= {Model.FULL}
    rods = (robot.tolerances.rod_mm, *robot.rod_errors_mm)
    tilts = (robot.tolerances.axis_tilt_mrad, *robot.axis_tilts_mrad)
    effects = {
        "rods of unequal length": () if has_skews else rods,
        "tilted axes": () if has_tilts else tilts,
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


def study_tasks(
    setup: study.StudySetup, scenario: Scenario, numbers: Iterable[int]
) -> Iterator[study.StudyTask]:
    """The campaigns of these numbers, some at a time, each with a robot of its own."""
    sample = DatumSample(setup.nominal)
    for some in numbers_of_tasks(setup, numbers):
        robots = (_drawn(setup, scenario, number) for number in some)
        truths = [datum_parameters(setup.nominal, robot, sample).p for robot in robots]
        yield study.StudyTask(setup, some, np.array(truths))


def numbers_of_tasks(setup: study.StudySetup, numbers: Iterable[int]) -> Iterator[tuple[int, ...]]:
    """The numbers of the campaigns that make a task."""
    return study.chunks(numbers, CAMPAIGNS_A_TASK if setup.perturbation else setup.at_once)


def simulated(
    task: Portion[tuple[study.StudySetup, Scenario], tuple[int, ...]],
) -> tuple[study.CampaignRow, ...]:
    """Rows of campaigns of these numbers; whoever computes them draws their robots too."""
    return tuple(chain.from_iterable(map(run_task, study_tasks(*task.common, task.own))))


def uncertainty_of(noise: Noise) -> TrackerUncertainty:
    """The simulated tracker's, as its data sheet would have it."""
    return TrackerUncertainty.of_limits(**noise.data_sheet)


def _noise_of(scenario: Scenario) -> TrackerUncertainty:
    """Raises `OptionsInvalid` when there is none."""
    noise = uncertainty_of(scenario.tracker.noise)
    if min(noise.along_mm + noise.along_per_mm, noise.across_mm + noise.across_per_mm) <= 0.0:
        raise OptionsInvalid(
            f"scenario {scenario.name}: its tracker has no noise, so every σ would be 0",
            remedy="give tracker.noise in the cell file values above 0",
        )
    return noise


def _drawn(setup: study.StudySetup, scenario: Scenario, number: int) -> Kinematics:
    """The robot of one campaign, as the simulated cell would draw it.

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


def _of_set(shots: Sequence[PlannedShot], purpose: ShotSet) -> tuple[PlannedShot, ...]:
    return tuple(shot for shot in shots if shot.purpose is purpose)


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
    sought = f"{len(setup.free)} parameters by {setup.estimator.value}"
    if setup.dof < 1:
        shots = len(setup.fitted)
        pairs = len(setup.shots.whole_pairs(ShotSet.IDENTIFICATION).rows)
        raise OptionsInvalid(
            f"{plan}: {shots} shots in {pairs} pairs are too few for {sought}",
            remedy="plan more shots, or fix parameters with --fix",
        )
    if together := study.indistinguishable(setup):
        raise OptionsInvalid(
            f"{plan}: {sought} cannot be told apart: {', '.join(together[0])} move together",
            remedy=f"fix one of them, as with --fix {together[0][0]}, or plan other shots",
        )
    held = setup.nominal.mechanism.parameters.datum
    if shifted := [name for name in setup.free if name in held]:
        raise OptionsInvalid(
            f"{', '.join(shifted)} cannot be free in a study: true robots are told in the frame "
            "that the first motor holds",
            remedy="leave it out of --free; what another motor holds is told as well by this one",
        )
