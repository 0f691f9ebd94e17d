"""One process per campaign, and the second one is told who is first."""

import errno
import os
from pathlib import Path

import pytest

from campaigns.errors import CampaignLocked, WriteFailed
from campaigns.files.lock import HOLDER_FILE, campaign_lock


def noon() -> str:
    return "2026-03-02T12:00:00Z"


def test_a_second_holder_is_refused_and_told_who_holds_it_since_when(tmp_path: Path) -> None:
    with campaign_lock(tmp_path, now_utc=noon):
        with (
            pytest.raises(
                CampaignLocked, match=f"process {os.getpid()} on .*, since 2026-03-02T12"
            ),
            campaign_lock(tmp_path, now_utc=noon),
        ):
            pytest.fail("held twice")
        with (
            pytest.raises(CampaignLocked, match=f"process {os.getpid()}"),
            campaign_lock(tmp_path, now_utc=noon),
        ):
            pytest.fail("held once the second had failed")


def test_the_campaign_is_free_again_after_the_block_even_after_an_error(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), campaign_lock(tmp_path, now_utc=noon):
        raise KeyboardInterrupt
    assert not (tmp_path / HOLDER_FILE).exists()
    with campaign_lock(tmp_path, now_utc=noon):
        pass


def test_two_campaigns_do_not_lock_each_other(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    with campaign_lock(tmp_path / "a", now_utc=noon), campaign_lock(tmp_path / "b", now_utc=noon):
        pass


@pytest.mark.parametrize("note", ["", "[]", "{}", "\x00"])
def test_a_holder_that_left_no_readable_word_still_holds(tmp_path: Path, note: str) -> None:
    with campaign_lock(tmp_path, now_utc=noon):
        (tmp_path / HOLDER_FILE).write_text(note, encoding="utf-8")
        with (
            pytest.raises(CampaignLocked, match="holder unknown"),
            campaign_lock(tmp_path, now_utc=noon),
        ):
            pytest.fail("held twice")


def test_words_left_by_a_dead_holder_are_no_lock(tmp_path: Path) -> None:
    (tmp_path / HOLDER_FILE).write_text(
        '{"pid": 1, "host": "x", "since_utc": "y"}', encoding="utf-8"
    )
    with campaign_lock(tmp_path, now_utc=noon):
        assert str(os.getpid()) in (tmp_path / HOLDER_FILE).read_text(encoding="utf-8")


def test_a_folder_that_cannot_be_locked_says_so_and_leaves_no_lock_behind(tmp_path: Path) -> None:
    (tmp_path / HOLDER_FILE).mkdir()
    with (
        pytest.raises(WriteFailed, match="cannot be locked"),
        campaign_lock(tmp_path, now_utc=noon),
    ):
        pytest.fail("held without a word")
    (tmp_path / HOLDER_FILE).rmdir()
    with campaign_lock(tmp_path, now_utc=noon):
        pass


def test_a_lock_file_that_cannot_be_opened_says_so(tmp_path: Path) -> None:
    (tmp_path / "campaign.lock").mkdir()
    with (
        pytest.raises(WriteFailed, match="cannot be locked"),
        campaign_lock(tmp_path, now_utc=noon),
    ):
        pytest.fail("held")


@pytest.mark.parametrize(
    "name", [HOLDER_FILE, f"{HOLDER_FILE}.{os.getpid()}"], ids=["its own", "that of a process"]
)
def test_a_link_in_the_holders_place_leads_to_no_file_that_is_overwritten(
    tmp_path: Path, name: str
) -> None:
    others = tmp_path / "mine.txt"
    others.write_text("mine", encoding="utf-8")
    (folder := tmp_path / "campaign").mkdir()
    (folder / name).symlink_to(others)
    with campaign_lock(folder, now_utc=noon):
        assert not (folder / HOLDER_FILE).is_symlink()
        assert str(os.getpid()) in (folder / HOLDER_FILE).read_text(encoding="utf-8")
    assert others.read_text(encoding="utf-8") == "mine"
    assert [path.name for path in folder.iterdir()] == ["campaign.lock"]


def test_a_link_in_the_locks_place_is_not_followed(tmp_path: Path) -> None:
    others = tmp_path / "mine.txt"
    others.write_text("mine", encoding="utf-8")
    (folder := tmp_path / "campaign").mkdir()
    (folder / "campaign.lock").symlink_to(others)
    with pytest.raises(WriteFailed, match="cannot be locked"), campaign_lock(folder, now_utc=noon):
        pytest.fail("held")
    assert others.read_text(encoding="utf-8") == "mine"


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSYS, "this file system has no locks: move the campaign folder to a local disk"),
        (errno.ENOLCK, "this file system has no locks: move the campaign folder to a local disk"),
        (errno.EINTR, "start the command again"),
        (errno.ENOSPC, "the space on the disk"),
    ],
    ids=errno.errorcode.get,
)
def test_what_keeps_the_system_from_locking_is_said_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    remedy: str,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """And no softer lock takes its place, which a killed process would leave for ever."""

    def flock(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", flock)
    with (
        pytest.raises(WriteFailed, match=os.strerror(number)) as refused,
        campaign_lock(tmp_path, now_utc=noon),
    ):
        pass
    assert remedy in refused.value.remedy
    assert "\n" not in str(refused.value)
    assert capfd.readouterr().err == ""
    monkeypatch.undo()
    with campaign_lock(tmp_path, now_utc=noon):
        pass
