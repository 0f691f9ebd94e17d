"""What differs on Windows, tried where it can be: names, paths in shells, links, open files."""

import os
from pathlib import Path, PureWindowsPath

import pytest

from campaigns.errors import WriteFailed
from campaigns.files import text_file
from drivers import system
from drivers.texts import quoted


@pytest.mark.parametrize(
    "name", ["con", "NUL", "Aux.yaml", "com1", "lpt9.old", "conin$", "cell.", "cell ", "3:4", "a?"]
)
def test_names_that_windows_cannot_have_are_refused_in_any_place(name, tmp_path, monkeypatch):
    monkeypatch.setattr(text_file, "IS_WINDOWS", True)
    for path in (tmp_path / name, tmp_path / name / "inside"):
        with pytest.raises(WriteFailed, match="choose another name") as refused:
            text_file.make_folder(path)
        assert f"'{name}'" in str(refused.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["cell-5", "console", "com", "com10", "größe", "nul-test", ".a"])
def test_other_names_are_taken(name, tmp_path, monkeypatch):
    monkeypatch.setattr(text_file, "IS_WINDOWS", True)
    text_file.make_folder(tmp_path / name / ".." / "other")
    assert (tmp_path / name).is_dir()


def test_a_name_of_windows_alone_is_taken_elsewhere(tmp_path):
    text_file.make_folder(tmp_path / "con")
    assert (tmp_path / "con").is_dir()


@pytest.mark.parametrize(
    ("path", "typed"),
    [
        (r"C:\cells\first", r"C:\cells\first"),
        (r"C:\my cells\first", r'"C:\my cells\first"'),
        (r"D:\R&D\(old)", r'"D:\R&D\(old)"'),
        ("C:\\my cells\\", '"C:\\my cells\\\\"'),
        (r"\\server\share\größe", r"\\server\share\größe"),
        ("-first", "./-first"),
    ],
)
def test_a_path_is_typed_on_windows_in_double_quotes(path, typed):
    assert quoted(path, for_windows=True) == typed
    bare = PureWindowsPath(typed.replace('\\\\"', '\\"').strip('"'))
    assert bare == PureWindowsPath(path)


def test_no_link_is_followed_where_the_system_has_no_flag_for_it(tmp_path, monkeypatch):
    monkeypatch.setattr(system, "_UNFOLLOWED", 0)
    somebodys, link = tmp_path / "somebodys", tmp_path / "campaign.lock"
    somebodys.write_text("kept", encoding="utf-8")
    link.symlink_to(somebodys)
    with pytest.raises(OSError, match=os.strerror(system.ELOOP)):
        system.open_unfollowed(link, os.O_RDWR | os.O_CREAT)


class OpenedElsewhere(PermissionError):
    """What Windows says of a file that another program has open."""

    winerror = 32


def test_a_file_that_another_program_has_open_stays_and_is_named(tmp_path, monkeypatch):
    def refusing(self: Path, target: Path) -> None:
        raise OpenedElsewhere(13, "The process cannot access the file")

    path = tmp_path / "report.html"
    path.write_text("old", encoding="utf-8")
    monkeypatch.setattr(Path, "replace", refusing)
    with pytest.raises(WriteFailed, match=r"close report\.html in the other program"):
        text_file.replace_text(path, "new")
    assert {file.name: file.read_text(encoding="utf-8") for file in tmp_path.iterdir()} == {
        "report.html": "old"
    }
