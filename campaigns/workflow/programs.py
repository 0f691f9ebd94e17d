"""Programs for a controller that is not connected: ways to all shots as CSV of poses and joints."""

# A program has to do by itself what a run does step by step: go to each shot by a safe way, stand
# still there long enough to be measured, and go on. So it is made from the work that a run or
# validation would be given (`run_work`, `validation_work`), and its ways are those of the engine.
# Each stop has pose and joints, because some controllers take the one, some the other. Poses are
# computed with the set that the controller holds: they lead it to the joints of the plan. After
# calibration this is the exported set, or the nominal one where targets are corrected.
# The first row's last column names the plan's digest, and after calibration the digest of the set,
# by which `status` recognises a program that is out of date.

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from campaigns.arrays import Array
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.evidence import joints_path, program_path
from campaigns.files.csv_file import csv_text, fixed_text, number_text
from campaigns.files.text_file import replace_text
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.work import Work
from campaigns.options import CheckOptions, ProgramOptions, ProgramStage, ValidationOptions
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.planning.steps import Step
from campaigns.robots.robot import pose_row
from campaigns.shots.columns import axis_columns, axis_texts, in_files
from campaigns.version import VERSION
from campaigns.workflow.checking import check_work
from campaigns.workflow.importing import declared_set
from campaigns.workflow.running import run_work
from campaigns.workflow.validation import validation_work
from drivers.bounded_files import is_there
from drivers.texts import printable


@dataclass(frozen=True, slots=True, eq=False)
class ProgramStop:
    """Place to go to."""

    joints: Array
    """Joints (n,), rad or mm."""
    pose: Array
    """Pose to send (t,), mm and rad."""
    shot: PlannedShot | None = None
    """Shot that is measured at the stop; None: the robot only passes."""


@dataclass(frozen=True, slots=True)
class WrittenProgram:
    """Written program of a stage."""

    stage: ProgramStage
    path: Path
    joints_path: Path
    """File with the joints of the program's shots, for `import`."""
    shots: int
    """Number of stops at which is measured."""
    seconds: float
    """Estimated time of motions and stops."""
    notes: tuple[str, ...]
    """Tests that were left out or shortened, in words."""


def planned_joints(campaign: Campaign, points: Path, stage: str) -> Path:
    """Return the joints file of a stage's program; raise `OptionsInvalid` without one.

    `points` is the file of the points at these joints, for the message.
    """
    joints = joints_path(campaign.folder, stage)
    if not is_there(joints):
        raise OptionsInvalid(
            f"{points}: points alone do not state where the joints were",
            remedy="give --joints FILE, a file with each point's joints; if it is a shots.csv, "
            "correct its first line",
        )
    return joints


def write_programs(campaign: Campaign, options: ProgramOptions) -> tuple[WrittenProgram, ...]:
    """Write the stages' programs; older programs are replaced.

    Without a stage in the options these are the plan and the validation before calibration. Raise
    `OptionsInvalid` for the stage after calibration without an export, `PlanInvalid` for a plan
    that cannot be run, or `WriteFailed`.
    """
    both: tuple[ProgramStage, ...] = ("run", "before")
    stages = both if options.stage is None else (options.stage,)
    return tuple(_write(campaign, stage) for stage in stages)


@dataclass(frozen=True, slots=True, eq=False)
class StageWork:
    """Work of a stage that a program describes."""

    work: Work
    held: Kinematics
    """Model that the controller computes with."""
    notes: tuple[str, ...] = ()
    """Tests that were left out or shortened, in words."""
    calibrated: str = ""
    """Digest of the set of a validation; of other stages none."""


def stage_work(campaign: Campaign, stage: ProgramStage) -> StageWork:
    """Return the work of a stage; raise as `write_programs` does."""
    if stage == "run":
        return StageWork(run_work(campaign, campaign.checked_plan()), campaign.robot.kinematics)
    if stage == "check":
        return StageWork(check_work(campaign, CheckOptions()), _held_by_file(campaign))
    written = declared_set(campaign, stage)
    parameters = campaign.robot.parameters if written.by == "targets" else written.wanted
    tests = ValidationOptions(stage=stage, by=written.by)
    work, notes = validation_work(campaign, parameters, tests)
    held = Kinematics.of(campaign.robot.mechanism, parameters)
    return StageWork(work, held, notes, written.digest)


