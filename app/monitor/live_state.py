"""Live state of a campaign, as the page in the hall shows it: pure, from what its journal says.

Everything is plain data, and no more of it for a long plan than fits on a screen. Positions are on
a map as the tracker sees the workspace: metres to the right and up, from its middle.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.time_series import time_series
from campaigns.files.lock import Holder
from campaigns.journal import records
from campaigns.journal.views import AcceptedShot, Entry, Series
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.measuring.run_state import LATEST_SHOTS, PositionUncertainty, time_left_s
from campaigns.planning.plan_file import PlannedShot
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from drivers.values import Pose, Vector3

EVENTS = 8
MOST_PLACES = 600
"""Of shots on the map, about; of more, some that are spread over all."""
MOST_LOST = 50
"""Places of a lost beam, the latest."""
MOST_POINTS = 300
"""Of a curve, about."""
LOST = ("beam broken", "suspended")
SKIPPED = ("shot skipped", "shots left out")
WORK = (records.Intent, records.Outcome, records.SessionStarted)
ENDS = (records.SeriesFinished, records.SessionStopped)
TELL_DRIFT = {ShotSet.DRIFT.value, ShotSet.NEST.value}
LONGEST_PAUSE_S = 600.0
"""A longer time between two shots was no part of the work's pace."""
MM_PER_M = 1000.0
SHORT = 200
"""Characters of an event that are shown."""
Colour = Literal["green", "amber", "red", "grey"]


@dataclass(frozen=True, slots=True)
class View:
    """Directions on the map, unit vectors in the base frame, and its middle."""

    centre_mm: Array
    right: Array
    up: Array

    @classmethod
    def from_tracker(cls, tracker_mm: Vector3, centre_mm: Vector3) -> "View":
        """View from the tracker to the middle of the workspace; upright."""
        centre = np.array(centre_mm)
        ahead = centre - np.array(tracker_mm)
        level = np.hypot(ahead[0], ahead[1])
        right = np.array([ahead[1], -ahead[0], 0.0]) / level if level else np.array([1.0, 0, 0])
        up = np.cross(right, ahead / np.linalg.norm(ahead))
        return cls(centre, right, up)

    def place(self, pose: Pose) -> list[float]:
        """Metres to the right and up."""
        from_centre = (np.array(pose.coordinates[:3]) - self.centre_mm) / MM_PER_M
        return [round(float(from_centre @ self.right), 4), round(float(from_centre @ self.up), 4)]


@dataclass(slots=True, kw_only=True)
class Watched:
    """Campaign as its journal grows: entries are taken up once each, in their order.

    Beside the time of the latest, those count that are the series' or the campaign's own.
    """

    series: Series | None = None
    """The one begun last; another one is watched anew."""
    plan: tuple[PlannedShot, ...] = ()
    held_by: Holder | None = None
    known: tuple[PositionUncertainty, ...] = ()
    """Uncertainty after growing numbers of shots."""
    phase: str = ""
    next: str = ""
    places: dict[int, tuple[Pose, str]] = field(init=False)
    """Pose and set of each shot: as planned, and in a stage without a plan as asked for."""
    skipped: set[int] = field(default_factory=set)
    lost: deque[Pose] = field(default_factory=lambda: deque(maxlen=MOST_LOST))
    """Targets on the way to which, or at which, the beam was lost."""
    events: deque[dict[str, str]] = field(default_factory=lambda: deque(maxlen=EVENTS))
    """What the operator should know, the latest first."""
    since_work: list[records.Record] = field(default_factory=list)
    """Ends and lost beams since a shot was last asked for or measured, or the work begun."""
    last_shot: int | None = None
    residual_mm: float | None = None
    """Of the last outcome."""
    latest_utc: str | None = None

    def __post_init__(self) -> None:
        """Begin with the plan."""
        self.places = {shot.shot: (shot.pose, shot.purpose.value) for shot in self.planned}

    @property
    def planned(self) -> tuple[PlannedShot, ...]:
        """The plan, of a stage that has one."""
        return self.plan if self.series is None or self.series.started.stage == "run" else ()

    def take_up(self, entries: Iterable[Entry[records.Record]]) -> None:
        """Take up what came since."""
        for each in entries:
            self.latest_utc = each.at_utc
            if self.series is not None and each.series not in (None, self.series.number):
                continue
            record = each.record
            match record:
                case records.Intent(shot=shot, target=target, purpose=purpose):
                    self.places[shot] = target, purpose
                    self.last_shot = shot
                case records.Outcome(residual_mm=residual_mm):
                    self.residual_mm = residual_mm
                case records.Event(kind=kind, shots=shots) if kind in SKIPPED:
                    self.skipped.update(shots)
                case records.Event(kind=kind) if kind in LOST and self.last_shot is not None:
                    self.lost.append(self.places[self.last_shot][0])
                case _:
                    pass
            if _is_work(record):
                self.since_work.clear()
            elif isinstance(record, ENDS) or _is_lost(record):
                self.since_work.append(record)
            if text := _text(record):
                self.events.appendleft({"at_utc": each.at_utc, "text": text[:SHORT]})


