"""Validation of a campaign: how good the robot is as its user commands it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from campaigns.campaign import Campaign
from campaigns.chain.work import engine_work
from campaigns.evaluation.validation import (
    ValidationResult,
    ValidationVerdict,
    evaluate_validation,
    validation_verdict,
)
from campaigns.journal.journal import Journal, JournalReader
from campaigns.journal.records import Finding
from campaigns.measuring.run_state import SILENT, RunObserver
from campaigns.measuring.session import (
    Work,
    measure_series,
)
from campaigns.measuring.shot_taker import Cell
from campaigns.options import Selection
from campaigns.planning.predicted_precision import (
    EstimationSetup,
)
from campaigns.planning.validation_plan import Reachable, validation_steps
from campaigns.robots.robot import RobotFile
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal

ValidationStage = Literal["before", "after"]
TESTS = frozenset(
    {ShotSet.VALIDATION, ShotSet.ROTATION, ShotSet.STRAIGHTNESS, ShotSet.REPEATABILITY}
)
"""Of a validation."""


@dataclass(frozen=True, slots=True, eq=False)
class Validated:
    """Result of a validation, and the verdict on it."""

    result: ValidationResult
    verdict: ValidationVerdict


def validation_work(
    campaign: Campaign,
    stage: ValidationStage,
    active: Mapping[str, float],
    tests: frozenset[ShotSet] = TESTS,
) -> tuple[Work, tuple[str, ...]]:
    """Tests as work for the engine, and what had to be shortened or left out.

    Planned with the parameters that are active in the controller, which takes the pose commands.
    """
    nominal = campaign.robot
    robot = RobotFile.from_flat(nominal.mechanism, active, name="active", limits=nominal.limits)
    unseen = campaign.read_plan() if ShotSet.VALIDATION in tests else ()
    planned = validation_steps(
        campaign.config.validation,
        [shot for shot in unseen if shot.purpose is ShotSet.VALIDATION],
        Reachable(robot.kinematics, robot.limits),
        tests,
        np.random.default_rng(campaign.config.plan.seed),
    )
    setup = EstimationSetup(
        Selection().estimator, nominal.mechanism.parameters.free_by_default, campaign.instrument
    )
    kinematics = robot.kinematics
    work = engine_work(campaign, stage, planned.steps, kinematics, robot.digest(), setup)
    return work, planned.notes


def validate(
    campaign: Campaign,
    cell: Cell,
    stage: ValidationStage,
    tests: frozenset[ShotSet] = TESTS,
    *,
    observer: RunObserver = SILENT,
    stop_requested: Callable[[], bool] = lambda: False,
) -> Validated:
    """Measure on a connected cell how good the robot is as its user commands it, and judge it."""
    work, notes = validation_work(campaign, stage, cell.robot.read_geometry(), tests)
    for note in notes:
        observer.event(note)
    with campaign.journal() as journal:
        series = measure_series(cell, journal, work, observer, stop_requested)
        return record_validation(campaign, journal, series, stage)


def record_validation(
    campaign: Campaign, journal: Journal, series: int, stage: ValidationStage
) -> Validated:
    """Evaluate a series that was measured, and write the finding into the journal."""
    shots = shots_of_journal(journal.shots(series), campaign.robot.mechanism)
    found = evaluate_validation(shots, campaign.instrument)
    before_mm = mean_error_before_mm(journal) if stage == "after" else None
    verdict = validation_verdict(found, campaign.config.acceptance, before_mm)
    body = {"stage": stage, "series": series, **found.document()}
    journal.append(Finding("validation", body), series=series)
    return Validated(found, verdict)


def mean_error_before_mm(journal: JournalReader) -> float | None:
    """Mean error of distances by the latest validation before loading; None without one."""
    bodies = [entry.record.body for entry in journal.records_of(Finding)]
    known = [body["distances_mm"] for body in bodies if body.get("stage") == "before"]
    before = next((distances for distances in reversed(known) if distances is not None), None)
    if not isinstance(before, dict):
        return None
    return float(str(before["mean_abs"]))
