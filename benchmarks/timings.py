"""Time what users wait for, a figure a line; one core, but for the dry run.

python -m benchmarks.timings [--pkmcal PROGRAM]
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pkmcal import find_robot, identify, plan, read_shots, sample_workspace, study

SHOTS = Path(__file__).parents[1] / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"
TRACKER_MM = (2500.0, 0.0, -500.0)
REPEATS = 5
POSES = 200_000
STUDIED = 10


def processor_s(work: Callable[[], object]) -> float:
    """Return the median processor time of some repetitions."""
    taken_s = []
    for _ in range(REPEATS):
        began_s = time.process_time()
        work()
        taken_s.append(time.process_time() - began_s)
    return statistics.median(taken_s)


def time_commands(program: Path, folder: str) -> None:
    def run(*words: str) -> None:
        subprocess.run([program, *words], cwd=folder, check=True, capture_output=True)

    began_s = time.perf_counter()
    run("dry-run", "whole", "--scenario", "paper-simulation")
    print(f"dry run               {time.perf_counter() - began_s:10.1f} s by the clock")
    run("new", "series", "--scenario", "paper-simulation")
    run("plan", "series")
    began = os.times()
    run("run", "series", "--yes")
    ended = os.times()
    took_s = ended.children_user - began.children_user
    shots = len((Path(folder) / "series" / "plan.csv").read_text(encoding="utf-8").split()) - 1
    print(f"run, engine and cell  {1e3 * took_s / shots:10.1f} ms a shot")


def time_work() -> None:
    robot = find_robot("par4-prototype")
    shots = read_shots(SHOTS, robot)
    solving_s = processor_s(lambda: identify(shots, robot))
    print(f"identify, 120 shots   {1e3 * solving_s:10.1f} ms")
    planned = plan(robot, TRACKER_MM)
    studying_s = processor_s(lambda: study(robot, planned.shots, TRACKER_MM, campaigns=STUDIED))
    print(f"study, 120 shots      {STUDIED / studying_s:10.1f} campaigns/s")
    planning_s = processor_s(lambda: plan(robot, TRACKER_MM, placement="optimal"))
    print(f"optimal plan, 120     {planning_s:10.1f} s")
    poses = np.resize(sample_workspace(robot, 2000, seed=1), (POSES, 4))
    joints = robot.kinematics.inverse(poses).values_or_raise()
    forward_s = processor_s(lambda: robot.kinematics.forward(joints).values_or_raise())
    print(f"forward model         {POSES / forward_s:10.0f} poses/s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pkmcal", type=Path, default=Path(sys.executable).with_name("pkmcal"))
    with tempfile.TemporaryDirectory() as temporary:
        time_commands(parser.parse_args().pkmcal.absolute(), temporary)
    time_work()
