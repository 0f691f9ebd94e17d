"""The studies that are measured: throughput on par4-prototype, and `pkmcal study --effects`."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from app.study.setup import study_tasks, uncertainty_of
from benchmarks.shared.programs import pkmcal
from benchmarks.shared.prototype import CENTRE, EVERYWHERE, FREE, ROBOT
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.rigid_transforms import Transform
from campaigns.identification.options import IdentificationOptions
from campaigns.planning.plans import PlanRequest, make_plan
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.study import (
    CampaignRow,
    CampaignVerdict,
    StudySetup,
    StudyTask,
    planned_shots,
)
from sim.scenarios.scenario import load_scenario

SCENARIO = load_scenario("paper-simulation")
UNSEEN_PAIRS, DRIFT_SHOTS = 20, 2


def tasks_of(
    estimator: Estimator,
    pairs: int,
    campaigns: int,
    free: tuple[str, ...] = FREE,
    *,
    is_long: bool = False,
) -> list[StudyTask]:
    """So many campaigns of a study with so many fitted pairs."""
    request = PlanRequest(2 * pairs, UNSEEN_PAIRS, DRIFT_SHOTS, CENTRE)
    plan = make_plan(ROBOT, EVERYWHERE, request, np.random.default_rng(1))
    instrument = uncertainty_of(SCENARIO.tracker.noise)
    setup = StudySetup(
        nominal=ROBOT.kinematics,
        shots=planned_shots([shot for shot in plan if shot.purpose is not ShotSet.DRIFT]),
        free=free,
        options=IdentificationOptions(estimator=estimator, instrument=instrument),
        tracker_from_base=Transform(np.eye(3), -np.array(EVERYWHERE.tracker_mm)),
        seed=1,
        is_long=is_long,
    )
    return list(study_tasks(setup, SCENARIO, range(campaigns)))


@dataclass(frozen=True, slots=True)
class Studied:
    """A combination of `pkmcal study --effects`: what its document says (JSON), and its rows."""

    told: dict[str, Any]
    rows: Sequence[CampaignRow]

    def verdicts(self, what: str | None = None) -> list[CampaignVerdict]:
        """Verdicts on all campaigns, or on those of one size."""
        return [
            row.verdict for row in self.rows if row.verdict is not None and what in (None, row.what)
        ]


def studied(
    robot: str, scenario: str, shots: int, asked: Iterable[str], campaigns: int, workers: int = 1
) -> list[Studied]:
    """Study with effects on a new campaign, by the program itself."""
    with TemporaryDirectory() as room:
        name = str(Path(room) / "campaign")
        pkmcal("new", name, "--robot", robot, "--scenario", scenario)
        pkmcal("plan", name, "--shots", str(shots))
        count = ("--campaigns", str(campaigns), "--workers", str(workers))
        _, out = pkmcal("study", name, *asked, *count, "--json")
        rows = TypeAdapter(CampaignRow)
        return [
            Studied(told, [rows.validate_json(line) for line in lines_of(told["path"])[1:]])
            for told in json.loads(out)["effects"]
        ]


def lines_of(path: str) -> list[str]:
    return Path(path).read_text(encoding="utf-8").splitlines()


def options(name: str, values: Iterable[str]) -> list[str]:
    """A repeated option."""
    return [word for value in values for word in (f"--{name}", value)]


def mean(values: Iterable[float]) -> float:
    """Mean, or share of what is true; NaN of none, which keeps no limit."""
    taken = list(values)
    return sum(taken) / len(taken) if taken else nan
