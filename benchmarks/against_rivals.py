"""How many times as long others take for the same work, compared in one run, taking turns.

python -m benchmarks.against_rivals [--rounds N] [--json]

Against the script that a lab writes (rivals/lab_script.py), SciPy's Levenberg-Marquardt by
differences on our own batched forward model, a C program (rivals/gauss_newton.c) and the package
pybotics on a serial arm. A ratio counts only when both found the same: exit code 1 when they did
not, or when the lab's script takes less than 900 times as long. Without pybotics (installed once,
over the network) or `cc` the others are compared all the same.
"""

import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.rivals import lab_script
from benchmarks.rivals.pybotics_process import CACHE, RivalMissing, command_line, taking_part
from benchmarks.shared.measured_robot import (
    MeasuredRobot,
    by_distances,
    by_points,
    distance_problem,
    measured_robot,
    point_problem,
    position_model,
    printed_parameters,
)
from benchmarks.shared.prototype import FREE_ANGLES, FREE_PLACES, NOMINAL
from benchmarks.shared.rounds import Contestant, Run, contestant, least_s, ratio, take_turns
from benchmarks.shared.yardstick import Figure, Report, Table, main
from campaigns.arrays import AXES, Array, Mask
from campaigns.estimation.least_squares import Residuals
from campaigns.estimation.rigid_transforms import fit_transform

OURS, LAB, SCIPY = "pkmcal", "the lab's script", "SciPy's LM by differences, our forward model"
COMPILED, SOURCE = "C", Path(__file__).parent / "rivals" / "gauss_newton.c"
COLUMNS = ("", "ms", "× ours", "lowest", "highest round")
SOLVES = 51
"""Of ours, which are short, in a round."""
SCIPY_SOLVES = 5
COPIES = 400
"""Of the shots, for our forward model to work on in batch."""
UNSEEN_MM = 0.1
"""Of pybotics on points that it never fitted: a calibration that leaves more has failed."""
LEAST_OF_LAB = 900.0
SAME_PARAMETERS = (1e-3, 1e-4)
"""mm and deg, about a hundredth of the standard deviations: what differences leave of a minimum."""
SAME_MINIMUM = (1e-6, 1e-6)
"""mm and deg, where neither has differences for derivatives."""
SAME_POSES = (1e-4, 1e-5)
"""mm and deg: what `fsolve` leaves at its own tolerance."""

Judge = Callable[[Sequence[Run[Any]], Sequence[Run[Any]]], list[Figure]]
"""What a rival's runs are worth beside ours."""


def measure(rounds: int) -> Report:
    robot = measured_robot()
    contests = [hold(robot, rounds) for hold in (poses, distances, points, serial_arm)]
    return Report(
        [figure for contest in contests for figure in contest.figures],
        [table for contest in contests for table in contest.tables],
    )


def contest(
    title: str,
    contestants: Mapping[str, Contestant[Any]],
    rounds: int,
    judge: Judge,
    least: float = 0.0,
) -> Report:
    """The same work by ours, which comes first, and by rivals; `least` is of the lab's ratio."""
    taken = take_turns(list(contestants.values()), rounds)
    ours, *others = taken
    rows: list[tuple[str | float, ...]] = [(OURS, 1e3 * least_s(ours), 1.0, 1.0, 1.0)]
    figures: list[Figure] = []
    for name, theirs in zip(list(contestants)[1:], others, strict=True):
        times = ratio(theirs, ours)
        rows.append((name, 1e3 * least_s(theirs), *times))
        judged = (same_minimum if name == COMPILED else judge)(theirs, ours)
        if name == LAB and least:
            judged.append(Figure("time", times[0], "× ours", lowest=least))
        figures += [replace(each, name=f"{title}, {name}: {each.name}") for each in judged]
    return Report(figures, [Table(title, COLUMNS, rows)])


def apart(off: Array, is_angle: Mask, limits: tuple[float, float]) -> list[Figure]:
    """Largest differences of two answers: a ratio against another answer is worth nothing."""
    mm, deg = off[~is_angle].max(), np.degrees(off[is_angle].max())
    return [
        Figure("lengths apart", float(mm), "mm", highest=limits[0]),
        Figure("angles apart", float(deg), "°", highest=limits[1]),
    ]


def same_parameters(
    theirs: Sequence[Run[Array]],
    ours: Sequence[Run[Array]],
    limits: tuple[float, float] = SAME_PARAMETERS,
) -> list[Figure]:
    return apart(np.abs(theirs[-1].answer - ours[-1].answer), FREE_ANGLES, limits)


def same_minimum(theirs: Sequence[Run[Array]], ours: Sequence[Run[Array]]) -> list[Figure]:
    """Likewise of one whose derivatives are exact too; it is faster than ours."""
    times, _, _ = ratio(ours, theirs)
    return [*same_parameters(theirs, ours, SAME_MINIMUM), Figure("ours takes", times, "× as long")]


