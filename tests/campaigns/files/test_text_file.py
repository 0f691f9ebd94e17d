"""Text files are written whole or not at all."""

import errno
import os
import stat
from functools import partial

import pytest
from small_files import files_no_larger_than

from campaigns.errors import OutputExists, WriteFailed
from campaigns.files.text_file import (
    make_folder,
    replace_text,
    write_new_text,
    write_text_unless_there,
)


def names_in(folder):
    return [path.name for path in folder.iterdir()]


def test_new_text_takes_the_place_of_the_old(tmp_path):
    path = tmp_path / "plan.csv"
    replace_text(path, "old\n")
    replace_text(path, "new ±\n")
    assert path.read_text(encoding="utf-8") == "new ±\n"
    assert names_in(tmp_path) == ["plan.csv"]


def test_full_disk_is_said_and_leaves_the_old_file_intact(tmp_path, monkeypatch):
    path = tmp_path / "plan.csv"
    replace_text(path, "old\n")
    with files_no_larger_than(100), pytest.raises(WriteFailed, match="free space"):
        replace_text(path, "new" * 100)

    def full(_descriptor):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(WriteFailed, match=r"no space left on device\) → free space"):
        replace_text(path, "new\n")
    assert path.read_text() == "old\n"
    assert names_in(tmp_path) == ["plan.csv"]


@pytest.mark.parametrize("number", [errno.EINVAL, errno.ENOTSUP, errno.EIO])
def test_file_system_that_cannot_sync_a_folder_is_written_all_the_same(
    tmp_path, monkeypatch, number
):
    sync = os.fsync

    def refusing(descriptor):
        if stat.S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(number, os.strerror(number))
        sync(descriptor)

    monkeypatch.setattr(os, "fsync", refusing)
    if number == errno.EIO:
        with pytest.raises(WriteFailed, match="input/output error"):
            replace_text(tmp_path / "plan.csv", "new\n")
    else:
        replace_text(tmp_path / "plan.csv", "new\n")
    assert names_in(tmp_path) == ["plan.csv"]


def test_existing_file_is_not_overwritten_unasked(tmp_path):
    path = tmp_path / "shots.csv"
    write_new_text(path, "mine\n")
    for write in (write_new_text, partial(write_text_unless_there, overwrite=False)):
        with pytest.raises(OutputExists):
            write(path, "theirs\n")
    assert path.read_text() == "mine\n"
    write_text_unless_there(path, "theirs\n", overwrite=True)
    assert path.read_text() == "theirs\n"


def test_link_is_written_through_and_stays_a_link(tmp_path):
    (tmp_path / "real.csv").write_text("old\n")
    link = tmp_path / "plan.csv"
    link.symlink_to("real.csv")
    replace_text(link, "new\n")
    assert link.is_symlink()
    assert (tmp_path / "real.csv").read_text() == "new\n"


def test_a_place_that_is_no_folder_is_said(tmp_path):
    (tmp_path / "file").write_text("")
    for place in ("missing/plan.csv", "file/plan.csv"):
        with pytest.raises(WriteFailed, match="check that the folder exists"):
            replace_text(tmp_path / place, "text")
    with pytest.raises(WriteFailed, match="cannot be written"):
        make_folder(tmp_path / "file")


def test_a_link_that_waits_in_the_fresh_files_place_is_not_written_through(tmp_path):
    (others := tmp_path / "mine.txt").write_text("mine")
    (folder := tmp_path / "campaign").mkdir()
    (folder / f".plan.csv.{os.getpid()}.new").symlink_to(others)
    replace_text(folder / "plan.csv", "new\n")
    assert others.read_text() == "mine"
    assert names_in(folder) == ["plan.csv"]
