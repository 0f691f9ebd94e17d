"""Time and memory of many shots: import, identify and report, each a process of its own.

python -m benchmarks.scale [--shots 10000] [--pkmcal PROGRAM]
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from pkmcal import Kinematics, find_robot, sample_workspace

ROBOT = "par4-prototype"
TRACKER_MM = np.array([2500.0, 0.0, -500.0])
NOISE_MM = 0.01
SPREAD_MM, SPREAD_DEG = 0.5, 0.1
"""1 σ of the true robot's parameters about nominal."""
COMMANDS = (("import", "large", "shots.csv"), ("identify", "large"), ("report", "large"))
KIB, GIB = 1024, 1024**3


def write_shots(path: Path, shots: int, rng: np.random.Generator) -> None:
    """Write shots of a drawn robot all over its workspace, two a pair."""
    robot = find_robot(ROBOT)
    poses = np.resize(sample_workspace(robot, 2000, seed=1), (shots, 4))
    poses = poses + rng.normal(0.0, [5.0, 5.0, 5.0, 0.02], poses.shape)
    joints = robot.kinematics.inverse(poses)
    joints_rad = joints.values[joints.is_solved]
    true = {
        name: value + rng.normal(0.0, SPREAD_MM if name.endswith("_mm") else SPREAD_DEG)
        for name, value in robot.parameters.items()
    }
    reached = Kinematics.of(robot.mechanism, true).forward(joints_rad)
    points = reached.values[reached.is_solved, :3] - TRACKER_MM
    points = points + rng.normal(0.0, NOISE_MM, points.shape)
    rows = np.hstack([np.degrees(joints_rad[reached.is_solved]), points])
    lines = ["pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm"]
    for number, row in enumerate(rows.tolist()):
        lines.append(f"{number // 2}," + ",".join(f"{value:.6f}" for value in row))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def measured(command: tuple[str, ...], folder: str) -> tuple[float, float, float]:
    """Run a command; return its seconds by the clock and of the processor, and its peak, GiB."""
    began_s = time.perf_counter()
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in {0, 1}:  # 1: the robot was not good enough
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    took_s = time.perf_counter() - began_s
    return took_s, used.ru_utime + used.ru_stime, used.ru_maxrss * KIB / GIB


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pkmcal", type=Path, default=Path(sys.executable).with_name("pkmcal"))
    parser.add_argument("--shots", type=int, default=10_000)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        write_shots(Path(temporary) / "shots.csv", asked.shots, np.random.default_rng(1))
        program = str(asked.pkmcal.absolute())
        measured((program, "new", "large", "--offline", "--robot", ROBOT), temporary)
        for words in COMMANDS:
            clock_s, processor_s, gibibytes = measured((program, *words), temporary)
            print(
                f"{words[0]:10}{clock_s:8.1f} s by the clock {processor_s:8.1f} s of the processor "
                f"{gibibytes:6.2f} GiB at most",
                flush=True,
            )
