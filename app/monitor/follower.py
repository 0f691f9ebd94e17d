"""Follower of a journal that another process writes: what is new, as the live page is told it."""

import os
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

from app.monitor.live_state import View, Watched, live_state
from campaigns.campaign import open_campaign
from campaigns.errors import CampaignError
from campaigns.files.lock import lock_holder
from campaigns.journal.journal import JournalReader
from campaigns.journal.records import (
    Finding,
    Record,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    SessionStopped,
)
from campaigns.journal.views import Entry, Series
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.measuring.running_fit import next_size
from campaigns.measuring.uncertainty_monitor import UncertaintyMonitor
from campaigns.planning.plan_file import PlannedShot
from campaigns.settings.config import FILE_NAME
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.running import run_work
from campaigns.workflow.status import campaign_status

MARKS = (SeriesStarted, SeriesFinished, SessionStarted, SessionStopped, Finding)
"""Records with which a campaign may reach another stage."""
SHOTS_BETWEEN_FITS, GROWTH = 8, 0.25
"""Identification shots that make the uncertainty worth fitting anew, and of many the share."""


class Follower:
    """Follower of one campaign. For one thread; takes no lock and writes nothing."""

    def __init__(self, folder: Path, now_utc: Callable[[], datetime]) -> None:
        self._folder, self._now_utc = folder, now_utc
        self._campaign = open_campaign(folder)
        self._journal: JournalReader | None = None
        self._files: object = None
        """Which settings and journal are read."""
        self._seen: object = None
        self._known: list[PositionUncertainty] = []
        self._monitor: UncertaintyMonitor | None = None
        self._monitored: object = None
        self._status_of: object = None
        self._told = ("", "")
        self._watched, self._taken_up = Watched(), 0
        """What so many records say, of one series and plan."""
        self._watched_as: object = None
        self._plan: tuple[PlannedShot, ...] = ()
        self._plan_of: object = None
        self._marks = self._counted = 0
        """Marks among so many records."""

    def close(self) -> None:
        """Close the journal."""
        if self._journal is not None:
            self._journal.close()
            self._journal = None

    def news(self) -> dict[str, object] | None:
        """State of the campaign where it is another than before; None where nothing is new."""
        held_by = lock_holder(self._folder)
        try:
            entries = self._entries()
        except (CampaignError, OSError) as error:
            return self._trouble(error)
        seen = (len(entries), self._files, held_by, self._plan_time())
        if seen == self._seen:
            return None
        self._seen = seen
        campaign = self._campaign
        try:
            phase, following = self._status(entries)
            series = self._journal.series()[-1] if self._journal and entries else None
            plan = self._planned()
        except (CampaignError, OSError) as error:
            return self._trouble(error)
        watched = self._taken(entries, series, plan)
        watched.series, watched.held_by, watched.known = series, held_by, self._uncertainty(series)
        watched.phase, watched.next = phase, following
        view = View.from_tracker(
            campaign.config.tracker.place_mm, campaign.config.validation.centre_mm
        )
        name, mechanism = campaign.config.name, campaign.robot.mechanism
        return live_state(watched, view, mechanism, name, self._now_utc())

    def _entries(self) -> Sequence[Entry[Record]]:
        """Records of the journal; settings and journal are read anew where their files changed."""
        settings, journal = _stat(self._folder / FILE_NAME), _stat(self._campaign.journal_path)
        files = settings and settings.st_mtime_ns, journal and (journal.st_dev, journal.st_ino)
        if files != self._files:
            self.close()
            self._files = None
            self._campaign = open_campaign(self._folder)
            self._marks = self._counted = 0
            self._journal = self._campaign.journal_reader() if journal else None
            self._files = files
        return self._journal.records() if self._journal else ()

    def _planned(self) -> tuple[PlannedShot, ...]:
        """plan.csv, read where it is another than before."""
        of = (self._campaign.plan_path, self._plan_time())
        if of != self._plan_of:
            exists = self._campaign.plan_path.exists()
            self._plan = self._campaign.read_plan() if exists else ()
            self._plan_of = of
        return self._plan

    def _taken(
        self, entries: Sequence[Entry[Record]], series: Series | None, plan: tuple[PlannedShot, ...]
    ) -> Watched:
        """What all records say; those of another series or plan are taken up from the first on."""
        of = (self._files, series and series.number, self._plan_of)
        if of != self._watched_as or self._taken_up > len(entries):
            self._watched, self._watched_as = Watched(series=series, plan=plan), of
            self._taken_up = 0
        self._watched.take_up(entries[self._taken_up :])
        self._taken_up = len(entries)
        return self._watched

    def _plan_time(self) -> int:
        path = self._campaign.plan_path
        return path.stat().st_mtime_ns if path.exists() else 0

    def _status(self, entries: Sequence[Entry[Record]]) -> tuple[str, str]:
        """Phase and next command, worked out anew only when a stage has begun or ended."""
        self._marks += sum(isinstance(each.record, MARKS) for each in entries[self._counted :])
        self._counted = len(entries)
        of = (self._marks, self._files, self._plan_time())
        if of != self._status_of:
            found = campaign_status(self._campaign)
            self._status_of = of
            self._told = found.phase, found.next.says if found.next else ""
        return self._told

    def _trouble(self, error: CampaignError | OSError) -> dict[str, object] | None:
        if self._seen == str(error):
            return None
        self._seen = str(error)
        return {
            "name": self._campaign.config.name,
            "colour": "red",
            "state": "cannot be read",
            "detail": str(error),
            "now_utc": self._now_utc().isoformat(timespec="milliseconds"),
        }

    def _uncertainty(self, series: Series | None) -> tuple[PositionUncertainty, ...]:
        """Return the uncertainty after every few shots of a run; () if the plan cannot be read."""
        if series is None or series.started.stage != "run":
            return ()
        of = (self._files, series.number, self._plan_time())
        if of != self._monitored:
            self._known, self._monitored, self._monitor = [], of, self._monitor_of_plan()
        identifying = ShotSet.IDENTIFICATION.value
        count = sum(shot.intent.purpose == identifying for shot in series.shots)
        before = self._known[-1].shots if self._known else 0
        if self._monitor is not None and (
            count >= max(before + SHOTS_BETWEEN_FITS, next_size(before, GROWTH))
            or (series.finished and count > before)
        ):
            found = self._monitor.fitted(shot.outcome for shot in series.shots)
            self._known += [found] if found is not None else []
        return tuple(self._known)

    def _monitor_of_plan(self) -> UncertaintyMonitor | None:
        try:
            work = run_work(self._campaign, self._campaign.checked_plan())
            return work.uncertainty_monitor()
        except CampaignError:
            return None


def _stat(path: Path) -> os.stat_result | None:
    try:
        return path.stat()
    except FileNotFoundError:
        return None
