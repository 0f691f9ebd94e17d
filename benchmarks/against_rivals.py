"""How many times as long others take for the same work, compared in one run, taking turns.

python -m benchmarks.against_rivals [--rounds N] [--json]

Against the script that a lab writes (benchmarks/rivals/lab_script.py), against SciPy's
Levenberg-Marquardt by differences on our own batched forward model, and against the package
pybotics on a serial arm. A ratio counts only when both found the same: exit code 1 when they did
not, or when the lab's script takes less than 900 times as long. Without pybotics (it is installed
once, over the network) the others are compared all the same.
"""

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported, here and in pybotics' process: one core each

import numpy as np
from scipy.optimize import least_squares

from benchmarks.rivals import lab_script
from benchmarks.rivals.pybotics_process import RivalMissing, command_line, taking_part
from benchmarks.shared.measured_robot import (
    FREE,
    MeasuredRobot,
    by_distances,
    by_points,
    distance_problem,
    largest_differences,
    measured_robot,
    point_problem,
    printed_parameters,
    with_parameters,
)
from benchmarks.shared.rounds import Contestant, Ratio, Run, contestant, least_s, ratio, take_turns
from campaigns.arrays import Array
from campaigns.estimation.least_squares import Residuals

OURS = "pkmcal"
SCIPY = "SciPy's LM by differences, our batched forward model"
SOLVES = 51
"""Of ours, which are short, in a round."""
SCIPY_SOLVES = 5
COPIES = 400
"""Of the shots, for our forward model to work on in batch."""
UNSEEN_MM = 0.1
"""Of pybotics on points that it never fitted: a calibration that leaves more has failed."""
LEAST_OF_LAB = 900.0


@dataclass(frozen=True, slots=True)
class Apart:
    """The largest difference of two answers, or how large it may be."""

    mm: float
    deg: float

    def __str__(self) -> str:
        return f"{self.mm:.0e} mm, {self.deg:.0e}° apart"

    def within(self, limit: "Apart") -> bool:
        return self.mm <= limit.mm and self.deg <= limit.deg  # NaN is not within


SAME_PARAMETERS = Apart(1e-3, 1e-4)
"""About a hundredth of the standard deviations: what differences leave of the same minimum."""
SAME_POSES = Apart(1e-4, 1e-5)
"""What `fsolve` leaves at its own tolerance."""


@dataclass(frozen=True, slots=True)
class Line:
    """One contestant: its cost, how many times ours that is, and what its answer is worth."""

    name: str
    milliseconds: float
    times: Ratio | None = None
    remark: str = ""
    fault: str = ""
    """Why its ratio is worth nothing, or too low."""


@dataclass(frozen=True, slots=True)
class Contest:
    """The same work by ours and by rivals."""

    title: str
    lines: tuple[Line, ...]

    def faults(self) -> list[str]:
        return [f"{self.title}: {line.name} {line.fault}" for line in self.lines if line.fault]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    robot = measured_robot()
    contests = [hold(robot, asked.rounds) for hold in (poses, distances, points, serial_arm)]
    faults = [fault for contest in contests for fault in contest.faults()]
    if asked.json:
        print(json.dumps({"contests": [asdict(each) for each in contests], "missed": faults}))
    else:
        for contest in contests:
            show(contest)
        for fault in faults:
            print(fault)
    return 1 if faults else 0


def poses(robot: MeasuredRobot, rounds: int) -> Contest:
    """The forward model of the identified robot, from the poses that the nominal one has."""
    geometry, start = with_parameters(robot, by_distances(robot)), robot.commanded
    many, starts = np.tile(robot.joints, (COPIES, 1)), np.tile(start, (COPIES, 1))
    vector, shots = printed_parameters(geometry), list(zip(robot.joints, start, strict=True))
    ours, lab = take_turns(
        [
            contestant(lambda: geometry.forward(many, starts).values_or_raise(), 3, COPIES),
            contestant(lambda: np.array([lab_script.forward(vector, *s) for s in shots]), 3),
        ],
        rounds,
    )
    off = np.abs(lab[-1].answer - ours[-1].answer[: len(shots)]).max(axis=0)
    apart = Apart(float(off[:3].max()), float(np.degrees(off[3])))
    name = "the lab's script: a pose at a time by fsolve"
    return Contest(
        f"forward model, {len(shots)} poses",
        (ours_line(ours), rival_line(name, lab, ours, apart, SAME_POSES)),
    )


