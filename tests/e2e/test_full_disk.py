"""A disk that is full: exit code 4, and what was there before is whole."""

import errno
import os

import pytest
from command_line import contents
from family_cases import VECTORS
from small_files import files_no_larger_than

from campaigns.files import text_file
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Outcome


@pytest.fixture
def full(pkmcal):
    """Runs a command on a full disk."""

    def run(*arguments, bytes_left=100):
        with files_no_larger_than(bytes_left):
            ended = pkmcal(*arguments)
        assert ended.code == 4, ended.err
        assert ended.out == ""
        return ended.error_line

    return run


def test_new_leaves_nothing_that_looks_like_a_campaign_and_can_be_told_again(
    full, pkmcal, tmp_path
):
    line = full("new", tmp_path / "cell-3")
    assert "cell.yaml: cannot be written" in line
    assert "free space" in line
    assert pkmcal("plan", tmp_path / "cell-3").code == 2
    assert "campaign.yaml" in full("new", tmp_path / "cell-3", bytes_left=2400)
    assert pkmcal("new", tmp_path / "cell-3").code == 0


def test_a_run_stops_at_the_last_shot_that_could_be_written(full, pkmcal, tiny):
    line = full("run", tiny, "--yes", bytes_left=120_000)
    assert "campaign.db" in line
    with read_journal(tiny / "campaign.db") as journal:
        written = len(journal.records_of(Outcome))
    assert 0 < written < 10
    assert pkmcal("run", tiny, "--yes").code == 0
    with read_journal(tiny / "campaign.db") as journal:
        assert len(journal.shots(1)) == 10


def test_an_import_counts_whole_or_not_at_all(full, pkmcal, planned):
    shots = VECTORS / "table1-tracker-noise.csv"
    assert "campaign.db" in full("import", planned, shots, bytes_left=60_000)
    refused = pkmcal("identify", planned)
    assert refused.code == 2
    assert "nothing has been measured yet" in refused.error_line
    assert pkmcal("import", planned, shots).code == 0


def test_nothing_is_loaded_when_the_old_cannot_be_kept(pkmcal, exported, monkeypatch):
    write_to_disk = text_file._write_to_disk

    def write(path, text):
        """A disk on which all finds room but a further robot file."""
        if "pkmcal/robot/" in text:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write_to_disk(path, text)

    monkeypatch.setattr(text_file, "_write_to_disk", write)
    held = pkmcal("load", exported, "--dry").out
    ended = pkmcal("load", exported, "--yes")
    assert ended.code == 4
    assert "controller-before-1.yaml: cannot be written" in ended.error_line
    assert not list(exported.glob("controller-before-*"))
    assert pkmcal("load", exported, "--dry").out == held


def test_what_is_there_is_not_overwritten_unasked(pkmcal, exported):
    before = contents(exported)
    ended = pkmcal("export", exported)
    assert ended.code == 2
    assert "robot-compensated.yaml already exists → replace it with --force" in ended.error_line
    ended = pkmcal("new", exported)
    assert ended.code == 2
    assert "campaign.yaml already exists" in ended.error_line
    assert contents(exported) == before
    assert pkmcal("export", exported, "--force").code == 0
