"""One process per campaign, and the second one is told who is first."""

import errno
import os
import time
from pathlib import Path

import pytest

from campaigns.errors import CampaignLocked, WriteFailed
from campaigns.files.lock import LOCK_FILE, campaign_lock, lock_holder


def noon() -> str:
    return "2026-03-02T12:00:00Z"


def test_a_second_holder_is_refused_and_told_who_holds_it_since_when(tmp_path: Path) -> None:
    with campaign_lock(tmp_path, now_utc=noon):
        for _ in range(2):  # and again once another one had tried it
            with (
                pytest.raises(
                    CampaignLocked, match=f"process {os.getpid()} on .*, since 2026-03-02T12"
                ),
                campaign_lock(tmp_path, now_utc=noon),
            ):
                pytest.fail("held twice")
            holder = lock_holder(tmp_path)
            assert holder is not None
            assert (holder.pid, holder.since_utc) == (os.getpid(), noon())


def test_the_campaign_is_free_again_after_the_block_even_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), campaign_lock(tmp_path, now_utc=noon):
        raise KeyboardInterrupt
    assert lock_holder(tmp_path) is None
    with campaign_lock(tmp_path, now_utc=noon):
        pass


@pytest.mark.parametrize("note", ["", "[]", "{}", "\x00"])
def test_a_holder_that_left_no_readable_word_still_holds(tmp_path: Path, note: str) -> None:
    with campaign_lock(tmp_path, now_utc=noon):
        (tmp_path / LOCK_FILE).write_text(note, encoding="utf-8")
        with (
            pytest.raises(CampaignLocked, match="holder unknown"),
            campaign_lock(tmp_path, now_utc=noon),
        ):
            pytest.fail("held twice")


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
        lock_holder(tmp_path)
        with campaign_lock(tmp_path, now_utc=noon):
            pass


def test_a_folder_in_the_locks_place_is_said(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).mkdir()
    with (
        pytest.raises(WriteFailed, match=r"cannot be locked.*is a folder: delete it"),
        campaign_lock(tmp_path, now_utc=noon),
    ):
        pytest.fail("held")
    assert lock_holder(tmp_path) is None


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    with (
        pytest.raises(WriteFailed, match=r"cannot be locked.*check that the folder exists"),
        campaign_lock(tmp_path / "nowhere", now_utc=noon),
    ):
        pytest.fail("held")


def test_a_link_in_the_locks_place_is_not_followed(tmp_path: Path) -> None:
    others = tmp_path / "mine.txt"
    others.write_text("mine", encoding="utf-8")
    (folder := tmp_path / "campaign").mkdir()
    (folder / LOCK_FILE).symlink_to(others)
    with (
        pytest.raises(WriteFailed, match=r"cannot be locked.*is a link: delete it"),
        campaign_lock(folder, now_utc=noon),
    ):
        pytest.fail("held")
    assert others.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize("kind", ["flock", "lockf"])
@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSYS, "this file system has no locks: move the campaign folder to a local disk"),
        (errno.ENOLCK, "this file system has no locks: move the campaign folder to a local disk"),
        (errno.EOPNOTSUPP, "this file system has no locks"),
    ],
    ids=errno.errorcode.get,
)
def test_what_keeps_the_system_from_locking_is_said_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, number: int, remedy: str
) -> None:
    """Locks of whole files serve the campaign, those of records the journal's SQLite."""

    def refusing(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(f"fcntl.{kind}", refusing)
        with (
            pytest.raises(WriteFailed, match=os.strerror(number)) as refused,
            campaign_lock(tmp_path, now_utc=noon),
        ):
            pass
        assert lock_holder(tmp_path) is None
    assert not (tmp_path / LOCK_FILE).exists()
    assert remedy in refused.value.remedy
    assert "\n" not in str(refused.value)
    with campaign_lock(tmp_path, now_utc=noon):
        pass


def test_a_full_disk_is_said_and_frees_the_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr("os.write", full)
        with (
            pytest.raises(WriteFailed, match="No space left"),
            campaign_lock(tmp_path, now_utc=noon),
        ):
            pytest.fail("held")
    with campaign_lock(tmp_path, now_utc=noon):
        pass
