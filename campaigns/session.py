"""Carries a series of steps through: begins or resumes it, measures what is missing, closes it in order."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from pydantic import JsonValue

from campaigns.engine import Engine, Memory
from campaigns.errors import Interrupted, JournalFailed, ResumeRefused
from campaigns.guards import Gate
from campaigns.journal import Journal
from campaigns.journal_reader import JournalReader
from campaigns.journal_views import AcceptedShot, Series
from campaigns.motion import Mechanism, Mover
from campaigns.numerics.geometry import FREE_BY_DEFAULT
from campaigns.numerics.running import RunningFit
from campaigns.progress import Watcher
from campaigns.records import (
    Event,
    PairVoided,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    SessionStopped,
    Stage,
)
from campaigns.rules import GateRules, MotionRules
from campaigns.shooting import Cell, Shooter
from campaigns.shot_sets import ShotSet
from campaigns.steps import Group, Step, groups, pending
from campaigns.tally import Tally
from campaigns.version import VERSION
from drivers.errors import Cancelled
from drivers.values import Identity, Weather


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


@dataclass(frozen=True, slots=True)
class Present:
    """Who is there today, and the air."""

    robot: Identity
    tracker: Identity
    weather: Weather


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
    present = Present(cell.robot.identity(), cell.tracker.identity(), cell.tracker.weather())
    series = None if anew else _unfinished(journal, work, present)
    if series is None:
        series = journal.start_series(_series_started(work, present))
    started = SessionStarted(VERSION, present.robot, present.tracker, present.weather)
    journal.append(started, series=series)
    with _session(journal, series):
        _measure(cell, journal, series, work, watcher, stop_requested)
        journal.append(SeriesFinished(), series=series)
    return series


def nothing_left(journal: JournalReader, work: Work) -> Series | None:
    """The latest series of this stage if it is finished and measured this very plan."""
    latest = journal.latest_series(work.stage)
    done = latest and latest.finished and latest.started.plan_digest == work.plan_digest
    return latest if done else None


def _measure(
    cell: Cell,
    journal: Journal,
    series: int,
    work: Work,
    watcher: Watcher,
    stop_requested: Callable[[], bool],
) -> None:
    accepted = journal.shots(series)
    running = RunningFit(work.mechanism.geometry, FREE_BY_DEFAULT)
    gate = Gate(work.gate, running)
    for shot in accepted:
        gate.accept(shot.outcome.joints_rad, shot.outcome.point_in_tracker_mm)
    mover = Mover(cell.robot, cell.clock, work.motion, work.mechanism, stop_requested)
    tally = Tally(watcher, len(accepted))
    shooter = Shooter(cell, journal, series, mover, gate, tally)
    engine = Engine(cell, shooter, work.gate, tally, _memory(accepted))
    drift = _first_drift(work.steps, accepted)
    if drift is not None:
        engine.check_drift(drift)
    left = pending(groups(work.steps), (shot.intent.shot for shot in accepted))
    tally.void(_void_halves(journal, series, left, accepted))
    engine.run(left)


def _memory(accepted: Sequence[AcceptedShot]) -> Memory:
    """The first drift shot and the first weather of what has been measured."""
    by_time = sorted(accepted, key=lambda shot: shot.measured_utc)
    drifts = [s for s in by_time if s.intent.purpose == ShotSet.DRIFT.value]
    return Memory(
        drifts[0].outcome.point_in_tracker_mm if drifts else None,
        next((s.outcome.weather for s in by_time if s.outcome.weather), None),
    )


def _first_drift(steps: Sequence[Step], accepted: Sequence[AcceptedShot]) -> Step | None:
    """The drift step to repeat after a restart; None when nothing can be compared."""
    taken = {shot.intent.shot for shot in accepted}
    return next(
        (s for s in steps if s.planned.purpose is ShotSet.DRIFT and s.planned.shot in taken), None
    )


def _void_halves(
    journal: Journal, series: int, left: Sequence[Group], accepted: Sequence[AcceptedShot]
) -> int:
    """Void the accepted shots of pairs that were cut in two; gives how many."""
    taken = {shot.intent.shot for shot in accepted}
    voided = 0
    for group in left:
        halves = tuple(s.planned.shot for s in group if s.planned.shot in taken)
        pair = group[0].planned.pair
        if halves and pair is not None:
            reason = "the session ended between the two shots of the pair"
            journal.append(PairVoided(pair, halves, reason), series=series)
            voided += len(halves)
    return voided


def _unfinished(journal: Journal, work: Work, present: Present) -> int | None:
    """The series to take up, if there is one."""
    latest = journal.latest_series(work.stage)
    if latest is None or latest.finished:
        return None
    _check_same(latest, work, present)
    journal.append(Event("resumed", f"{work.stage} goes on"), series=latest.number)
    return latest.number


def _check_same(series: Series, work: Work, present: Present) -> None:
    remedy = "bring back what it began with, or begin anew with the option --anew"
    began = series.started
    if began.plan_digest != work.plan_digest:
        raise ResumeRefused(
            f"series {series.number} ({work.stage}) was begun with another plan "
            f"({began.plan_digest[:8]}…, now {work.plan_digest[:8]}…)",
            remedy=remedy,
        )
    for name, then, now in (
        ("controller", began.robot, present.robot),
        ("tracker", began.tracker, present.tracker),
    ):
        if then is not None and then.serial != now.serial:
            raise ResumeRefused(
                f"series {series.number} ({work.stage}) was begun with the {name} of serial "
                f"{then.serial}, now it is {now.serial}",
                remedy=remedy,
            )


def _series_started(work: Work, present: Present) -> SeriesStarted:
    return SeriesStarted(
        work.stage,
        work.plan_digest,
        work.configuration,
        VERSION,
        work.robot_file_digest,
        present.robot,
        present.tracker,
        present.weather,
    )


@contextmanager
def _session(journal: Journal, series: int) -> Iterator[None]:
    """Write how the session ended; without the journal there is nothing to write to."""
    try:
        yield
    except JournalFailed:
        raise
    except (Interrupted, Cancelled, KeyboardInterrupt) as error:
        journal.append(SessionStopped("interrupted", str(error) or "interrupted"), series=series)
        raise
    except BaseException as error:
        reason = str(error) or type(error).__name__
        journal.append(SessionStopped("aborted", reason), series=series)
        raise
    journal.append(SessionStopped("finished", "all shots measured"), series=series)
