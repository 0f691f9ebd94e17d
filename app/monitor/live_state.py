"""Live state of a campaign, as the page in the hall shows it: pure, from what its journal says.

Everything is plain data, and no more of it for a long plan than fits on a screen. Positions are on
a map as the tracker sees the workspace: metres to the right and up, from its middle.
"""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from itertools import islice
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.time_series import time_series
from campaigns.files.lock import Holder
from campaigns.journal import records
from campaigns.journal.views import AcceptedShot, Entry, Series
from campaigns.measuring.run_state import LATEST_SHOTS, ParameterUncertainty, time_left_s
from campaigns.mechanisms.closed_chain import ClosedChain
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Watched:
    """What is known of a campaign at one moment; entries are all of its journal."""

    entries: Sequence[Entry[records.Record]] = ()
    series: Series | None = None
    """The one begun last."""
    plan: tuple[PlannedShot, ...] = ()
    held_by: Holder | None = None
    known: tuple[ParameterUncertainty, ...] = ()
    """Uncertainty after growing numbers of shots."""
    phase: str = ""
    next: str = ""


def live_state(
    watched: Watched, view: View, mechanism: ClosedChain, name: str, now_utc: datetime
) -> dict[str, object]:
    """State as the page is told."""
    own = [each for each in watched.entries if _is_of(each, watched.series)]
    series = watched.series
    planned = watched.plan if series is None or series.started.stage == "run" else ()
    done = {shot.intent.shot: shot for shot in series.shots} if series else {}
    skipped = {shot for each in own for shot in _shots_of(each.record, SKIPPED)} - {*done}
    total = max(len(planned) - len(skipped), len(done)) if planned else None
    colour, state, detail = _activity(own, watched)
    times = [each.measured_utc for each in done.values()]
    visits = [*_visits(series.shots)] if series else []
    drift = time_series("", shots_of_journal(visits, mechanism)) if visits else None
    latest = watched.entries[-1].at_utc if watched.entries else None
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
        "residual_mm": _last_residual(own),
        "map": [*_map(planned, own, {*done}, skipped, view)],
        "lost": [view.place(pose) for pose in _lost_at(own)],
        "drift": [] if drift is None else _pairs(drift.drift_s, drift.drift_mm),
        "sigma": [[each.shots, each.position_std_mm] for each in watched.known],
        "known": asdict(watched.known[-1]) if watched.known else None,
        "events": [*_events(own)],
        "latest_utc": latest,
        "now_utc": now_utc.isoformat(timespec="milliseconds"),
        "next": watched.next,
    }


def _is_of(entry: Entry[records.Record], series: Series | None) -> bool:
    return series is None or entry.series in (None, series.number)


def _activity(own: Sequence[Entry[records.Record]], watched: Watched) -> tuple[Colour, str, str]:
    """Colour, state and what it is about, by the last records that speak of it."""
    if watched.series is None:
        return "grey", "nothing was measured yet", ""
    for each in reversed(own):
        match each.record:
            case records.SeriesFinished():
                return "green", "finished", ""
            case records.SessionStopped() if watched.series.finished:
                return "green", "finished", ""
            case records.SessionStopped(how=how, reason=reason):
                return ("green" if how == "finished" else "amber"), "stopped", reason
            case records.Event(kind=kind, text=text) if kind in LOST and watched.held_by:
                return "red", "the beam is broken", text
            case records.Intent() | records.Outcome() | records.SessionStarted():
                break
            case records.Event(kind="resumed"):
                break
            case _:
                continue
    if watched.held_by is None:
        return (
            "red",
            "ended without a word",
            "the process that measured is gone; its command resumes",
        )
    return "green", "measuring", ""


def _shots_of(record: records.Record, kinds: Iterable[str]) -> tuple[int, ...]:
    return record.shots if isinstance(record, records.Event) and record.kind in kinds else ()


def _end_utc(times: Sequence[str], total: int | None, now_utc: datetime) -> list[str] | None:
    """Earliest and latest end by the pace of the shots so far; None while there is none."""
    at = [datetime.fromisoformat(text).timestamp() for text in sorted(times)[-LATEST_SHOTS:]]
    gaps = np.diff(at)
    left = None if total is None else total - len(times)
    ends = time_left_s(gaps[gaps < LONGEST_PAUSE_S].tolist(), left) if left is not None else None
    if ends is None:
        return None
    return [(now_utc + timedelta(seconds=s)).isoformat(timespec="seconds") for s in ends]


def _last_residual(own: Sequence[Entry[records.Record]]) -> float | None:
    outcomes = (each.record for each in reversed(own) if isinstance(each.record, records.Outcome))
    return next((each.residual_mm for each in outcomes), None)


def _map(
    planned: Sequence[PlannedShot],
    own: Sequence[Entry[records.Record]],
    done: set[int],
    skipped: set[int],
    view: View,
) -> Iterable[dict[str, object]]:
    """Places of planned shots, of a stage without a plan those that were asked for."""
    intents = [each.record for each in own if isinstance(each.record, records.Intent)]
    poses = {shot.shot: (shot.pose, shot.purpose.value) for shot in planned}
    poses |= {each.shot: (each.target, each.purpose) for each in intents}
    last = intents[-1].shot if intents else None
    every = 1 + len(poses) // MOST_PLACES
    for place, (shot, (pose, purpose)) in enumerate(poses.items()):
        state = "done" if shot in done else "skipped" if shot in skipped else "left"
        if shot == last and shot not in done:
            state = "now"
        if place % every and state in {"done", "left"}:
            continue
        yield {"shot": shot, "set": purpose, "state": state, "at": view.place(pose)}


def _lost_at(own: Sequence[Entry[records.Record]]) -> Iterable[Pose]:
    """Targets on the way to which, or at which, the beam was lost."""
    target: Pose | None = None
    found: deque[Pose] = deque(maxlen=MOST_LOST)
    for each in own:
        if isinstance(each.record, records.Intent):
            target = each.record.target
        elif isinstance(each.record, records.Event) and each.record.kind in LOST and target:
            found.append(target)
    return found


def _events(own: Sequence[Entry[records.Record]]) -> Iterable[dict[str, str]]:
    """What the operator should know, the latest first."""
    told = ((each.at_utc, _text(each.record)) for each in reversed(own))
    for at_utc, text in islice((each for each in told if each[1]), EVENTS):
        yield {"at_utc": at_utc, "text": text[:SHORT]}


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
