"""Programs for a controller out of reach: the way to each shot as one CSV of poses and joints."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.errors import PlanInvalid
from campaigns.evidence import program_path
from campaigns.files.csv_file import csv_text, fixed_text, number_text
from campaigns.files.text_file import replace_text
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.mechanism import Kinematics
from campaigns.measuring.work import Work
from campaigns.options import ProgramOptions, ProgramStage, ValidationOptions
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.planning.steps import Step
from campaigns.robots.robot import pose_row
from campaigns.shots.columns import axis_columns, axis_texts
from campaigns.version import VERSION
from campaigns.workflow.importing import declared_set
from campaigns.workflow.running import run_work
from campaigns.workflow.validation import validation_work
from drivers.texts import printable


@dataclass(frozen=True, slots=True, eq=False)
class ProgramStop:
    """Place to go to: joints (n,) and pose (t,) in inner units; `shot` is None where it passes."""

    joints: Array
    pose: Array
    shot: PlannedShot | None = None


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


def joints_path(folder: Path, stage: str) -> Path:
    """Return the file of the joints of a stage's shots, for `import`."""
    return folder / f"program-{stage}-joints.csv"


def write_programs(campaign: Campaign, options: ProgramOptions) -> tuple[WrittenProgram, ...]:
    """Write plan.csv and the tests of a validation as programs; older ones are replaced.

    Safe ways, order and speed are those of a run. Poses are such as the controller has to be sent:
    by the nominal set; after calibration by what `export` or `correct` wrote last. Raise
    `OptionsInvalid`, `PlanInvalid` or `WriteFailed`.
    """
    both: tuple[ProgramStage, ...] = ("run", "before")
    stages = both if options.stage is None else (options.stage,)
    return tuple(_write(campaign, stage) for stage in stages)


def _write(campaign: Campaign, stage: ProgramStage) -> WrittenProgram:
    mechanism, config = campaign.robot.mechanism, campaign.config
    heading = [
        f"campaign {config.name}, robot {campaign.robot.name}",
        f"plan.csv sha256 {plan_digest(campaign.read_plan(), mechanism)}",
    ]
    if stage == "run":
        work, notes = run_work(campaign, campaign.checked_plan()), tuple[str, ...]()
        held = campaign.robot.kinematics
    else:
        written = declared_set(campaign, stage)
        parameters = campaign.robot.parameters if written.by == "targets" else written.wanted
        tests = ValidationOptions(stage=stage, by=written.by)
        work, notes = validation_work(campaign, parameters, tests)
        held = Kinematics.of(mechanism, parameters)
        heading.append(f"calibrated by sha256 {written.digest}")
    steps = [step for step in work.steps if not step.planned.nest]
    if nests := len(work.steps) - len(steps):
        notes = (*notes, f"{nests} shots of nests are left out: no program points the tracker")
    stops = tuple(_stops(work, steps, held.controlled))
    dwell_s = config.settle.time_s + config.tracker.measuring_time_s
    heading = [
        f"pkmcal {VERSION}, csv: {stage}",
        *heading,
        "poses of the controlled point in the base frame and joints as pkmcal counts them",
        f"speed {config.controller.speed_percent:g} %, {dwell_s:g} s at each of {len(steps)} shots",
        "read it, and run it slowly first",
    ]
    path = program_path(campaign.folder, stage)
    to_import = joints_path(campaign.folder, stage)
    with campaign.held():
        replace_text(path, _program_text(mechanism, stops, heading, dwell_s))
        replace_text(to_import, _joints_text(mechanism, stops))
    scale = np.array([axis.scale for axis in mechanism.joints])
    turns = np.abs(np.diff([stop.joints for stop in stops], axis=0) / scale)
    seconds = float(turns.max(axis=1, initial=0.0).sum()) / campaign.pace.joint_speed_rad_s
    seconds += len(steps) * dwell_s
    return WrittenProgram(stage, path, to_import, len(steps), seconds, notes)


def _stops(work: Work, steps: Sequence[Step], held: Kinematics) -> Iterator[ProgramStop]:
    """Yield all stops, with safe ways between them as a run takes them; raise `PlanInvalid`.

    `held`: the model that the controller works with, of the point that it controls.
    """
    here: tuple[float, ...] | None = None
    for step in steps:
        for target in (*step.approach, step.planned.joints):
            legs = [target] if here is None else work.robot.legs(here, target)
            if not legs:
                raise PlanInvalid(
                    f"no safe way to shot {step.planned.shot}", remedy="take it out of plan.csv"
                )
            *passed, last = legs
            yield from (ProgramStop(np.array(q), _pose(held, q)) for q in passed)
            if target is step.planned.joints:
                yield ProgramStop(np.array(last), _commanded(held, step), step.planned)
            else:
                yield ProgramStop(np.array(last), _pose(held, last))
            here = target


def _commanded(held: Kinematics, step: Step) -> Array:
    """Return the pose (t,) to send for a step."""
    if step.command == "pose":
        return pose_row(step.corrected or step.planned.pose)
    return _pose(held, step.planned.joints, pose_row(step.planned.pose))


def _pose(held: Kinematics, joints: Sequence[float], near: Array | None = None) -> Array:
    given = None if near is None else near[None]
    return np.asarray(held.forward(np.array([joints]), given).values_or_raise()[0])


def _joints_text(mechanism: ClosedChain, stops: Sequence[ProgramStop]) -> str:
    """Return the joints that each shot is commanded with, for `import --format ascii`."""
    axes = mechanism.joints
    rows = [
        [f"shot{stop.shot.shot}", *axis_texts(axes, stop.joints.tolist()), *_pair_and_set(stop)]
        for stop in stops
        if stop.shot
    ]
    return csv_text(("name", *axis_columns(axes), "pair", "set"), rows)


def _program_text(
    mechanism: ClosedChain, stops: Sequence[ProgramStop], heading: Sequence[str], dwell_s: float
) -> str:
    """Return the program, a row for each stop; the first one has the heading."""
    task, joints = mechanism.task, mechanism.joints
    head = ("shot", "set", "pair", *axis_columns(task), *axis_columns(joints), "dwell_s", "program")
    about = printable("; ".join(heading)).encode("ascii", "replace").decode()
    rows: list[list[str]] = []
    for stop in stops:
        pair, purpose = _pair_and_set(stop)
        place = zip(task, stop.pose.tolist(), strict=True)
        rows.append(
            [
                "" if stop.shot is None else str(stop.shot.shot),
                purpose,
                pair,
                *(fixed_text(axis.to_file(value), decimals=6) for axis, value in place),
                *axis_texts(joints, stop.joints.tolist()),
                number_text(0.0 if stop.shot is None else dwell_s),
                "" if rows else about,
            ]
        )
    return csv_text(head, rows)


def _pair_and_set(stop: ProgramStop) -> tuple[str, str]:
    if stop.shot is None:
        return "", "passes"
    return "" if stop.shot.pair is None else str(stop.shot.pair), stop.shot.purpose.value