def live_state(
    watched: Watched, view: View, mechanism: ClosedChain, name: str, now_utc: datetime
) -> dict[str, object]:
    """State as the page is told."""
    series, planned = watched.series, watched.planned
    done = {shot.intent.shot: shot for shot in series.shots} if series else {}
    skipped = watched.skipped - {*done}
    total = max(len(planned) - len(skipped), len(done)) if planned else None
    colour, state, detail = _activity(watched)
    times = [each.measured_utc for each in done.values()]
    visits = [*_visits(series.shots)] if series else []
    drift = time_series("", shots_of_journal(visits, mechanism)) if visits else None
    return {
        "name": name,
        "phase": watched.phase,
        "stage": series.started.stage if series else "",
        "colour": colour,
        "state": state,
        "detail": detail,
        "done": len(done),
        "total": total,
        "end_utc": _end_utc(times, total, now_utc) if state == "measuring" else None,
        "residual_mm": watched.residual_mm,
        "map": [*_map(watched, {*done}, skipped, view)],
        "lost": [view.place(pose) for pose in watched.lost],
        "drift": [] if drift is None else _pairs(drift.drift_s, drift.drift_mm),
        "sigma": [[each.shots, each.position_std_mm] for each in watched.known],
        "known": asdict(watched.known[-1]) if watched.known else None,
        "events": [*watched.events],
        "latest_utc": watched.latest_utc,
        "now_utc": now_utc.isoformat(timespec="milliseconds"),
        "next": watched.next,
    }


def _is_work(record: records.Record) -> bool:
    return isinstance(record, WORK) or (
        isinstance(record, records.Event) and record.kind == "resumed"
    )


def _is_lost(record: records.Record) -> bool:
    return isinstance(record, records.Event) and record.kind in LOST


def _activity(watched: Watched) -> tuple[Colour, str, str]:
    """Colour, state and what it is about, by the last records that speak of it."""
    if watched.series is None:
        return "grey", "nothing was measured yet", ""
    for each in reversed(watched.since_work):
        match each:
            case records.SeriesFinished():
                return "green", "finished", ""
            case records.SessionStopped() if watched.series.finished:
                return "green", "finished", ""
            case records.SessionStopped(how=how, reason=reason):
                return ("green" if how == "finished" else "amber"), "stopped", reason
            case records.Event(text=text) if watched.held_by:
                return "red", "the beam is broken", text
            case _:
                continue
    if watched.held_by is None:
        return (
            "red",
            "ended without a word",
            "the process that measured is gone; its command resumes",
        )
    return "green", "measuring", ""


def _end_utc(times: Sequence[str], total: int | None, now_utc: datetime) -> list[str] | None:
    """Earliest and latest end by the pace of the shots so far; None while there is none."""
    at = [datetime.fromisoformat(text).timestamp() for text in sorted(times)[-LATEST_SHOTS:]]
    gaps = np.diff(at)
    left = None if total is None else total - len(times)
    ends = time_left_s(gaps[gaps < LONGEST_PAUSE_S].tolist(), left) if left is not None else None
    if ends is None:
        return None
    return [(now_utc + timedelta(seconds=s)).isoformat(timespec="seconds") for s in ends]


def _map(
    watched: Watched, done: set[int], skipped: set[int], view: View
) -> Iterable[dict[str, object]]:
    """Places of planned shots, of a stage without a plan those that were asked for."""
    every = 1 + len(watched.places) // MOST_PLACES
    now = None if watched.last_shot in done else watched.last_shot
    for place, (shot, (pose, purpose)) in enumerate(watched.places.items()):
        if place % every and shot != now and shot not in skipped:
            continue
        state = "done" if shot in done else "skipped" if shot in skipped else "left"
        state = "now" if shot == now else state
        yield {"shot": shot, "set": purpose, "state": state, "at": view.place(pose)}


def _text(record: records.Record) -> str:
    match record:
        case records.Event(text=text):
            return text
        case records.Rejected(shot=shot, reason=reason):
            return f"shot {shot}: {reason}"
        case _:
            return ""


def _visits(shots: Sequence[AcceptedShot]) -> Iterable[AcceptedShot]:
    """Shots that tell drift: its own, those of nests, and the first, from which time counts."""
    first = min((each.measured_utc for each in shots), default="")
    for each in shots:
        if each.intent.purpose in TELL_DRIFT or each.measured_utc == first:
            yield each


def _pairs(x: Array, y: Array) -> list[list[float]]:
    every = 1 + len(x) // MOST_POINTS
    x, y = (np.append(each[:-1:every], each[-1:]) for each in (x, y))
    return [[round(float(a), 3), round(float(b), 5)] for a, b in zip(x, y, strict=True)]


def utc_now() -> datetime:
    """Time for the page."""
    return datetime.now(UTC)
