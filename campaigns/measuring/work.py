"""Work of a session: the steps to measure and their rules, and what all parts of a run share.

`Devices` is the outside (devices, time, operator), `Work` the task, which is fixed before the run
with the `Rules` of the campaign, and `Session` all of it together with the state that changes while
it is carried out.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from pydantic import JsonValue

from campaigns.fit.error_model import ErrorModel
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.fit.fit import Fit
from campaigns.identification.objects import Object
from campaigns.identification.options import IdentificationOptions
from campaigns.journal.records import Outcome, Stage
from campaigns.journal.views import AcceptedShot
from campaigns.measuring.gate import Gate
from campaigns.measuring.instruments import Instrument
from campaigns.measuring.monitors import Station
from campaigns.measuring.motion import Mover
from campaigns.measuring.reference_poses import ReferenceNoise
from campaigns.measuring.run_state import PositionUncertainty, RunState, Wishes
from campaigns.measuring.series_log import SeriesLog
from campaigns.measuring.uncertainty_monitor import UncertaintyMonitor
from campaigns.planning.paths import RobotModel
from campaigns.planning.steps import Group, Step, groups, shots_of
from campaigns.settings.sections import GateConfig, NestConfig, SettleConfig
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import ImplausibleAnswer
from drivers.ports import Clock, LaserTracker, RobotController
from drivers.values import Matrix3, Vector3

UNKNOWN_NOISE = 0.25
"""Standard deviation, in parts of the limit of drift, of a robot with too few shots to fit it."""
FEWEST_FREEDOM = 6.0
"""Least degrees of freedom of a fit whose estimate of the robot's scatter is used."""
UNATTENDED_BEAM_WAIT_S = 600.0


@dataclass(frozen=True, slots=True)
class RawReaders:
    """Readers of the devices' raw answers, which check the values that are recorded with them.

    They raise `DriverError`.
    """

    joints: Callable[[str], tuple[float, ...]]
    """Joints of a state's answer, rad or mm."""
    point: Callable[[str], tuple[Vector3, Matrix3 | None]]
    """Point of a measurement's answer, mm, and its covariance, mm²; None where it states none."""

    def check(self, outcome: Outcome) -> None:
        """Raise `ImplausibleAnswer` if a shot's values are not those of its raw answers."""
        # A mistake in a driver (a unit, an order of axes, an answer to an earlier question) would
        # spoil all shots alike, and a fit would explain much of it. So each answer is decoded a
        # second time, from the text that the journal keeps.
        point_mm, covariance_mm2 = self.point(outcome.raw_tracker)
        compared: list[tuple[str, object, object]] = [
            ("joints", outcome.joints, self.joints(outcome.raw_robot)),
            ("point_mm", outcome.point_in_tracker_mm, point_mm),
        ]
        if covariance_mm2 is not None:
            compared.append(("covariance_mm2", outcome.covariance_mm2 or (), covariance_mm2))
        for name, recorded, raw_value in compared:
            values, raw = np.array(recorded), np.array(raw_value)
            # Equal except for rounding: units are converted in two ways.
            if values.shape != raw.shape or not np.allclose(values, raw, rtol=1e-12, atol=1e-15):
                raise ImplausibleAnswer(
                    f"shot {outcome.shot}: {name} {recorded}, but the raw answer says {raw_value}",
                    remedy="report it with this line: the software misreads the device",
                )


