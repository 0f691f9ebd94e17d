"""Trials: one seed of one of the paper's experiments, run on a simulated cell, and its result.

Lengths in mm, angles in deg.
"""

import hashlib
import math
import time
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from pydantic import BaseModel

from app.console import Terminal
from app.exits import AppError
from app.new_campaign import create_simulated
from app.rehearsal import rehearse
from app.wiring import scenario_of
from campaigns.arrays import AXES
from campaigns.campaign import Campaign, open_campaign
from campaigns.evaluation.model_errors import Residuals
from campaigns.evaluation.validation import ValidationResult
from campaigns.evidence import evaluate
from campaigns.files.text_file import replace_text
from campaigns.files.yaml_file import read_document, yaml_text
from campaigns.identification.options import AS_THE_PAPER
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot
from campaigns.studies.engine import ResultTable
from campaigns.version import VERSION

ROBOT = "par4-prototype"
REPEATABILITY_MM = 0.4 / math.sqrt(3.0)
"""Half-width of the uniform draw on each coordinate, section IV.D."""
SPEED_UP = 500.0
"""Of the cell's time. The figures do not depend on it."""
SETTLE_TIMEOUT_S = 300.0
"""In the cell's time, 0.6 s outside: a computer that pauses for less does not fail a seed."""

TrialKey = tuple[str, int, str]
"""Name of the experiment, seed and recipe."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """Part of the paper: a shipped scenario, and what is changed in it."""

    name: str
    scenario: str
    position_noise_mm: float | None = None
    """Half-width of the uniform draw on each coordinate at each arrival; None: the scenario's."""

    def recipe(self) -> str:
        """Digest of cell, nominal robot and software version: what makes results comparable."""
        scenario = scenario_of(Path(), f"sim://{self.scenario}")
        cell = scenario.model_dump_json(exclude={"seed", "speed_up"})
        robot = find_robot(ROBOT).robot.digest()
        words = "\n".join((VERSION, robot, cell, repr(self.position_noise_mm)))
        return hashlib.sha256(words.encode()).hexdigest()[:16]


SIMULATION = Experiment("simulation", "paper-simulation")
REPEATABILITY = Experiment("repeatability", "paper-simulation", REPEATABILITY_MM)
PROTOTYPE = Experiment("prototype", "paper-prototype")
EXPERIMENTS = (SIMULATION, REPEATABILITY, PROTOTYPE)


@dataclass(frozen=True, slots=True)
class Trial:
    """One seed of an experiment: it draws the pairs that are measured and all noise."""

    experiment: Experiment
    seed: int

    def __str__(self) -> str:
        return f"{self.experiment.name}, seed {self.seed}"


def trials(seeds: int) -> tuple[Trial, ...]:
    """Seeds 1 to `seeds` of every experiment, in turn: what is broken off is broken off evenly."""
    return tuple(
        Trial(experiment, seed) for seed in range(1, seeds + 1) for experiment in EXPERIMENTS
    )


