"""What of the paper is done again, on which simulated cell, and one seed of it."""

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

from app.wiring import scenario_of
from campaigns.files.text_file import replace_text
from campaigns.files.yaml_file import read_document, yaml_text
from campaigns.robots.robot import find_robot
from campaigns.version import VERSION

ROBOT = "par4-prototype"
SPEED_UP = 500.0
"""Of the cell's time. The figures do not depend on it."""
SETTLE_TIMEOUT_S = 300.0
"""In the cell's time, 0.6 s outside: a computer that pauses for less does not fail a seed."""


@dataclass(frozen=True, slots=True)
class Experiment:
    """A part of the paper: a shipped scenario, and what is changed in it."""

    name: str
    scenario: str
    position_noise_mm: float | None = None
    """Half-width of the uniform draw on each coordinate at each arrival; None: the scenario's."""

    def recipe(self) -> str:
        """What makes results comparable: a digest of cell, nominal robot and software version."""
        scenario = scenario_of(Path(), f"sim://{self.scenario}")
        cell = scenario.model_dump_json(exclude={"seed", "speed_up"})
        robot = find_robot(ROBOT).robot.digest()
        words = "\n".join((VERSION, robot, cell, repr(self.position_noise_mm)))
        return hashlib.sha256(words.encode()).hexdigest()[:16]


SIMULATION = Experiment("simulation", "paper-simulation")
REPEATABILITY = Experiment("repeatability", "paper-simulation", 0.4 / math.sqrt(3.0))
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
