"""Programs of a campaign: plan and tests as tables for a controller out of reach."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.controllers.programs import (
    Program,
    ProgramStop,
    joints_path,
    joints_text,
    program_path,
    program_text,
)
from campaigns.errors import PlanInvalid
from campaigns.files.text_file import replace_text
from campaigns.kinematics.mechanism import Kinematics
from campaigns.measuring.work import Work
from campaigns.options import ProgramOptions, ProgramStage, ValidationOptions
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import plan_digest
from campaigns.planning.steps import Step
from campaigns.robots.robot import pose_row
from campaigns.workflow.importing import declared_set
from campaigns.workflow.running import run_work
from campaigns.workflow.validation import validation_work


@dataclass(frozen=True, slots=True)
class WrittenProgram:
    """Program as it was written, and what is left out of it or shortened."""

    stage: ProgramStage
    path: Path
    joints_path: Path
    """Joints of its shots, for `import`."""
    shots: int
    seconds: float
    notes: tuple[str, ...]


def write_programs(campaign: Campaign, options: ProgramOptions) -> tuple[WrittenProgram, ...]:
    """Write plan.csv and the tests of a validation as programs; older ones are replaced.

    Safe ways, order and speed are those of a run. Poses are such as the controller has to be sent:
    by the nominal set; after calibration by what `export` or `correct` wrote last. Raises
    `OptionsInvalid`, `PlanInvalid` or `WriteFailed`.
    """
    both: tuple[ProgramStage, ...] = ("run", "before")
    stages = both if options.stage is None else (options.stage,)
    return tuple(_written(campaign, stage) for stage in stages)


def _written(campaign: Campaign, stage: ProgramStage) -> WrittenProgram:
    mechanism, config, told = campaign.robot.mechanism, campaign.config, list[str]()
    if stage == "run":
        work, notes = run_work(campaign, campaign.checked_plan()), tuple[str, ...]()
        held = campaign.robot.kinematics
    else:
        written = declared_set(campaign, stage)
        own = campaign.robot.parameters if written.by == "targets" else written.wanted
        tests = ValidationOptions(stage=stage, by=written.by)
        work, notes = validation_work(campaign, own, tests)
        held, told = Kinematics.of(mechanism, own), [f"calibrated by sha256 {written.digest}"]
    steps = [step for step in work.steps if not step.planned.nest]
    if left := len(work.steps) - len(steps):
        notes = (*notes, f"{left} shots of nests are left out: no program points the tracker")
    program = Program(
        stage=stage,
        heading=(
            f"campaign {config.name}, robot {campaign.robot.name}",
            f"plan.csv sha256 {plan_digest(campaign.read_plan(), mechanism)}",
            *told,
        ),
        mechanism=mechanism,
        stops=tuple(_stops(work, steps, held.controlled)),
        speed_percent=config.controller.speed_percent,
        dwell_s=config.settle.time_s + config.tracker.measuring_time_s,
    )
    path = program_path(campaign.folder, stage)
    of_joints = joints_path(campaign.folder, stage)
    with campaign.held():
        replace_text(path, program_text(program))
        replace_text(of_joints, joints_text(program))
    seconds = _seconds(program, campaign.pace.joint_speed_rad_s)
    return WrittenProgram(stage, path, of_joints, len(steps), seconds, notes)


def _stops(work: Work, steps: Sequence[Step], held: Kinematics) -> Iterator[ProgramStop]:
    """All stops, safe ways between them as a run takes them; raises `PlanInvalid`.

    `held`: the model that the controller works with, of the point that it controls.
    """
    here: tuple[float, ...] | None = None
    for step in steps:
        for target in (*step.approach, step.planned.joints):
            *passed, last = _way(work.robot, here, target)
            if not (passed or last):
                raise PlanInvalid(
                    f"no safe way to shot {step.planned.shot}", remedy="take it out of plan.csv"
                )
            yield from (ProgramStop(np.array(q), _pose(held, q)) for q in passed)
            if target is step.planned.joints:
                yield ProgramStop(np.array(last), _commanded(held, step), step.planned)
            else:
                yield ProgramStop(np.array(last), _pose(held, last))
            here = target


def _way(
    robot: RobotModel, here: tuple[float, ...] | None, there: tuple[float, ...]
) -> list[tuple[float, ...]]:
    """Joints to go to, the last being `there`; [()] where there is no safe way."""
    if here is None:
        return [there]
    return robot.legs(here, there) or [()]


def _commanded(held: Kinematics, step: Step) -> Array:
    """Pose (t,) to send for a step."""
    if step.command == "pose":
        return pose_row(step.corrected or step.planned.pose)
    return _pose(held, step.planned.joints, pose_row(step.planned.pose))


def _pose(held: Kinematics, joints: Sequence[float], near: Array | None = None) -> Array:
    given = None if near is None else near[None]
    return np.asarray(held.forward(np.array([joints]), given).values_or_raise()[0])


def _seconds(program: Program, joint_speed_rad_s: float) -> float:
    """Time that it takes, by straight ways."""
    joints = np.array([stop.joints for stop in program.stops])
    scale = np.array([axis.scale for axis in program.mechanism.joints])
    turns = np.abs(np.diff(joints, axis=0) / scale).max(axis=1, initial=0.0)
    shots = sum(stop.shot is not None for stop in program.stops)
    return float(turns.sum()) / joint_speed_rad_s + shots * program.dwell_s
