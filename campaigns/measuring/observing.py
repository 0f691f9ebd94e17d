"""Observing: the robot goes to the poses of observations, and somebody reads a value at each.

Heights of a bed, distances by callipers or poses of a probe are planned as rows without a value.
For each of them the robot takes a checked way to its joints and settles, as for a shot; then the
instrument is read, by a person who types what it shows, or in the simulated cell. The joints are
those that were read when the robot stood still. Each value is kept, durably, before the robot moves
again. A value is not judged here: `identify` compares all of them with each other.

An observation of two poses, such as a distance on a part, is read at the second one; at the first
the operator marks the place.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import degrees, radians

import numpy as np

from campaigns.errors import InstrumentMissing, TargetOutOfReach
from campaigns.fit.kinds import KINDS
from campaigns.kinematics.axes import Axis
from campaigns.measuring.instruments import Task
from campaigns.measuring.motion import Arrival, Mover
from campaigns.measuring.run_state import EngineState, RunObserver, RunState, Wish, Wishes
from campaigns.measuring.stopping import stopping_robot
from campaigns.measuring.work import Devices
from campaigns.planning.paths import RobotModel
from campaigns.settings.sections import SettleConfig
from campaigns.shots.observation_records import PlannedRow
from campaigns.shots.observations_csv import ObservationRow
from drivers.errors import LimitViolation
from drivers.values import NoValue


@dataclass(frozen=True, slots=True, eq=False)
class ObservationWork:
    """Observations to make, and the rules for them."""

    planned: tuple[PlannedRow, ...]
    robot: RobotModel
    speed_fraction: float
    settle: SettleConfig
    keep: Callable[[PlannedRow, ObservationRow], None]
    """Keeps a measured row in the place of a planned one, durably."""
    now_utc: Callable[[], str]


@dataclass(frozen=True, slots=True)
class ObservationResult:
    """Result of a run of observations."""

    measured: int
    skipped: tuple[str, ...] = ()
    """Observations that have no value, each with the reason."""


class Observing:
    """One session of observations."""

    def __init__(
        self, cell: Devices, work: ObservationWork, observer: RunObserver, wishes: Wishes
    ) -> None:
        """Raise `InstrumentMissing` for a cell without an instrument."""
        if cell.instrument is None:
            raise InstrumentMissing(
                f"{len(work.planned)} observations wait for somebody who reads their instruments",
                remedy="run it on a terminal",
            )
        self._instrument = cell.instrument
        self._cell, self._work, self._wishes, self._observer = cell, work, wishes, observer
        self._run_state = RunState(observer, done=0, total=len(work.planned), counted="observation")
        self._mover = Mover(
            cell.robot, cell.clock, work.speed_fraction, work.settle, work.robot,
            wishes.stop_requested,
        )  # fmt: skip

    def run(self) -> ObservationResult:
        """Read all planned observations in their order.

        Raise the error that ended the run, once the robot has been stopped.
        """
        planned, place = self._work.planned, 0
        reasons: dict[int, str] = {}
        with stopping_robot(self._cell.robot, self._run_state):
            while place < len(planned):
                reason = self._observe(place)
                if reason is NoValue.BACK:
                    place = max(place - 1, 0)
                    continue
                reasons.pop(place, None)
                if reason:
                    reasons[place] = f"{_name(planned[place].row)}: {reason}"
                    self._observer.event(f"not measured: {reasons[place]}")
                place += 1
            self._run_state.enter(EngineState.FINISHED)
        return ObservationResult(len(planned) - len(reasons), tuple(reasons.values()))

    def _observe(self, place: int) -> str | NoValue:
        """Measure one observation and keep it; return why it has no value, "" if it has one."""
        planned = self._work.planned[place]
        row = planned.row
        self._run_state.begin_observation(place + 1, row.kind, row.object)
        joints: list[tuple[float, ...]] = []
        values: tuple[float, ...] = ()
        for pose, target in enumerate(row.joints, start=1):
            read = self._read(row, pose, target)
            if not isinstance(read, tuple):
                return read
            at, values = read
            joints.append(at)
        measured = replace(
            row, joints=tuple(joints), values=_inner(row, values), time=self._work.now_utc()
        )
        self._work.keep(planned, measured)
        self._run_state.accept_observation(place + 1)
        return ""

    def _read(
        self, row: ObservationRow, pose: int, target: tuple[float, ...]
    ) -> tuple[tuple[float, ...], tuple[float, ...]] | str | NoValue:
        """Go to a pose and read the instrument; return joints and values, or why there are none."""
        try:
            arrival = self._mover.return_to(target, f"to {_name(row)}", self._run_state.enter)
        except (LimitViolation, TargetOutOfReach) as error:
            self._run_state.show_idle()
            return error.problem
        if self._wishes.take(Wish.SKIP):
            return NoValue.SKIPPED.value
        self._run_state.enter(EngineState.MEASURING)
        answer = self._instrument(self._task(row, pose, arrival))
        self._mover.check_stop()  # the question may have been answered by Ctrl-C
        if isinstance(answer, NoValue):
            return answer if answer is NoValue.BACK else str(answer.value)
        if self._mover.has_moved(arrival.state):
            return "the robot moved while it was measured"
        return arrival.state.joints, answer

    def _task(self, row: ObservationRow, pose: int, arrival: Arrival) -> Task:
        columns = KINDS[row.kind].columns if pose == len(row.joints) else ()
        model = self._work.robot.kinematics.controlled
        at = model.forward(np.array([arrival.state.joints])).values[0]
        place = _pose_text(model.mechanism.task, at.tolist())
        poses = len(row.joints)
        return Task(row.kind, row.object, columns, pose, poses, place, row.std_mm)


def _name(row: ObservationRow) -> str:
    """Name an observation by its kind, its object and its line in the file."""
    return f"{row.kind} of {row.object}, line {row.line}"


def _pose_text(axes: Sequence[Axis], pose: Sequence[float]) -> str:
    """Return a pose in words: `x 12.00 y -3.50 z -600.00 mm`."""
    lengths = [
        f"{axis.name} {value:.2f}"
        for axis, value in zip(axes, pose, strict=True)
        if not (axis.is_revolute or axis.is_fixed)
    ]
    turns = [
        f"{axis.name} {degrees(value):.2f}"
        for axis, value in zip(axes, pose, strict=True)
        if axis.is_revolute
    ]
    return f"{' '.join(lengths)} mm{' ' + ' '.join(turns) + ' deg' if turns else ''}"


def _inner(row: ObservationRow, answer: Sequence[float]) -> tuple[float, ...]:
    """Return values in mm and rad from those in the units of the kind's columns."""
    marked = zip(KINDS[row.kind].angles, answer, strict=True)
    return tuple(radians(value) if is_angle else value for is_angle, value in marked)
