"""Carries a series through: begins or resumes it, measures what is missing, and closes it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pydantic import JsonValue

from campaigns.engine import Engine, Watches
from campaigns.guards import AirWatch, DriftWatch, Gate
from campaigns.journal import Journal
from campaigns.journal_reader import JournalReader
from campaigns.journal_views import Series
from campaigns.motion import Mover
from campaigns.numerics.geometry import FREE_BY_DEFAULT
from campaigns.numerics.running import RunningFit
from campaigns.progress import Watcher
from campaigns.records import Event, SeriesFinished, SeriesStarted, SessionStarted, Stage
from campaigns.resuming import Remains, check_same, how_it_stopped, remains
from campaigns.rules import GateRules, MotionRules
from campaigns.series_log import SeriesLog, closing
from campaigns.shooting import Cell, Shooter
from campaigns.steps import Step, stops_of
from campaigns.tally import Tally
from campaigns.version import VERSION
from campaigns.ways import KnownWays, Mechanism
from drivers.values import Weather


@dataclass(frozen=True, slots=True, eq=False)
class Work:
    """What is to be measured, and by which rules."""

    stage: Stage
    steps: tuple[Step, ...]
    plan_digest: str
    robot_file_digest: str
    configuration: Mapping[str, JsonValue]
    mechanism: Mechanism
    motion: MotionRules
    gate: GateRules


def measure_series(
    cell: Cell,
    journal: Journal,
    work: Work,
    watcher: Watcher,
    stop_requested: Callable[[], bool],
    *,
    anew: bool = False,
) -> int:
    """Measure what the latest series of this stage still lacks, or a new one; gives its number.

    `anew` leaves an unfinished series as it is and begins another. Raises `ResumeRefused` when plan
    or devices are not those it began with, `Interrupted`, or whatever stopped the engine.
    """
    today = _start_record(cell, work)
    found = None if anew else _unfinished(journal, work)
    if found is not None:
        check_same(found, today)
    series = found.number if found else journal.start_series(today)
    log = SeriesLog(journal, series)
    resumed = how_it_stopped(journal, series) if found else ""
    log.write(SessionStarted(VERSION, today.robot, today.tracker, today.weather))
    with closing(log):
        if resumed:
            log.write(Event("resumed", f"{work.stage} goes on after {resumed}"))
        left = remains(work.steps, journal.shots(series))
        began = found.started if found else today
        _Run(cell, log, work, watcher, stop_requested).measure(left, began.weather)
        log.write(SeriesFinished())
    return series


@dataclass(frozen=True, slots=True, eq=False)
class _Run:
    """One session's work on a series."""

    cell: Cell
    log: SeriesLog
    work: Work
    watcher: Watcher
    stop_requested: Callable[[], bool]

    def measure(self, found: Remains, first_weather: Weather | None) -> None:
        """Void what was cut in two, look whether anything has shifted, then measure the rest."""
        for half in found.halves:
            self.log.write(half)
        engine = self._engine(found, first_weather)
        reference = found.reference(self.work.steps)
        if reference is not None and found.left:
            engine.check_place(*reference)
        engine.run(found.left)

    def _engine(self, found: Remains, first_weather: Weather | None) -> Engine:
        cell, work = self.cell, self.work
        gate = Gate(work.gate, lambda: RunningFit(work.mechanism.geometry, FREE_BY_DEFAULT))
        for shot in found.kept:
            gate.accept(shot.outcome)
        tally = Tally(self.watcher, done=len(found.kept), total=len(work.steps))
        ways = KnownWays(work.mechanism, stops_of(found.left))
        mover = Mover(cell.robot, cell.clock, work.motion, ways, self.stop_requested)
        shooter = Shooter(cell, self.log, mover, gate, tally, work.gate.search_mm)
        watches = Watches(
            gate,
            DriftWatch(work.gate.drift_mm, found.first_drift_mm()),
            AirWatch(work.gate.temperature_change_degC, first_weather),
            work.gate.attempts,
        )
        return Engine(cell, self.log, shooter, watches, tally)


def nothing_left(journal: JournalReader, work: Work) -> Series | None:
    """The latest series of this stage if it is finished and measured this very plan."""
    latest = journal.latest_series(work.stage)
    done = latest and latest.finished and latest.started.plan_digest == work.plan_digest
    return latest if done else None


def _unfinished(journal: Journal, work: Work) -> Series | None:
    """The series to take up, if there is one."""
    latest = journal.latest_series(work.stage)
    return None if latest is None or latest.finished else latest


def _start_record(cell: Cell, work: Work) -> SeriesStarted:
    """What a series that begins now would begin with: asks both devices who they are."""
    return SeriesStarted(
        work.stage,
        work.plan_digest,
        work.configuration,
        VERSION,
        work.robot_file_digest,
        cell.robot.identity(),
        cell.tracker.identity(),
        cell.tracker.weather(),
    )
