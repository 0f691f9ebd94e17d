"""Programs for a controller out of reach: the way to each shot as one CSV of poses and joints."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from campaigns.arrays import Array
from campaigns.files.csv_file import csv_text, fixed_text, number_text
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.shots.columns import axis_columns, axis_texts
from campaigns.version import VERSION
from drivers.bounded_files import is_file
from drivers.texts import printable

_number = partial(fixed_text, decimals=6)
HEADING_BYTES = 4000


@dataclass(frozen=True, slots=True, eq=False)
class ProgramStop:
    """Place to go to: joints (n,) and pose (t,) in inner units; `shot` is None where it passes."""

    joints: Array
    pose: Array
    shot: PlannedShot | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Program:
    """Stops in the order of the run, and how fast to go and how long to stand at a shot."""

    stage: str
    heading: tuple[str, ...]
    """Lines that say what it is of."""
    mechanism: ClosedChain
    stops: tuple[ProgramStop, ...]
    speed_percent: float
    dwell_s: float


def shot_name(shot: PlannedShot) -> str:
    """Name of a shot's point, for the tracker's software and the joints file."""
    return f"shot{shot.shot}"


def program_path(folder: Path, stage: str) -> Path:
    """File of a stage's program."""
    return folder / f"program-{stage}.csv"


def joints_path(folder: Path, stage: str) -> Path:
    """Return the file of the joints of a stage's shots, for `import`."""
    return folder / f"program-{stage}-joints.csv"


def is_program_there(folder: Path, stage: str, digest: Callable[[], str]) -> bool:
    """Whether a stage's program names this digest in its heading."""
    path = program_path(folder, stage)
    if not is_file(path):
        return False
    with path.open("rb") as file:
        return digest().encode() in file.read(HEADING_BYTES)


def is_plan_program_there(
    folder: Path, plan: Sequence[PlannedShot] | None, mechanism: ClosedChain
) -> bool:
    """Whether there is a program of plan.csv, as it is now."""
    if plan is None:
        return False
    return is_program_there(folder, "run", lambda: plan_digest(plan, mechanism))


def joints_text(program: Program) -> str:
    """File of the joints that each shot is commanded with, for `import`."""
    axes = program.mechanism.joints
    shots = [(stop.shot, stop.joints.tolist()) for stop in program.stops if stop.shot]
    rows = [
        [
            shot_name(shot),
            *axis_texts(axes, joints),
            "" if shot.pair is None else str(shot.pair),
            shot.purpose.value,
        ]
        for shot, joints in shots
    ]
    return csv_text(("name", *axis_columns(axes), "pair", "set"), rows)


def program_text(program: Program) -> str:
    """CSV of the program: a row for each stop; what it is of stands in the first one."""
    task, joints = program.mechanism.task, program.mechanism.joints
    head = ("shot", "set", "pair", *axis_columns(task), *axis_columns(joints), "dwell_s", "program")
    about = printable("; ".join(_heading(program))).encode("ascii", "replace").decode()
    rows: list[list[str]] = []
    for stop in program.stops:
        shot = stop.shot
        told = ("", "passes", "") if shot is None else (str(shot.shot), shot.purpose.value, "")
        if shot is not None and shot.pair is not None:
            told = (*told[:2], str(shot.pair))
        place = zip(task, stop.pose.tolist(), strict=True)
        pose = (_number(axis.to_file(value)) for axis, value in place)
        values = (*pose, *axis_texts(joints, stop.joints.tolist()))
        dwell = number_text(0.0 if shot is None else program.dwell_s)
        rows.append([*told, *values, dwell, "" if rows else about])
    return csv_text(head, rows)


def _heading(program: Program) -> Iterator[str]:
    yield f"pkmcal {VERSION}, csv: {program.stage}"
    yield from program.heading
    yield "poses of the controlled point in the base frame and joints as pkmcal counts them"
    yield (
        f"speed {program.speed_percent:g} %, {program.dwell_s:g} s at each of "
        f"{sum(stop.shot is not None for stop in program.stops)} shots; read it, and run it slowly "
        "first"
    )
