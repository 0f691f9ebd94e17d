"""Robot programs: moves to shots in a controller's own language, standing still at each of them.

What each language takes for granted stands in the program's heading, for none of it can be read:
poses are of the controlled point in the base frame, mm and deg, without a tool or a work object.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Literal

from campaigns.arrays import Array
from campaigns.files.csv_file import csv_text, fixed_text, number_text
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.mechanism import Axis
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.shots.columns import axis_columns, axis_texts
from campaigns.version import VERSION
from drivers.bounded_files import is_file
from drivers.texts import printable

Targets = Literal["poses", "joints"]
_number = partial(fixed_text, decimals=6)
JOINT_LETTERS = "XYZABC"
"""Letters of joints in G-code, as LinuxCNC's trivial kinematics has them."""
MINUTE_S = 60.0
HEADING_BYTES = 4000
STILL_MM = 1e-6
DOWN = "the tool's z points down"


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
    joint_speed_rad_s: float
    """Speed of the fastest joint, where a language has no word for a share of the full one."""
    dwell_s: float
    targets: Targets = "poses"

    def values(self, stop: ProgramStop) -> list[float]:
        """Coordinates of a stop as the program gives them, mm and deg."""
        axes, place = (
            (self.mechanism.task, stop.pose)
            if self.targets == "poses"
            else (self.mechanism.joints, stop.joints)
        )
        return [axis.to_file(value) for axis, value in zip(axes, place.tolist(), strict=True)]


@dataclass(frozen=True, slots=True)
class Language:
    """Language of controllers: its file's ending, the program's lines, and what it assumes."""

    suffix: str
    lines: Callable[[Program], Iterator[str]]
    assumes: str
    """Of poses."""
    joints: str
    """Likewise of joints."""
    straight: bool = False
    """Whether a move to a pose goes straight, not by the joints' coordinated way."""


def shot_name(shot: PlannedShot) -> str:
    """Name of a shot's point, for the tracker's software and the joints file."""
    return f"shot{shot.shot}"


def current_program(folder: Path, stage: str, digest: Callable[[], str]) -> str:
    """Language of a stage's program that names this digest in its heading; empty without one."""
    for name, language in LANGUAGES.items():
        path = folder / f"program-{stage}{language.suffix}"
        if is_file(path):
            with path.open("rb") as file:
                if digest().encode() in file.read(HEADING_BYTES):
                    return name
    return ""


def program_of_plan(
    folder: Path, plan: Sequence[PlannedShot] | None, mechanism: ClosedChain
) -> str:
    """Language of the program of plan.csv, as it is now; empty without one."""
    if plan is None:
        return ""
    return current_program(folder, "run", lambda: plan_digest(plan, mechanism))


def joints_text(program: Program) -> str:
    """File of the joints that each shot is commanded with, for `import --format ascii`."""
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


def _heading(program: Program, language: str) -> Iterator[str]:
    """Lines that say what it is of, in the few characters that every controller takes."""
    for line in _about(program, language):
        yield printable(line).encode("ascii", "replace").decode()


def _about(program: Program, language: str) -> Iterator[str]:
    own = LANGUAGES[language]
    yield f"pkmcal {VERSION}, {language}: {program.stage}"
    yield from program.heading
    yield own.assumes if program.targets == "poses" else own.joints
    yield (
        f"speed {program.speed_percent:g} %, {program.dwell_s:g} s at each of "
        f"{sum(stop.shot is not None for stop in program.stops)} shots; read it, and run it slowly "
        "first"
    )


def _said(shot: PlannedShot) -> str:
    pair = "" if shot.pair is None else f" pair {shot.pair}"
    return f"{shot_name(shot)} {shot.purpose.value}{pair}"


def _numbers(values: Sequence[float]) -> str:
    return ",".join(map(_number, values))


def _moves(
    program: Program, move: Callable[[Sequence[float]], str], dwell: Sequence[str], comment: str
) -> Iterator[str]:
    """Lines of all stops."""
    for stop in program.stops:
        if stop.shot is None:
            yield f"{move(program.values(stop))} {comment} passes"
        else:
            yield f"{move(program.values(stop))} {comment} {_said(stop.shot)}"
            yield from dwell


def _turn_of(values: Sequence[float]) -> float:
    """Turn of a pose, deg; 0 of a plate that does not turn."""
    return values[3] if len(values) > 3 else 0.0


def _gcode(program: Program) -> Iterator[str]:
    from campaigns.controllers.gcode_moves import ROTARY, axis_letters

    task, joints = program.mechanism.task, program.mechanism.joints
    poses = program.targets == "poses"
    letters = axis_letters(task, ROTARY) if poses else tuple(JOINT_LETTERS[: len(joints)])

    yield from (f"; {line}" for line in _heading(program, "gcode"))
    yield "G21 G90 G94 G17 G61"
    before: ProgramStop | None = None
    for stop in program.stops:
        place = program.values(stop)
        words = " ".join(f"{a}{_number(v)}" for a, v in zip(letters, place, strict=True))
        feed = _feed(program, before, stop, task if poses else joints)
        said = "passes" if stop.shot is None else _said(stop.shot)
        yield f"G1 {words} F{feed:.3f} ; {said}"
        if stop.shot is not None:
            yield f"G4 P{program.dwell_s:g}"
        before = stop
    yield "M2"