# 1. the work of the stage, and the model that the controller computes with; 2. all stops, with the
# safe ways between them; 3. the program, and beside it the joints of its shots, which `import`
# later joins with the measured points; 4. an estimate of the time.
def _write(campaign: Campaign, stage: ProgramStage) -> WrittenProgram:
    """Write the program of a stage and the file of its joints."""
    mechanism, config = campaign.robot.mechanism, campaign.config
    planned = stage_work(campaign, stage)
    work, held, notes = planned.work, planned.held, planned.notes
    heading = [
        f"campaign {config.name}, robot {campaign.robot.name}",
        f"plan.csv sha256 {plan_digest(campaign.read_plan(), mechanism)}",
        *([f"calibrated by sha256 {planned.calibrated}"] if planned.calibrated else []),
    ]
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
    # joints move together: the one that turns farthest sets the time of each motion
    seconds = float(turns.max(axis=1, initial=0.0).sum()) / campaign.pace.joint_speed_rad_s
    seconds += len(steps) * dwell_s
    return WrittenProgram(stage, path, to_import, len(steps), seconds, notes)


def _held_by_file(campaign: Campaign) -> Kinematics:
    """Return the model of the set that was written last for the controller, else the nominal one.

    With corrected targets the controller keeps the nominal set.
    """
    try:
        written = declared_set(campaign, "after")
    except OptionsInvalid:  # nothing was written
        return campaign.robot.kinematics
    parameters = campaign.robot.parameters if written.by == "targets" else written.wanted
    return Kinematics.of(campaign.robot.mechanism, parameters)


def _stops(work: Work, steps: Sequence[Step], held: Kinematics) -> Iterator[ProgramStop]:
    """Yield all stops, with the safe ways between them that a run would take.

    `held` is the model that the controller computes with, of the point that it controls. Raise
    `PlanInvalid` if there is no safe way to a shot.
    """
    here: tuple[float, ...] | None = None
    for step in steps:
        for target in (*step.approach, step.planned.joints):
            legs = [target] if here is None else work.robot.legs(here, target)
            if not legs:
                raise PlanInvalid(
                    f"no safe way to shot {step.planned.shot}", remedy="take it out of plan.csv"
                )
            *detours, last = legs
            models = held, work.robot.kinematics.controlled
            yield from (ProgramStop(np.array(q), _passed(*models, q)) for q in detours)
            if target is step.planned.joints:
                yield ProgramStop(np.array(last), _commanded(held, step), step.planned)
            else:
                yield ProgramStop(np.array(last), _passed(*models, last))
            here = target


def _commanded(held: Kinematics, step: Step) -> Array:
    """Return the pose (t,) to send for a step: as planned, or the one that leads to its joints."""
    if step.command == "pose":
        return pose_row(step.corrected or step.planned.pose)
    near = pose_row(step.planned.pose)[None]
    return np.asarray(held.forward(np.array([step.planned.joints]), near).values_or_raise()[0])


# Near a singular pose the controller's own kinematics may have no pose at the joints of a passed
# stop: then it goes to the robot's own pose there, off its joints by less than any correction.
def _passed(held: Kinematics, robot: Kinematics, joints: Sequence[float]) -> Array:
    """Return the pose (t,) of passed joints by the controller's model, else by the robot's."""
    pose = held.forward(np.array([joints]))
    if not pose.is_solved[0]:
        pose = robot.forward(np.array([joints]))
    return np.asarray(pose.values_or_raise()[0])


def _joints_text(mechanism: Mechanism, stops: Sequence[ProgramStop]) -> str:
    """Return the joints that each shot is commanded with, for `import --format ascii`."""
    axes = mechanism.joints
    rows = [
        [f"shot{stop.shot.shot}", *axis_texts(axes, stop.joints.tolist()), *_pair_and_set(stop)]
        for stop in stops
        if stop.shot
    ]
    return csv_text(("name", *axis_columns(axes), "pair", "set"), rows)


def _program_text(
    mechanism: Mechanism, stops: Sequence[ProgramStop], heading: Sequence[str], dwell_s: float
) -> str:
    """Return the program as a CSV text, a row for each stop; the first row has the heading."""
    task, joints = mechanism.task, mechanism.joints
    head = ("shot", "set", "pair", *axis_columns(task), *axis_columns(joints), "dwell_s", "program")
    # controllers read ASCII at most; a CSV has no comments, so the heading stands in a cell
    about = printable("; ".join(heading)).encode("ascii", "replace").decode()
    rows: list[list[str]] = []
    for stop in stops:
        pair, purpose = _pair_and_set(stop)
        rows.append(
            [
                "" if stop.shot is None else str(stop.shot.shot),
                purpose,
                pair,
                *(fixed_text(value, decimals=6) for value in in_files(task, stop.pose.tolist())),
                *axis_texts(joints, stop.joints.tolist()),
                number_text(0.0 if stop.shot is None else dwell_s),
                "" if rows else about,
            ]
        )
    return csv_text(head, rows)


def _pair_and_set(stop: ProgramStop) -> tuple[str, str]:
    """Return the cells `pair` and `set` of a stop."""
    if stop.shot is None:
        return "", "passes"
    return "" if stop.shot.pair is None else str(stop.shot.pair), stop.shot.purpose.value
