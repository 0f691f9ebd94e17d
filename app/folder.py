"""A campaign's folder: where each thing lies, and how it is opened."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from campaigns.errors import ShotsMissing
from campaigns.files.lock import campaign_lock
from campaigns.journal.journal import Journal, JournalReader, open_journal
from campaigns.journal.views import Series
from campaigns.robots.robot import RobotDocument
from campaigns.settings.config import CampaignConfig, read_campaign, read_campaign_robot

PLAN = "plan.csv"
JOURNAL = "campaign.db"
SCENARIO = "cell.yaml"
CELL_MEMORY = "cell-memory.json"
SIMULATED = "sim://"


def now_utc() -> str:
    """The time, for records."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign as it lies on disk."""

    folder: Path
    config: CampaignConfig
    nominal: RobotDocument

    @property
    def plan_path(self) -> Path:
        """plan.csv."""
        return self.folder / PLAN

    @property
    def journal_path(self) -> Path:
        """campaign.db."""
        return self.folder / JOURNAL

    @property
    def is_simulated(self) -> bool:
        """Whether no real device is meant."""
        urls = (self.config.controller.url, self.config.tracker.url)
        return all(url.startswith(SIMULATED) for url in urls)

    @property
    def robot_identity(self) -> str:
        """Which mechanism this is about: its serial number, or the nominal robot's name."""
        return self.config.instruments.robot_serial or self.nominal.robot.name

    def path(self, name: str) -> Path:
        """A file of this campaign."""
        return self.folder / name


def open_campaign(folder: Path) -> Campaign:
    """Read settings and nominal robot; raises `NotACampaign` or `ConfigInvalid`."""
    config = read_campaign(folder)
    return Campaign(folder, config, read_campaign_robot(folder, config))


@contextmanager
def held(campaign: Campaign) -> Iterator[None]:
    """Keep other processes from changing the campaign meanwhile; raises `CampaignLocked`."""
    with campaign_lock(campaign.folder, now_utc=now_utc):
        yield


@contextmanager
def journal_of(campaign: Campaign) -> Iterator[Journal]:
    """The campaign's journal, made if there is none, and held by this process alone."""
    with held(campaign), opened_journal(campaign) as journal:
        yield journal


def opened_journal(campaign: Campaign) -> Journal:
    """The journal, made if there is none; the caller holds the campaign."""
    path = campaign.journal_path
    return open_journal(path, now_utc=now_utc, create=not path.exists())


def require_journal(campaign: Campaign) -> Path:
    """Where the journal is; raises `ShotsMissing` when nothing was ever written to it."""
    if not campaign.journal_path.exists():
        raise _nothing_measured(campaign)
    return campaign.journal_path


def measured_series(campaign: Campaign, journal: JournalReader) -> Series:
    """The series to identify from: the latest run or import; raises `ShotsMissing`.

    A run may be unfinished, an import that broke off counts for nothing.
    """
    runs, imports = journal.series("run"), journal.series("import")
    found = [*runs, *(series for series in imports if series.finished)]
    if not found:
        raise _nothing_measured(campaign)
    return max(found, key=lambda series: series.number)


def _nothing_measured(campaign: Campaign) -> ShotsMissing:
    return ShotsMissing(
        f"{campaign.folder}: nothing has been measured yet",
        remedy="measure with `pkmcal run`, or take shots in with `pkmcal import`",
    )
