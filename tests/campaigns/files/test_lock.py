"""One process per campaign, and the second one is told who is first."""

import errno
import os
import time
from pathlib import Path

import pytest

from campaigns.errors import CampaignLocked, WriteFailed
from campaigns.files.lock import LOCK_FILE, campaign_lock, lock_holder
from drivers.texts import moment


def noon() -> str:
    return "2026-03-02T12:00:00Z"


def refusal(folder: Path, error: type[Exception]) -> str:
    """What is said to a process that cannot have the lock."""
    with pytest.raises(error) as refused, campaign_lock(folder, now_utc=noon):
        pytest.fail("held")
    return str(refused.value)


def require_free(folder: Path) -> None:
    assert lock_holder(folder) is None
    with campaign_lock(folder, now_utc=noon):
        pass


def test_a_second_holder_is_refused_and_told_who_holds_it_since_when(tmp_path: Path) -> None:
    with campaign_lock(tmp_path, now_utc=noon):
        for _ in range(2):  # and again once another one had tried it
            said = refusal(tmp_path, CampaignLocked)
            assert f"process {os.getpid()} on " in said
            assert f"since {moment(noon())}" in said
            holder = lock_holder(tmp_path)
            assert holder is not None
            assert (holder.pid, holder.since_utc) == (os.getpid(), noon())


def test_the_campaign_is_free_again_after_the_block_even_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), campaign_lock(tmp_path, now_utc=noon):
        raise KeyboardInterrupt
    require_free(tmp_path)


@pytest.mark.parametrize("note", ["", "[]", "{}", "\x00"])
def test_a_holder_that_left_no_readable_word_still_holds(tmp_path: Path, note: str) -> None:
    with campaign_lock(tmp_path, now_utc=noon):
        (tmp_path / LOCK_FILE).write_text(note, encoding="utf-8")
        assert "holder unknown" in refusal(tmp_path, CampaignLocked)


def test_words_left_by_a_dead_holder_are_no_lock(tmp_path: Path) -> None:
    dead = '{"pid": 1, "host": "a computer with a long name", "since_utc": "y"}'
    (tmp_path / LOCK_FILE).write_text(dead, encoding="utf-8")
    assert lock_holder(tmp_path) is None
    with campaign_lock(tmp_path, now_utc=noon):
        holder = lock_holder(tmp_path)
        assert holder is not None
        assert holder.pid == os.getpid()


def test_who_holds_it_is_asked_in_nobodys_way(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).write_text('{"pid": 1, "host": "x", "since_utc": "y"}')
    begun_s = time.monotonic()
    while time.monotonic() < begun_s + 0.2:
        require_free(tmp_path)


def test_a_folder_a_link_or_no_folder_in_the_locks_place_is_said(tmp_path: Path) -> None:
    assert "check that the folder exists" in refusal(tmp_path / "nowhere", WriteFailed)
    place = tmp_path / LOCK_FILE
    place.mkdir()
    assert "is a folder: delete it" in refusal(tmp_path, WriteFailed)
    assert lock_holder(tmp_path) is None
    place.rmdir()
    others = tmp_path / "mine.txt"
    others.write_text("mine", encoding="utf-8")
    place.symlink_to(others)
    assert "is a link: delete it" in refusal(tmp_path, WriteFailed)
    assert others.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("kind", ["flock", "lockf"])
@pytest.mark.parametrize(
    "number", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP], ids=errno.errorcode.get
)
def test_a_file_system_without_locks_is_named_and_nothing_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, number: int
) -> None:
    """Locks of whole files serve the campaign, those of records the journal's SQLite."""

    def refusing(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(f"fcntl.{kind}", refusing)
        said = refusal(tmp_path, WriteFailed)
        assert lock_holder(tmp_path) is None
    assert os.strerror(number) in said
    assert "this file system has no locks: move the campaign folder to a local disk" in said
    assert "\n" not in said
    assert not (tmp_path / LOCK_FILE).exists()
    require_free(tmp_path)


def test_a_full_disk_is_said_and_frees_the_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("os.write", full)
        assert "No space left" in refusal(tmp_path, WriteFailed)
    require_free(tmp_path)
