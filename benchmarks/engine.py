"""What the run engine costs beside the devices: a default plan on devices that take no time.

The journal is real, on the disk of --folder. From one measurement to the next everything counts
that is neither moving, settling nor measuring: path checks, prediction and gate, running fit, and
the journal's commits. Limit: 5 ms a shot.

python -m benchmarks.engine [--json] [--folder DIR]
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import cast

import numpy as np

from campaigns.estimation.estimators import Estimator
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.journal.journal import open_journal
from campaigns.measuring.rules import GateRules, MotionRules
from campaigns.measuring.run_state import Progress
from campaigns.measuring.session import Work, measure_series
from campaigns.measuring.shot_taker import Cell
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.planning.predicted_precision import EstimationSetup
from campaigns.planning.steps import joint_steps
from campaigns.robots.robot import find_robot, pose_row
from campaigns.settings.sections import GateConfig
from drivers.ports import LaserTracker, RobotController
from drivers.values import Identity, Measurement, Pose, RobotState, Vector3, Weather

LIMIT_MS = 5.0
SEED = 1
CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
VIEW = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), float(np.radians(25.0)))
AIR = Weather(20.0, 1013.25, 50.0)
COVARIANCE_MM2 = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))


def main(words: Sequence[str]) -> int:
    """Print the figures beside their limit; 1 when the median misses it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    parser.add_argument("--folder", type=Path, help="where the journal is written; default: /tmp")
    arguments = parser.parse_args(words)
    with tempfile.TemporaryDirectory(dir=arguments.folder) as folder:
        found = run(Path(folder))
    return report(found, as_json=arguments.json)


def report(found: "Overheads", *, as_json: bool) -> int:
    """Print; 1 when the median misses its limit."""
    wall_ms = 1e3 * np.array(found.wall_s)
    median_ms = float(np.median(wall_ms))
    figures = {
        "shots": len(wall_ms),
        "median_ms": round(median_ms, 3),
        "p95_ms": round(float(np.percentile(wall_ms, 95)), 3),
        "max_ms": round(float(wall_ms.max()), 3),
        "median_cpu_ms": round(1e3 * float(np.median(found.cpu_s)), 3),
        "limit_ms": LIMIT_MS,
    }
    good = median_ms <= LIMIT_MS
    if as_json:
        print(json.dumps(figures | {"good": good}))
    else:
        print("engine overhead a shot:", ", ".join(f"{n} {v}" for n, v in figures.items()))
    return 0 if good else 1


def run(folder: Path) -> "Overheads":
    """Measure a default plan on instant devices."""
    robot = find_robot("par4-prototype").robot
    shots = make_plan(robot, VIEW, PlanRequest(120, 20, 3, CENTRE), np.random.default_rng(SEED))
    clock = InstantClock()
    controller = InstantRobot(shots[0].joints)
    tracker = InstantTracker(seen_points(robot.kinematics, shots))
    # they know only what a run asks of them
    cell = Cell(cast(RobotController, controller), cast(LaserTracker, tracker), clock, clock)
    with open_journal(folder / "campaign.db", now_utc=now_utc, create=True) as journal:
        measure_series(cell, journal, work_of(shots), Nobody(), lambda: False)
    return tracker.between


def work_of(shots: Sequence[PlannedShot]) -> Work:
    robot, gate = find_robot("par4-prototype").robot, GateConfig()
    return Work(
        stage="run",
        steps=joint_steps(shots),
        plan_digest=plan_digest(shots, robot.mechanism),
        robot_file_digest=robot.digest(),
        configuration={},
        robot=RobotModel(robot.kinematics, robot.limits, pose_row(CENTRE)),
        motion=MotionRules(0.3, settle_s=0.0, still_rad=1e-5, in_place_rad=1e-4, timeout_s=10.0),
        gate=GateRules(
            gate.distance_mm,
            gate.fitted_mm,
            gate.temperature_change_degC,
            gate.drift_mm,
            gate.attempts,
            search_mm=2500.0,
        ),
        setup=EstimationSetup(
            Estimator.POINTS, robot.mechanism.parameters.free_by_default, TrackerUncertainty()
        ),
    )


def seen_points(geometry: Kinematics, shots: Sequence[PlannedShot]) -> list[Vector3]:
    """What a perfect tracker sees in the plan's order, worked out beforehand."""
    joints = np.array([shot.joints for shot in shots])
    points = geometry.forward(joints).values_or_raise()[:, :3] + (2500.0, 400.0, 300.0)
    return [(float(x), float(y), float(z)) for x, y, z in points]


def now_utc() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class Nobody:
    """Watches nothing."""

    def progress(self, progress: Progress) -> None:
        pass

    def event(self, text: str) -> None:
        pass


@dataclass
class InstantClock:
    """Time in which waiting takes none."""

    seconds: float = 0.0

    def now_s(self) -> float:
        return self.seconds

    def sleep_s(self, seconds: float) -> None:
        self.seconds += seconds


@dataclass
class InstantRobot:
    """Is at its target at once."""

    joints: tuple[float, ...]

    def identity(self) -> Identity:
        return Identity("none", "instant robot", "0", "0", "none")

    def state(self) -> RobotState:
        return RobotState(self.joints, moving=False, fault="", emergency_stop=False, raw="instant")

    def move_joints(self, joints: Sequence[float], _speed_fraction: float) -> None:
        self.joints = tuple(joints)


@dataclass
class Overheads:
    """Seconds from the end of each measurement to the beginning of the next."""

    wall_s: list[float] = field(default_factory=list)
    cpu_s: list[float] = field(default_factory=list)


@dataclass
class InstantTracker:
    """Says the next point at once, and notes how long it has not been asked."""

    points: list[Vector3]
    between: Overheads = field(default_factory=Overheads)
    asked: int = 0
    answered: tuple[float, float] | None = None

    def identity(self) -> Identity:
        return Identity("none", "instant tracker", "0", "0", "none")

    def weather(self) -> Weather:
        return AIR

    def measure(self) -> Measurement:
        if self.answered is not None:
            self.between.wall_s.append(time.perf_counter() - self.answered[0])
            self.between.cpu_s.append(time.process_time() - self.answered[1])
        measured = Measurement(self.points[self.asked], COVARIANCE_MM2, AIR, "instant")
        self.asked += 1
        self.answered = (time.perf_counter(), time.process_time())
        return measured


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