def same_poses(theirs: Sequence[Run[Array]], ours: Sequence[Run[Array]]) -> list[Figure]:
    found = theirs[-1].answer
    off = np.abs(found - ours[-1].answer[: len(found)]).max(axis=0)
    return apart(off, np.arange(4) == len(AXES), SAME_POSES)


def unseen_errors(theirs: Sequence[Run[float]], _ours: Sequence[Run[Array]]) -> list[Figure]:
    left_mm = max(run.answer for run in theirs)
    return [Figure("left on unseen points", left_mm, "mm", highest=UNSEEN_MM)]


def poses(robot: MeasuredRobot, rounds: int) -> Report:
    """The forward model of the identified robot, from the poses that the nominal one has."""
    geometry, start = position_model(robot).kinematics(by_distances(robot)), robot.commanded
    many, starts = np.tile(robot.joints, (COPIES, 1)), np.tile(start, (COPIES, 1))
    vector, shots = printed_parameters(geometry), list(zip(robot.joints, start, strict=True))
    contestants = {
        OURS: contestant(lambda: geometry.forward(many, starts).values_or_raise(), 3, COPIES),
        LAB: contestant(lambda: np.array([lab_script.forward(vector, *s) for s in shots]), 3),
    }
    return contest(f"forward model, {len(shots)} poses", contestants, rounds, same_poses)


def distances(robot: MeasuredRobot, rounds: int) -> Report:
    data = robot.joints, robot.commanded, robot.pairs, robot.measured_mm()
    lab = partial(lab_script.identify, printed_parameters(NOMINAL), FREE_PLACES, *data)
    contestants = {
        OURS: contestant(partial(by_distances, robot), SOLVES),
        SCIPY: contestant(lambda: by_differences(distance_problem(robot)), SCIPY_SOLVES),
        LAB: contestant(lab, 1),
        **compiled("distances", robot),
    }
    title = f"{len(robot.pairs)} distances"
    return contest(title, contestants, rounds, same_parameters, LEAST_OF_LAB)


def points(robot: MeasuredRobot, rounds: int) -> Report:
    contestants = {
        OURS: contestant(partial(by_points, robot), SOLVES),
        SCIPY: contestant(lambda: by_differences(point_problem(robot)), SCIPY_SOLVES),
        **compiled("points", robot),
    }
    return contest(f"{len(robot.points_mm)} points", contestants, rounds, same_parameters)


def by_differences(problem: Residuals) -> Array:
    """The identified parameters, (22,)."""
    found = least_squares(
        problem.residual, problem.start(), jac="2-point", method="lm", x_scale="jac"
    )
    return np.asarray(found.x[: len(FREE_PLACES)])


def compiled(what: str, robot: MeasuredRobot) -> dict[str, Contestant[Array]]:
    """The C program, which takes its own processor time; none where it cannot be built."""
    CACHE.mkdir(exist_ok=True)
    program = CACHE / SOURCE.stem
    try:
        subprocess.run(["cc", "-O3", "-march=native", SOURCE, "-o", program, "-lm"], check=True)
    except (OSError, subprocess.CalledProcessError) as error:
        print(f"{what}: not compared with {COMPILED}: {error}", file=sys.stderr)
        return {}
    problem = problem_of(robot)

    def run() -> Run[Array]:
        command = (program, what, str(SOLVES))
        done = subprocess.run(command, input=problem, capture_output=True, text=True, check=True)
        microseconds, _iterations, *parameters = map(float, done.stdout.split())
        return Run(1e-6 * microseconds, np.array(parameters))

    return {COMPILED: run}


def problem_of(robot: MeasuredRobot) -> str:
    """The problem as gauss_newton.c reads it, a frame to begin with included."""
    shots = np.hstack([robot.joints, robot.commanded, robot.points_mm])
    frame = fit_transform(robot.commanded[:, :3], robot.points_mm)
    sizes, rows = (len(shots), len(FREE_PLACES)), (*frame.rotation.T, frame.translation_mm)
    parts = (sizes, printed_parameters(NOMINAL), FREE_PLACES, np.column_stack(rows), shots)
    return " ".join(repr(number) for part in parts for number in np.ravel(part).tolist())


def serial_arm(robot: MeasuredRobot, rounds: int) -> Report:
    """pybotics knows serial arms only: the size is the same, the mechanism is not."""
    title = f"{len(robot.points_mm)} points, ours of Par4, pybotics' of a UR10"
    ours = contestant(partial(by_points, robot), SOLVES)
    try:
        with taking_part(command_line()) as pybotics:
            title = f"{title} ({pybotics.versions})"
            return contest(title, {OURS: ours, "its recipe": pybotics}, rounds, unseen_errors)
    except RivalMissing as error:
        return Report(tables=[Table(f"{title}: not compared, {error}", COLUMNS[:1], [])])


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, rounds=3))
