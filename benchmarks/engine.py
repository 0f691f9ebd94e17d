"""What the run engine costs beside the devices: a plan on devices that take no time.

python -m benchmarks.engine [--shots N] [--json]

The journal is real, on the disk of temporary files (TMPDIR). From one measurement to the next
everything counts that is neither moving, settling nor measuring: path checks, prediction and gate,
running fit, and the journal's commits. Limit: 5 ms a shot; and by processor time the last tenth of
the shots may cost 1.5 times what the first hundred do.
"""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.shared.prototype import CENTRE, FREE, NOMINAL, ROBOT
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.arrays import Array
from campaigns.campaign import now_utc
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.journal.journal import open_journal
from campaigns.measuring.run_state import SILENT
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import Cell, Work
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.planning.plans import PlanRequest, View, joints_of, make_plan
from campaigns.planning.predicted_uncertainty import EstimationSetup
from campaigns.planning.steps import joint_steps
from campaigns.robots.robot import pose_row
from campaigns.settings.config import new_config
from campaigns.settings.sections import SettleConfig
from drivers.ports import LaserTracker, RobotController
from drivers.values import Identity, Measurement, RobotState, Weather

LIMIT_MS = 5.0
FIRST, GROWTH = 100, 1.5
SEED = 1
VIEW = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), float(np.radians(25.0)))
TRACKER_FROM_BASE_MM = (2500.0, 400.0, 300.0)
AIR = Weather(20.0, 1013.25, 50.0)
COVARIANCE_MM2 = ((1e-4, 0.0, 0.0), (0.0, 1e-4, 0.0), (0.0, 0.0, 1e-4))
DEVICE = Identity("none", "instant device", "0", "0", "none")
SETTINGS = {
    "name": "engine",
    "controller": {"url": "sim://none"},
    "tracker": {"url": "sim://none", "reflector": "none"},
}


def measure(shots: int) -> Report:
    with tempfile.TemporaryDirectory() as folder:
        tracker = run(Path(folder), plan_of(shots))
    wall_ms, cpu_ms = 1e3 * np.array(tracker.wall_s), 1e3 * np.array(tracker.cpu_s)
    first, last = cpu_ms[:FIRST].mean(), cpu_ms[-len(cpu_ms) // 10 :].mean()
    return Report(
        [
            Figure("median", float(np.median(wall_ms)), "ms a shot", highest=LIMIT_MS),
            Figure("95th percentile", float(np.percentile(wall_ms, 95)), "ms a shot"),
            Figure("largest", float(wall_ms.max()), "ms a shot"),
            Figure("median of processor time", float(np.median(cpu_ms)), "ms a shot"),
            Figure("processor time, mean of the last tenth", float(last), "ms a shot"),
            Figure("by that of the first hundred", float(last / first), highest=GROWTH),
            Figure("shots", len(wall_ms)),
        ]
    )


def plan_of(shots: int) -> tuple[PlannedShot, ...]:
    """A plan with so many shots to identify from."""
    request = PlanRequest(shots, 2 * (shots // 12), 3 + shots // 200, CENTRE)
    return tuple(make_plan(ROBOT, VIEW, request, np.random.default_rng(SEED)))


def run(
    folder: Path,
    shots: Sequence[PlannedShot],
    tracker_of: "Callable[[Array], InstantTracker] | None" = None,
) -> "InstantTracker":
    """Measure a plan on instant devices; `tracker_of` makes another tracker of its points."""
    clock, robot = HandClock(), InstantRobot(shots[0].joints)
    points = NOMINAL.forward(joints_of(shots)).values_or_raise()[:, :3] + TRACKER_FROM_BASE_MM
    tracker = (tracker_of or InstantTracker)(points)
    # they know only what a run asks of them
    cell = Cell(cast(RobotController, robot), cast(LaserTracker, tracker), clock, clock)
    with open_journal(folder / "campaign.db", now_utc=now_utc, create=True) as journal:
        measure_series(cell, journal, work_of(shots), SILENT, lambda: False)
    return tracker


def work_of(shots: Sequence[PlannedShot]) -> Work:
    return Work(
        stage="run",
        steps=joint_steps(shots),
        plan_digest=plan_digest(shots, ROBOT.mechanism),
        robot_file_digest=ROBOT.digest(),
        configuration={},
        robot=RobotModel(NOMINAL, ROBOT.limits, pose_row(CENTRE)),
        speed_fraction=0.3,
        settle=SettleConfig.model_construct(
            time_s=0.0, still_deg=5e-4, in_place_deg=5e-3, timeout_s=10.0
        ),
        gate=new_config(SETTINGS).gate,
        search_mm=2500.0,
        setup=EstimationSetup(Estimator.POINTS, FREE, TrackerUncertainty()),
    )


class HandClock:
    """Time that passes only when somebody waits."""

    def __init__(self) -> None:
        self._time_s = 0.0

    def now_s(self) -> float:
        return self._time_s

    def sleep_s(self, seconds: float) -> None:
        self._time_s += seconds


@dataclass
class InstantRobot:
    """Is at its target at once."""

    joints: tuple[float, ...]

    def identity(self) -> Identity:
        return DEVICE

    def state(self) -> RobotState:
        return RobotState(self.joints, moving=False, fault="", emergency_stop=False, raw="instant")

    def move_joints(self, joints: Sequence[float], _speed_fraction: float) -> None:
        self.joints = tuple(joints)

    def lacks(self, _names: Sequence[str]) -> tuple[str, ...]:
        return ()


@dataclass
class InstantTracker:
    """Says the next point (3,) at once, and notes how long it has not been asked."""

    points: Array
    wall_s: list[float] = field(default_factory=list)
    """From the end of each measurement to the beginning of the next."""
    cpu_s: list[float] = field(default_factory=list)
    asked: int = 0
    answered: tuple[float, float] | None = None

    def identity(self) -> Identity:
        return DEVICE

    def weather(self) -> Weather:
        return AIR

    def direction(self) -> None:
        """Nobody asks where it looks: its beam never breaks."""

    def measure(self) -> Measurement:
        if self.answered is not None:
            self.wall_s.append(time.perf_counter() - self.answered[0])
            self.cpu_s.append(time.process_time() - self.answered[1])
        x, y, z = self.points[self.asked].tolist()
        measured = Measurement((x, y, z), COVARIANCE_MM2, AIR, "instant")
        self.asked += 1
        self.answered = (time.perf_counter(), time.process_time())
        return measured


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, shots=120))
