"""A campaign's folder: where each thing lies, and how it is opened."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from campaigns.config import CampaignConfig, read_campaign, read_campaign_robot
from campaigns.errors import ShotsMissing
from campaigns.journal import Journal, open_journal
from campaigns.journal_views import Series
from campaigns.lock import campaign_lock
from campaigns.robot import RobotDocument

PLAN = "plan.csv"
JOURNAL = "campaign.db"
SCENARIO = "cell.yaml"
CELL_MEMORY = "cell-memory.json"


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

    def path(self, name: str) -> Path:
        """A file of this campaign."""
        return self.folder / name


def open_campaign(folder: Path) -> Campaign:
    """Read settings and nominal robot; raises `NotACampaign` or `ConfigInvalid`."""
    config = read_campaign(folder)
    return Campaign(folder, config, read_campaign_robot(folder, config))


@contextmanager
def journal_of(campaign: Campaign) -> Iterator[Journal]:
    """The campaign's journal, held by this process alone."""
    path = campaign.path(JOURNAL)
    with (
        campaign_lock(campaign.folder, now_utc=now_utc),
        open_journal(path, now_utc=now_utc, create=not path.exists()) as journal,
    ):
        yield journal


def measured_series(journal: Journal) -> Series:
    """The series to identify from: the latest run or import; raises `ShotsMissing`."""
    found = [s for s in (journal.latest_series("run"), journal.latest_series("import")) if s]
    if not found:
        raise ShotsMissing(
            "nothing has been measured yet", remedy="`pkmcal run` or `pkmcal import`"
        )
    return max(found, key=lambda series: series.number)