def distances(robot: MeasuredRobot, rounds: int) -> Contest:
    vector = printed_parameters(robot.nominal)
    data = robot.joints, robot.commanded, robot.pairs, robot.measured_mm()
    ours, scipy, lab = take_turns(
        [
            contestant(lambda: by_distances(robot), SOLVES),
            contestant(lambda: by_differences(distance_problem(robot)), SCIPY_SOLVES),
            contestant(lambda: lab_script.identify(vector, FREE, *data), 1),
        ],
        rounds,
    )
    return Contest(
        f"identification, {len(robot.pairs)} distances",
        (
            ours_line(ours),
            solver_line(SCIPY, scipy, ours),
            solver_line("the lab's script: fsolve, LM by differences", lab, ours, LEAST_OF_LAB),
        ),
    )


def points(robot: MeasuredRobot, rounds: int) -> Contest:
    ours, scipy = take_turns(
        [
            contestant(lambda: by_points(robot), SOLVES),
            contestant(lambda: by_differences(point_problem(robot)), SCIPY_SOLVES),
        ],
        rounds,
    )
    return Contest(
        f"identification, {len(robot.points_mm)} points",
        (ours_line(ours), solver_line(SCIPY, scipy, ours)),
    )


def by_differences(problem: Residuals) -> Array:
    """The identified parameters, (22,)."""
    found = least_squares(
        problem.residual, problem.start(), jac="2-point", method="lm", x_scale="jac"
    )
    return np.asarray(found.x[: len(FREE)])


def serial_arm(robot: MeasuredRobot, rounds: int) -> Contest:
    """pybotics knows serial arms only: the size is the same, the mechanism is not."""
    title = f"identification, {len(robot.points_mm)} points: ours of Par4, pybotics' of a UR10"
    try:
        with taking_part(command_line()) as pybotics:
            both: list[Contestant[Any]] = [
                contestant(lambda: by_points(robot), SOLVES),
                pybotics,
            ]
            ours, theirs = take_turns(both, rounds)
    except RivalMissing as error:
        return Contest(f"{title}: not compared, {error}", ())
    left_mm = max(run.answer for run in theirs)
    fault = "" if left_mm <= UNSEEN_MM else f"leaves {left_mm:.2g} mm on unseen points: it failed"
    line = Line(
        f"its own recipe ({pybotics.versions})",
        1e3 * least_s(theirs),
        ratio(theirs, ours),
        f"{left_mm:.3f} mm left on unseen points",
        fault,
    )
    return Contest(title, (ours_line(ours), line))


def ours_line(runs: Sequence[Run[Array]]) -> Line:
    return Line(OURS, 1e3 * least_s(runs))


def solver_line(
    name: str, runs: Sequence[Run[Array]], ours: Sequence[Run[Array]], least: float = 0.0
) -> Line:
    """Of an identification."""
    apart = Apart(*largest_differences(runs[-1].answer, ours[-1].answer))
    return rival_line(name, runs, ours, apart, SAME_PARAMETERS, least)


def rival_line(
    name: str,
    runs: Sequence[Run[Array]],
    ours: Sequence[Run[Array]],
    apart: Apart,
    limit: Apart,
    least: float = 0.0,
) -> Line:
    """`limit` is for the answers, `least` for the ratio."""
    times, fault = ratio(runs, ours), ""
    if not apart.within(limit):
        fault = f"found something else, {apart}, limit {limit}: its ratio is worth nothing"
    elif times.median < least:
        fault = f"takes {times.median:.0f} times as long, asked for {least:.0f}"
    return Line(name, 1e3 * least_s(runs), times, str(apart), fault)


def show(contest: Contest) -> None:
    print(f"\n{contest.title}")
    for line in contest.lines:
        print(f"  {line.name:62}{line.milliseconds:>11.3f} ms{said(line)}")


def said(line: Line) -> str:
    if line.times is None:
        return ""
    times = line.times
    rounds = f"({times.lowest:.0f} to {times.highest:.0f})"
    return f"  {times.median:>6.0f} × ours {rounds:16} {line.remark}"


if __name__ == "__main__":
    sys.exit(main())
