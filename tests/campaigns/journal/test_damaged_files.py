"""A damaged journal: refused by every command, left as it is, and rescued records not lost."""

import shutil
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import CommandLine
from journal_story import beginning, intent, outcome
from lost_files import delete
from paper_campaign import PaperCampaign, new_campaign
from tampering import change_text

from campaigns.campaign import open_campaign
from campaigns.errors import JournalFailed
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Outcome

BACKUP = "bring campaign.db back from a backup"
COPY = "campaign-rescued-1.db"


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> PaperCampaign:
    paper = new_campaign(tmp_path_factory.mktemp("measured") / "paper")
    paper.run(pairs=6, unseen=0)
    return paper


@pytest.fixture
def paper(measured: PaperCampaign, tmp_path: Path) -> PaperCampaign:
    """A copy of the measured campaign, to be damaged."""
    folder = Path(shutil.copytree(measured.folder, tmp_path / "paper"))
    return replace(measured, folder=folder, campaign=open_campaign(folder))


@pytest.fixture
def path(paper: PaperCampaign) -> Path:
    return paper.campaign.journal_path


def change_a_digit(path: Path) -> int:
    """Change the first digit of a measured coordinate; return the record's number."""
    with read_journal(path) as journal:
        first = journal.records_of(Outcome)[0]
    old = repr(first.record.point_in_tracker_mm[0])
    digit = "7" if old[0] != "7" else "3"
    change_text(path, first.number, f"[{old}", f"[{digit}{old[1:]}")
    return first.number


def test_commands_refuse_a_changed_digit_and_name_the_record_or_its_rescued_copy(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    number = change_a_digit(path)
    named = f"record {number} was changed after it was written"
    copied = f"{COPY}: a rescued journal with {number - 1} records"
    refused = pkmcal("report", paper.folder)
    assert (refused.code, named in refused.error_line) == (4, True)
    with pytest.raises(JournalFailed, match=named):
        paper.journal()
    refused = pkmcal("run", paper.folder)
    assert (refused.code, copied in refused.error_line) == (4, True)
    assert BACKUP in refused.error_line
    with read_journal(path.with_name(COPY)) as kept:
        assert kept.last_number() == number - 1


def test_the_journal_of_another_campaign_is_refused(
    paper: PaperCampaign, pkmcal: CommandLine
) -> None:
    with paper.journal() as journal:
        settings = {"name": "mine", "identity": "an0ther"}
        journal.start_series(replace(beginning(), configuration=settings))
    refused = pkmcal("report", paper.folder)
    assert refused.code == 4
    assert "series 2 is of another campaign, 'mine'" in refused.error_line
    assert BACKUP in refused.error_line


def test_check_journal_counts_the_contents_and_changes_nothing(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    before = path.read_bytes()
    said = pkmcal("check-journal", paper.folder, "--json")
    with read_journal(path) as journal:
        records, digest = journal.last_number(), journal.digest()
        shots = len(journal.shots(1))
    assert said.code == 0
    contents = {
        "path": str(path),
        "whole": True,
        "version": 2,
        "records": records,
        "chained": records,
        "digest": digest,
        "series": 1,
        "sessions": 1,
        "crashed_sessions": 0,
        "shots": shots,
        "problems": [],
    }
    assert {key: said.document[key] for key in contents} == contents
    assert path.read_bytes() == before


def index_page(path: Path) -> slice:
    """Place in the file of the index over the intents."""
    with closing(sqlite3.connect(path)) as connection:
        (size,) = connection.execute("PRAGMA page_size").fetchone()
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'one_intent'"
        (page,) = connection.execute(query).fetchone()
    return slice((page - 1) * size, page * size)


def test_mixture_of_two_moments_is_left_as_it_is_and_its_records_are_kept(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    """Its records are whole: only an index is the one of before."""
    before = path.read_bytes()
    with paper.journal() as journal:
        journal.append(intent(99), series=1)
        written = journal.records()
    mixed, place = bytearray(path.read_bytes()), index_page(path)
    mixed[place] = before[place]
    path.write_bytes(mixed)
    inspected = pkmcal("check-journal", paper.folder, "--json")
    (problem,) = inspected.document["problems"]
    assert inspected.code == 4
    assert problem["problem"].startswith("the file is damaged: ")
    with pytest.raises(JournalFailed, match="the file is damaged") as refused:
        paper.journal()
    assert f"{len(written)} records are whole in {COPY}" in refused.value.remedy
    assert path.read_bytes() == mixed
    with read_journal(path.with_name(COPY)) as kept:
        assert kept.records() == written


@pytest.mark.parametrize("share", [0.002, 0.3, 0.7])
def test_a_database_that_was_cut_is_left_as_it_is_with_its_log(
    paper: PaperCampaign, tmp_path: Path, share: float
) -> None:
    """Its writer died: the latest records are in the log."""
    died = tmp_path / "campaign.db"
    with paper.journal() as journal:
        journal.append(intent(99), series=1)
        for name in ("campaign.db", "campaign.db-wal"):
            shutil.copy(paper.folder / name, tmp_path)
    cut = died.read_bytes()[: int(share * died.stat().st_size)]
    log = died.with_name("campaign.db-wal").read_bytes()
    died.write_bytes(cut)
    with pytest.raises(JournalFailed) as refused:
        read_journal(died)
    assert BACKUP in refused.value.remedy or "campaign's own campaign.db" in refused.value.remedy
    assert died.read_bytes() == cut
    assert died.with_name("campaign.db-wal").read_bytes() == log


def test_rescued_records_are_named_by_commands_until_campaign_db_has_them(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    backup = path.read_bytes()
    with paper.journal() as journal:
        journal.append(intent(99), series=1)
        records = journal.last_number()
        delete(path)
        with pytest.raises(JournalFailed, match="deleted"):
            journal.append(outcome(99), series=1)
    refused = pkmcal("run", paper.folder)
    assert refused.code == 4
    assert f"{COPY}: a rescued journal with {records} records" in refused.error_line
    assert f"rename {COPY} to campaign.db" in refused.error_line
    for file in paper.folder.glob("campaign.db-*"):
        file.unlink()
    path.write_bytes(backup)
    with pytest.raises(JournalFailed, match=r"not all of which campaign\.db has"):
        open_campaign(paper.folder)
    path.write_bytes((paper.folder / COPY).read_bytes())
    assert open_campaign(paper.folder) == paper.campaign