def _feed(
    program: Program, before: ProgramStop | None, stop: ProgramStop, axes: Sequence[Axis]
) -> float:
    """Feed in mm/min, or deg/min where only angles change, at which the fastest joint is as asked.

    The first move, from nobody knows where, has that of a joint's 300 mm.
    """
    speed = program.joint_speed_rad_s
    scale = [axis.scale for axis in program.mechanism.joints]
    if before is None:
        return speed * 300.0 * MINUTE_S
    turn = float((abs(stop.joints - before.joints) / scale).max())
    ends = zip(program.values(before), program.values(stop), axes, strict=True)
    mm, deg = [0.0], [0.0]
    for old, new, axis in ends:
        (deg if axis.is_revolute else mm).append(new - old)
    way = math.hypot(*mm) if math.hypot(*mm) > STILL_MM else math.hypot(*deg)
    return max(1.0, way / max(turn / speed, 1e-3) * MINUTE_S)


def _rapid(program: Program) -> Iterator[str]:
    unused = ",".join(["9E9"] * 6)

    def move(values: Sequence[float]) -> str:
        if program.targets == "joints":
            padded = _numbers([*values, *[0.0] * (6 - len(values))])
            return f"    MoveAbsJ [[{padded}],[{unused}]],vmax,fine,tool0;"
        half = math.radians(_turn_of(values)) / 2.0
        turned = f"0,{math.cos(half):.9f},{math.sin(half):.9f},0"
        target = f"[[{_numbers(values[:3])}],[{turned}],[0,0,0,0],[{unused}]]"
        return f"    MoveJ {target},vmax,fine,tool0\\WObj:=wobj0;"

    name = program.stage.title()
    yield f"MODULE Pkmcal{name}"
    yield from (f"  ! {line}" for line in _heading(program, "rapid"))
    yield f"  PROC pkmcal_{program.stage}()"
    yield "    ConfJ \\Off;"
    yield f"    VelSet {program.speed_percent:g}, 5000;"
    yield from _moves(program, move, [f"    WaitTime \\InPos, {program.dwell_s:g};"], "!")
    yield "  ENDPROC"
    yield "ENDMODULE"


def _krl(program: Program) -> Iterator[str]:
    def move(values: Sequence[float]) -> str:
        if program.targets == "joints":
            own = (f"A{place} {_number(v)}" for place, v in enumerate(values, start=1))
            return f"PTP {{{', '.join(own)}}}"
        each = zip("XYZA", (*values[:3], _turn_of(values)), strict=True)
        return f"PTP {{{', '.join(f'{a} {_number(v)}' for a, v in each)}, B 0, C 180}}"

    yield "&ACCESS RVP"
    yield f"DEF pkmcal_{program.stage}()"
    yield from (f"; {line}" for line in _heading(program, "krl"))
    yield "BAS(#INITMOV, 0)"
    yield "BAS(#BASE, 0)"
    yield "BAS(#TOOL, 0)"
    yield f"BAS(#VEL_PTP, {program.speed_percent:g})"
    yield "PTP $AXIS_ACT"
    yield from _moves(program, move, [f"WAIT SEC {program.dwell_s:g}"], ";")
    yield "END"


def _vplus(program: Program) -> Iterator[str]:
    def move(values: Sequence[float]) -> str:
        if program.targets == "joints":
            return f"  MOVE #PPOINT({_numbers(values)})"
        return f"  MOVE TRANS({_numbers(values[:3])},0,180,{_number(-_turn_of(values))})"

    yield f".PROGRAM pkm_{program.stage}()"
    yield from (f"  ; {line}" for line in _heading(program, "vplus"))
    yield "  TOOL NULL"
    yield f"  SPEED {program.speed_percent:g} ALWAYS"
    yield from _moves(program, move, ["  BREAK", f"  DELAY {program.dwell_s:g}"], ";")
    yield ".END"


def _csv(program: Program) -> Iterator[str]:
    task, joints = program.mechanism.task, program.mechanism.joints
    head = ("shot", "set", "pair", *axis_columns(task), *axis_columns(joints), "dwell_s", "program")
    about = "; ".join(_heading(program, "csv"))
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
    yield from csv_text(head, rows).splitlines()


LANGUAGES: Mapping[str, Language] = {
    "gcode": Language(
        ".ngc",
        _gcode,
        "X Y Z in mm and C, the turn, in deg, in the base frame, offsets 0; G4 P in s (LinuxCNC)",
        "joints in deg or mm on X Y Z A, as LinuxCNC's trivial kinematics has them; G4 P in s",
        straight=True,
    ),
    "rapid": Language(
        ".mod",
        _rapid,
        f"robtargets in mm in wobj0, of tool0, {DOWN}: [0,1,0,0] at turn 0 (IRB 360)",
        "jointtargets in deg (mm), arm 0 as axis 1; parallel robots mostly take robtargets",
    ),
    "krl": Language(
        ".src",
        _krl,
        f"X Y Z in mm in the robot's root frame, A the turn in deg, {DOWN} (B 0, C 180)",
        "A1, A2, ... in deg (mm), arm 0 as A1",
    ),
    "vplus": Language(
        ".v2",
        _vplus,
        f"transformations in mm in the world frame, {DOWN} (pitch 180), roll the turn's negative",
        "precision points in deg (mm), arm 0 as joint 1",
    ),
    "csv": Language(
        ".csv",
        _csv,
        "poses of the controlled point in the base frame and joints as pkmcal counts them",
        "poses of the controlled point in the base frame and joints as pkmcal counts them",
    ),
}