@dataclass(frozen=True, slots=True)
class Devices:
    """The devices of one cell, and its time."""

    robot: RobotController
    tracker: LaserTracker
    clock: Clock
    """Time of the cell, simulated or real: settling and deadlines of motions."""
    wall_clock: Clock
    """Time of the operator: how long a shot takes, and when the run will end."""
    raw_readers: RawReaders | None = None
    ask: Callable[[str], bool] = lambda _: False
    """Function that shows the operator a task, and returns whether he confirms that it is done."""
    carry: Callable[[str], None] | None = None
    """Function that carries the reflector of a simulated cell to an object; None: somebody does."""
    instrument: Instrument | None = None
    """Instrument for observations, read by a person or simulated; None: no one is there to read."""
    beam_wait_s: float = UNATTENDED_BEAM_WAIT_S
    """Longest wait for a broken beam; infinite where an operator is there to place it."""

    def carries(self, reflector: str, task: str) -> bool:
        """Have the reflector carried to an object, "" to its own place; return whether it is done.

        `task` says it to the operator.
        """
        if self.carry is not None:
            self.carry(reflector)
            return True
        return self.ask(f"the robot stands still: {task}, and stand clear. Done?")


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Rules:
    """Rules of a campaign's settings, by which all of its work is measured."""

    speed_fraction: float
    settle: SettleConfig
    gate: GateConfig
    search_mm: float
    """Distance from the tracker of a search while the place of the robot's reflector is unknown."""
    options: IdentificationOptions
    """Options of the identification, by which the uncertainty is computed."""
    look_back_s: float = 60.0
    """Longest wait for a reflector at a pose where it was never seen."""
    station: Station | None = None
    """Place of the tracker by campaign.yaml; None: it is not given."""
    park: tuple[float, ...] = ()
    """Joints where the robot is parked; (): the first drift pose, or where the robot stands."""
    nests: tuple[NestConfig, ...] = ()
    carriers: Mapping[str, Object] = field(default_factory=dict)
    """Objects that carry reflectors elsewhere on the platform, by name."""
    reflector: str = ""
    """Robot's reflector, by its name in the tracker."""
    measuring_time_s: float = 1.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Work:
    """Work of a session: the steps to measure, and what is asked of this time."""

    stage: Stage
    steps: tuple[Step, ...]
    plan_digest: str
    robot_file_digest: str
    configuration: Mapping[str, JsonValue]
    robot: RobotModel
    rules: Rules
    goal_mm: float | None = None
    """Mean 1 σ of positions that ends the identification shots; None: all are measured."""
    skip: frozenset[int] = frozenset()
    """Shots that shall not be measured, nor the other shots of their pairs."""
    override: bool = False
    """Whether to go on although poses have moved since the last session."""
    ends_at: tuple[float, ...] = ()
    """Joints where the robot is left at the end; (): where the last shot was taken."""
    compared_at_end: bool = False
    """Whether spread poses are measured again at the end of a series that nothing interrupted."""

    @property
    def park_joints(self) -> tuple[float, ...] | None:
        """Joints where the robot is parked; None: it stays where it stands."""
        drift = (s.planned.joints for s in self.steps if s.planned.purpose is ShotSet.DRIFT)
        return self.rules.park or next(drift, None)

    @property
    def skipped_groups(self) -> tuple[Group, ...]:
        """Groups with a shot that shall not be measured."""
        return tuple(group for group in groups(self.steps) if self.skip & set(shots_of(group)))

    @cached_property
    def uncertainty_monitor(self) -> UncertaintyMonitor:
        """Monitor of the uncertainty of positions by shots of this plan."""
        shots = [step.planned for step in self.steps]
        return UncertaintyMonitor(shots, self.robot, self.rules.options)

    def uncertainty_from(self, shots: Iterable[AcceptedShot]) -> PositionUncertainty | None:
        """Fit the accepted shots of a series; return their uncertainty, None for too few."""
        return self.uncertainty_monitor.fitted(shot.outcome for shot in shots)

    def noise_by(self, posterior: Fit | None) -> ReferenceNoise:
        """Return the noise of poses measured twice: the tracker's, and the robot's own scatter.

        With too few shots to estimate the scatter, it is taken for a quarter of the limit of drift.
        """
        instrument = self.rules.options.instrument
        freedom = 0.0 if posterior is None else posterior.freedom
        if posterior is None or freedom < FEWEST_FREEDOM:
            limit_mm = self.rules.gate.drift_mm
            return ReferenceNoise(instrument, UNKNOWN_NOISE * limit_mm, limit_mm=limit_mm)
        point_mm, joint = posterior.scatter
        return ReferenceNoise(instrument, point_mm, joint, freedom, self.rules.gate.drift_mm)

    def gate_after(self, shots: Iterable[AcceptedShot]) -> Gate:
        """Return a gate that rests on these shots alone, with all errors of the robot free."""
        # Errors of the tracker are held at zero: they are far below the limits. Shots of nests have
        # no part in it: they do not measure the robot.
        model = ErrorModel(
            self.robot.kinematics, TRACKER_SOURCES, group_tolerances=self.rules.options.tolerances
        )
        accepted = [shot.outcome for shot in shots if not shot.intent.nest]
        return Gate(
            model, self.rules.options.instrument, self.rules.gate, accepted, self.rules.carriers
        )


@dataclass(frozen=True, slots=True, eq=False)
class Session:
    """Cell, work and state that all parts of one session share."""

    cell: Devices
    work: Work
    log: SeriesLog
    run_state: RunState
    gate: Gate
    mover: Mover
    wishes: Wishes
