"""A damaged journal: refused before it is written, left as it is, and rescued records not lost."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from journal_story import beginning, intent, outcome, ticking
from lost_files import delete
from paper_campaign import new_campaign

from app.main import run_command
from campaigns.campaign import Campaign, open_campaign
from campaigns.errors import JournalFailed
from campaigns.journal.digest_chain import JournalDamaged
from campaigns.journal.journal import open_journal, read_journal

SHOTS = 12


@pytest.fixture
def campaign(tmp_path: Path) -> Campaign:
    campaign = new_campaign(tmp_path / "paper").campaign
    with campaign.opened_journal() as journal:
        journal.start_series(beginning())
    measure(campaign, 1)
    return campaign


def measure(campaign: Campaign, first: int) -> None:
    with campaign.opened_journal() as journal:
        for shot in range(first, first + SHOTS):
            journal.append(intent(shot), series=1)
            journal.append(outcome(shot), series=1)


def index_page(path: Path) -> slice:
    """Place in the file of the index over the intents."""
    with closing(sqlite3.connect(path)) as connection:
        (size,) = connection.execute("PRAGMA page_size").fetchone()
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'one_intent'"
        (page,) = connection.execute(query).fetchone()
    return slice((page - 1) * size, page * size)


def test_mixture_of_two_moments_is_refused_before_anything_is_written(campaign: Campaign) -> None:
    """Its records are whole: only an index is the one of before."""
    path = campaign.journal_path
    before = path.read_bytes()
    measure(campaign, 1 + SHOTS)
    mixed, place = bytearray(path.read_bytes()), index_page(path)
    mixed[place] = before[place]
    path.write_bytes(mixed)
    with read_journal(path) as readable:
        assert len(readable.shots(1)) == 2 * SHOTS
    with pytest.raises(JournalDamaged, match="the file is damaged") as refused:
        open_journal(path, now_utc=ticking())
    assert "move campaign.db and campaign.db-wal away" in refused.value.remedy
    assert path.read_bytes() == mixed


@pytest.fixture
def crashed(campaign: Campaign, tmp_path: Path) -> Iterator[Path]:
    """A campaign whose writer died: its latest records are in the log."""
    with campaign.opened_journal() as journal:
        journal.append(intent(2 * SHOTS), series=1)
        died = tmp_path / "died"
        died.mkdir()
        for file in campaign.folder.iterdir():
            if not file.name.endswith("-shm"):
                (died / file.name).write_bytes(file.read_bytes())
        yield died


@pytest.mark.parametrize("share", [0.002, 0.05, 0.3, 0.7])
@pytest.mark.parametrize("command", ["check-journal", "report"])
def test_file_that_was_cut_is_exit_code_4_and_left_as_it_is(
    crashed: Path, command: str, share: float, capsys: pytest.CaptureFixture[str]
) -> None:
    path = crashed / "campaign.db"
    cut = path.read_bytes()[: int(share * path.stat().st_size)]
    log = (crashed / "campaign.db-wal").read_bytes()
    path.write_bytes(cut)
    assert run_command([command, str(crashed)]) == 4
    assert "bring campaign.db back from a backup" in capsys.readouterr().err
    assert path.read_bytes() == cut
    assert (crashed / "campaign.db-wal").read_bytes() == log


def test_rescued_records_are_told_of_by_every_command_until_campaign_db_has_them(
    campaign: Campaign, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, path, copy = campaign.folder, campaign.journal_path, "campaign-rescued-1.db"
    backup = path.read_bytes()
    with campaign.opened_journal() as journal:
        journal.append(intent(1 + SHOTS), series=1)
        delete(path)
        with pytest.raises(JournalFailed, match="deleted"):
            journal.append(outcome(1 + SHOTS), series=1)
    for command in ("run", "plan", "identify", "report", "check-journal"):
        assert run_command([command, str(folder)]) == 4
        told = capsys.readouterr().err
        assert f"{copy}: a rescued journal with {2 * SHOTS + 2} records" in told
        assert f"rename {copy} to campaign.db" in told
    for file in folder.glob("campaign.db-*"):
        file.unlink()
    path.write_bytes(backup)
    with pytest.raises(JournalFailed, match=r"not all of which campaign\.db has"):
        open_campaign(folder)
    path.write_bytes((folder / copy).read_bytes())
    assert open_campaign(folder) == campaign


def test_rescued_journal_of_another_campaign_is_not_told_of(campaign: Campaign) -> None:
    foreign = replace(beginning(), configuration={"name": "press 4", "identity": "0th3r"})
    path = campaign.folder / "campaign-rescued-1.db"
    with open_journal(path, now_utc=ticking(), create=True) as journal:
        journal.start_series(foreign)
    assert open_campaign(campaign.folder) == campaign
