"""A damaged journal: refused by every command, left as it is, and rescued records not lost."""

import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest
from command_line import CommandLine, change
from journal_story import beginning, intent, outcome, ticking
from lost_files import delete
from paper_campaign import PaperCampaign, new_campaign
from tampering import change_text, make_version_1

from campaigns.campaign import open_campaign
from campaigns.errors import JournalFailed
from campaigns.journal.journal import open_journal, read_journal
from campaigns.journal.records import Outcome

BACKUP = "bring campaign.db back from a backup"
COPY = "campaign-rescued-1.db"
COMMANDS = (["check-journal"], ["report"], ["identify"], ["run", "--yes"])


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


def digit_changed(path: Path) -> int:
    """Change the first digit of a measured coordinate; gives the record's number."""
    with read_journal(path) as journal:
        first = journal.records_of(Outcome)[0]
    old = repr(first.record.point_in_tracker_mm[0])
    digit = "7" if old[0] != "7" else "3"
    change_text(path, first.number, f"[{old}", f"[{digit}{old[1:]}")
    return first.number


def test_every_command_refuses_a_changed_digit_and_names_the_record(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    number = digit_changed(path)
    for name, *options in COMMANDS:
        refused = pkmcal(name, paper.folder, *options)
        assert refused.code == 4, name
        assert BACKUP in refused.error_line
        copied = f"{COPY}: a rescued journal with {number - 1} records" in refused.error_line
        named = f"record {number} was changed after it was written" in refused.error_line
        assert named or copied
    with read_journal(path.with_name(COPY)) as kept:
        assert kept.last_number() == number - 1


def test_every_command_refuses_the_journal_of_another_campaign(
    tmp_path: Path, pkmcal: CommandLine
) -> None:
    for name in ("mine", "other"):
        assert pkmcal("new", tmp_path / name, "--scenario", "paper-simulation").code == 0
    mine, other = (open_campaign(tmp_path / name) for name in ("mine", "other"))
    with mine.opened_journal() as journal:
        settings = {"name": "mine", "identity": mine.config.identity}
        journal.start_series(replace(beginning(), configuration=settings))
    shutil.copy(mine.journal_path, other.folder)
    for name, *options in COMMANDS[:-1]:
        refused = pkmcal(name, other.folder, *options)
        assert refused.code == 4, name
        assert "series 1 is of another campaign, 'mine'" in refused.error_line
        assert BACKUP in refused.error_line
    change(other.folder / "campaign.yaml", {"identity": mine.config.identity})
    assert pkmcal("check-journal", other.folder).code == 0


def test_a_campaign_from_before_digests_and_identities_goes_on(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    make_version_1(path)
    before = path.read_bytes()
    assert pkmcal("check-journal", paper.folder).code == 0
    assert path.read_bytes() == before
    assert pkmcal("identify", paper.folder).code in (0, 1)
    after = pkmcal("check-journal", paper.folder, "--json")
    assert after.code == 0
    assert after.document["version"] == 2
    assert after.document["chained"] == 1


def test_check_journal_says_what_is_there_and_changes_nothing(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    before = path.read_bytes()
    said = pkmcal("check-journal", paper.folder, "--json")
    with read_journal(path) as journal:
        records, digest = journal.last_number(), journal.digest()
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
        "shots": 14,
        "problems": [],
    }
    assert {key: said.document[key] for key in contents} == contents
    assert "the journal is whole" in pkmcal("check-journal", paper.folder).out
    assert path.read_bytes() == before


def test_check_journal_names_everything_that_is_wrong(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    number = digit_changed(path)
    mixed, index = bytearray(path.read_bytes()), index_page(path)
    mixed[index.stop - 40 : index.stop] = bytes(40)
    path.write_bytes(mixed)
    refused = pkmcal("check-journal", paper.folder, "--json")
    assert refused.code == 4
    texts = [problem["problem"] for problem in refused.document["problems"]]
    assert texts[0] == f"record {number} was changed after it was written"
    assert texts[1].startswith("the file is damaged: ")
    assert "(and 1 more)" in refused.error_line


def index_page(path: Path) -> slice:
    """Place in the file of the index over the intents."""
    with closing(sqlite3.connect(path)) as connection:
        (size,) = connection.execute("PRAGMA page_size").fetchone()
        query = "SELECT rootpage FROM sqlite_master WHERE name = 'one_intent'"
        (page,) = connection.execute(query).fetchone()
    return slice((page - 1) * size, page * size)


def test_mixture_of_two_moments_is_left_as_it_is_and_its_records_are_kept(
    paper: PaperCampaign, path: Path
) -> None:
    """Its records are whole: only an index is the one of before."""
    before = path.read_bytes()
    with paper.journal() as journal:
        journal.append(intent(99), series=1)
        told = journal.records()
    mixed, place = bytearray(path.read_bytes()), index_page(path)
    mixed[place] = before[place]
    path.write_bytes(mixed)
    with pytest.raises(JournalFailed, match="the file is damaged"):
        read_journal(path)
    with pytest.raises(JournalFailed, match="the file is damaged") as refused:
        paper.journal()
    assert f"{len(told)} records are whole in {COPY}" in refused.value.remedy
    assert path.read_bytes() == mixed
    with read_journal(path.with_name(COPY)) as kept:
        assert kept.records() == told


@pytest.fixture
def crashed(paper: PaperCampaign, tmp_path: Path) -> Iterator[Path]:
    """A campaign whose writer died: its latest records are in the log."""
    with paper.journal() as journal:
        journal.append(intent(99), series=1)
        died = tmp_path / "died"
        died.mkdir()
        for file in paper.folder.iterdir():
            if not file.name.endswith("-shm"):
                (died / file.name).write_bytes(file.read_bytes())
        yield died


@pytest.mark.parametrize(
    ("command", "share"), [("check-journal", 0.002), ("check-journal", 0.3), ("report", 0.7)]
)
def test_file_that_was_cut_is_exit_code_4_and_left_as_it_is(
    crashed: Path, command: str, share: float, pkmcal: CommandLine
) -> None:
    path = crashed / "campaign.db"
    cut = path.read_bytes()[: int(share * path.stat().st_size)]
    log = (crashed / "campaign.db-wal").read_bytes()
    path.write_bytes(cut)
    refused = pkmcal(command, crashed)
    assert (refused.code, BACKUP in refused.error_line) == (4, True)
    assert path.read_bytes() == cut
    assert (crashed / "campaign.db-wal").read_bytes() == log


def test_rescued_records_are_told_of_by_every_command_until_campaign_db_has_them(
    paper: PaperCampaign, path: Path, pkmcal: CommandLine
) -> None:
    backup = path.read_bytes()
    with paper.journal() as journal:
        journal.append(intent(99), series=1)
        records = journal.last_number()
        delete(path)
        with pytest.raises(JournalFailed, match="deleted"):
            journal.append(outcome(99), series=1)
    for command in ("run", "plan", "report"):
        refused = pkmcal(command, paper.folder)
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


def test_rescued_journal_of_another_campaign_is_not_told_of(paper: PaperCampaign) -> None:
    foreign = replace(beginning(), configuration={"name": "press 4", "identity": "0th3r"})
    with open_journal(paper.folder / COPY, now_utc=ticking()) as journal:
        journal.start_series(foreign)
    assert open_campaign(paper.folder) == paper.campaign