class Errors(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Modelled minus measured distances of pairs, with the nominal and the identified geometry."""

    before_mm: tuple[float, ...]
    after_mm: tuple[float, ...]


class Stage(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Figures of section IV.E's tests, before or after calibration."""

    lengths_mm: tuple[float, ...]
    """Commanded distances of the validation pairs."""
    errors_mm: tuple[float, ...]
    """Commanded minus measured."""
    rotation_mm: float
    straightness_mm: dict[str, float]
    """By axis."""
    radius_mm: float
    """Of the sphere of repeatability."""
    rp_mm: float
    frame_mean_mm: float
    frame_max_mm: float

    @property
    def distance_mean_mm(self) -> float:
        """Mean of the absolute errors."""
        return float(np.abs(self.errors_mm).mean())

    @property
    def distance_max_mm(self) -> float:
        """Largest absolute error."""
        return float(np.abs(self.errors_mm).max())


class Estimate(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Identified parameter: errors are what it differs by from nominal."""

    true_error: float
    estimated_error: float
    std: float | None = None

    @property
    def missed_by(self) -> float:
        """Estimated minus true."""
        return self.estimated_error - self.true_error


class TrialResult(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Figures of one seed."""

    experiment: str
    seed: int
    recipe: str
    seconds: float
    parameters: dict[str, Estimate]
    fitted: Errors
    unseen: Errors
    before: Stage
    after: Stage

    @property
    def key(self) -> TrialKey:
        """Order in the file."""
        return self.experiment, self.seed, self.recipe

    def missed(self, unit: str) -> list[float]:
        """Sizes of what the parameters of a unit, mm or deg, are missed by."""
        names = PAR4.parameters.of_unit(unit, tuple(self.parameters))
        return [abs(self.parameters[name].missed_by) for name in names]


def trial_table(path: Path) -> ResultTable[TrialResult]:
    """File of results; those of other recipes stay in it, unused."""
    return ResultTable(path, TrialResult, "pkmcal reproduce")


def rehearsed(room: Path, trial: Trial) -> tuple[TrialResult]:
    """Result of the whole chain in a campaign of its own, below `room`.

    What it says to people is not shown. Raises whatever went wrong.
    """
    started_s = time.monotonic()
    with TemporaryDirectory(dir=room) as own:
        folder = Path(own) / "campaign"
        create_simulated(folder, ROBOT, trial.experiment.scenario, trial.seed)
        adapt(folder, trial)
        campaign = open_campaign(folder)
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            _, against = rehearse(campaign, Terminal(as_json=False), AS_THE_PAPER)
        if against:
            raise AppError("; ".join(against), remedy=f"pkmcal dry-run --seed {trial.seed}")
        return (result_of(campaign, trial, time.monotonic() - started_s),)


def adapt(folder: Path, trial: Trial) -> None:
    """Make a new campaign on the experiment's scenario into the trial's; its files say so."""
    cell = read_document(folder / "cell.yaml", if_missing="make the campaign first")
    tree = cell.editable_tree()
    tree["name"] = trial.experiment.name
    tree["speed_up"] = SPEED_UP
    if trial.experiment.position_noise_mm is not None:
        tree["robot"]["repeatability"] = {"position_mm": trial.experiment.position_noise_mm}
    replace_text(folder / "cell.yaml", yaml_text(tree))
    campaign = read_document(folder / "campaign.yaml", if_missing="make the campaign first")
    tree = campaign.editable_tree()
    tree["plan"]["seed"] = trial.seed
    tree["settle"]["timeout_s"] = SETTLE_TIMEOUT_S
    replace_text(folder / "campaign.yaml", yaml_text(tree))


def result_of(campaign: Campaign, trial: Trial, seconds: float) -> TrialResult:
    """Figures of a campaign that went through the whole chain; raises `AppError`."""
    evaluation = evaluate(campaign)
    found, errors = evaluation.evidence.identification, evaluation.errors
    if found is None or errors is None:
        raise _missing(trial, "series")
    true = scenario_of(campaign.folder, campaign.config.controller.url).robot.true_flat()
    identified = {name: found.parameters[name] for name in found.free}
    return TrialResult(
        experiment=trial.experiment.name,
        seed=trial.seed,
        recipe=trial.experiment.recipe(),
        seconds=seconds,
        parameters={
            name: Estimate(
                true_error=true[name] - parameter.nominal,
                estimated_error=parameter.delta,
                std=parameter.std,
            )
            for name, parameter in identified.items()
        },
        fitted=_errors(errors.fitted, trial),
        unseen=_errors(errors.unseen, trial),
        before=_stage(evaluation.before, trial),
        after=_stage(evaluation.after, trial),
    )


def _errors(errors: Residuals | None, trial: Trial) -> Errors:
    if errors is None or errors.after_mm is None:
        raise _missing(trial, "errors of pairs")
    before_mm, after_mm = errors.before_mm.tolist(), errors.after_mm.tolist()
    return Errors(before_mm=tuple(before_mm), after_mm=tuple(after_mm))


def _stage(validation: ValidationResult | None, trial: Trial) -> Stage:
    if (
        validation is None
        or (pairs := validation.distances) is None
        or (absolute_mm := validation.absolute_mm) is None
        or (rotation := validation.rotation) is None
        or (repeated := validation.repeatability) is None
        or {*AXES} != {line.axis for line in validation.lines}
    ):
        raise _missing(trial, "tests of a validation")
    return Stage(
        lengths_mm=tuple(pairs.commanded_mm.tolist()),
        errors_mm=tuple(pairs.errors_mm.tolist()),
        rotation_mm=rotation.moved.value_mm,
        straightness_mm={line.axis: line.straightness.value_mm for line in validation.lines},
        radius_mm=repeated.radius.value_mm,
        rp_mm=repeated.rp.value_mm,
        frame_mean_mm=float(absolute_mm.mean()),
        frame_max_mm=float(absolute_mm.max()),
    )


def _missing(trial: Trial, what: str) -> AppError:
    return AppError(f"{trial}: {what} are missing", remedy="try this seed again")
