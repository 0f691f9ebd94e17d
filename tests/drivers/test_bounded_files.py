"""Files from outside: what no reader should begin to read is refused before it is read."""

import bz2
import gzip
import lzma
import os
import socket
import time
import tracemalloc

import pytest
from ruamel.yaml import YAML

from drivers import bounded_files

LONG = "x" * 5000


def sparse(path):
    with path.open("wb") as file:
        file.truncate(50 * 1024**3)


def unix_socket(path):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(os.path.relpath(path))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: None, "there is no such file"),
        (lambda path: path.mkdir(), "is no file but a folder"),
        (os.mkfifo, "is no file but a pipe"),
        (unix_socket, "is no file but a socket"),
        (lambda path: path.symlink_to("/dev/zero"), "is no file but a device"),
        (lambda path: path.symlink_to(path.name), "cannot be read"),
        (lambda path: path.symlink_to("/proc/self/mem"), "cannot be read"),
        (sparse, "has more than 1 MB"),
        (
            lambda path: path.write_bytes(b"x" * (bounded_files.YAML_BYTES + 1)),
            "has more than 1 MB",
        ),
    ],
)
def test_what_is_no_file_of_ours_is_refused_at_once(tmp_path, monkeypatch, make, words):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "robot.yaml"
    make(path)
    tracemalloc.start()
    began_s = time.process_time()
    with pytest.raises(bounded_files.FileRefused, match=words):
        bounded_files.read_bounded(path, bounded_files.YAML_BYTES)
    assert time.process_time() - began_s < 5.0
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2 * bounded_files.CSV_BYTES


def test_a_file_of_just_the_allowed_size_is_read(tmp_path):
    path = tmp_path / "robot.yaml"
    path.write_bytes(b"x" * bounded_files.YAML_BYTES)
    assert (
        len(bounded_files.read_bounded(path, bounded_files.YAML_BYTES)) == bounded_files.YAML_BYTES
    )


@pytest.mark.parametrize("name", ["a\x00b", LONG, "\udcff", "none", f"{'d/' * 3000}x"])
def test_no_name_brings_the_reader_down(tmp_path, name):
    path = tmp_path / name
    assert not bounded_files.is_file(path)
    assert not bounded_files.is_there(path)
    with pytest.raises(bounded_files.FileRefused):
        bounded_files.read_bounded(path, bounded_files.YAML_BYTES)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"PK\x03\x04\x14\x00\x06\x00", "f: is a workbook of a spreadsheet"),
        (b"\xd0\xcf\x11\xe0\xa1\xb1", "f: is a workbook of an old spreadsheet"),
        (gzip.compress(b"name,x,y,z\n", mtime=0), "compressed .gzip."),
        (lzma.compress(b"name,x,y,z\n"), "compressed .xz."),
        (bz2.compress(b"name,x,y,z\n"), "compressed .bzip2."),
        (b"%PDF-1.7\n", "a PDF"),
    ],
)
def test_what_is_no_text_is_named_whatever_the_encoding(data, words):
    for encoding in (None, "cp1252", "utf-16"):
        with pytest.raises(bounded_files.FileRefused, match=words):
            bounded_files.decoded(data, "f", encoding)


@pytest.mark.parametrize("codec", ["utf-8-sig", "utf-16", "utf-32"])
def test_a_byte_order_mark_names_the_encoding(codec):
    assert bounded_files.decoded("X-µm".encode(codec), "f", "cp1252") == "X-µm"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [x, x]\nb: [*a, *a]\n", "f:1: has & or *"),
        ("a: 1\n<<: *a\n", "f:2: has & or *"),
        ("a: " + "[" * 50, "f:1: is nested deeper than 30 levels"),
        ("a: [" + "1," * 110 + "]", "f:1: has more than 100 entries"),
        ("# \n" * 30_000, "f: has more than 20000 lines"),
        ("a: " + "9" * 5000, "f: is not YAML"),
        ('a: "' + "x" * 300_000, "f:1: is not YAML"),
        ("a: 1\na: 2\n", "f:2: found duplicate key"),
    ],
)
def test_yaml_that_stands_for_too_much_is_refused_with_its_line(monkeypatch, text, words):
    monkeypatch.setattr(bounded_files, "YAML_ENTRIES", 100)
    began_s = time.process_time()
    with pytest.raises(bounded_files.FileRefused) as refused:
        bounded_files.loaded_yaml(bounded_files.bounded(YAML(typ="rt", pure=True)), text, "f")
    assert time.process_time() - began_s < 5.0
    assert refused.value.problem.startswith(words)
    assert len(str(refused.value)) < 500


@pytest.mark.parametrize("codec", ["utf-16-le", "utf-16-be", "utf-32-le"])
def test_nul_characters_are_named_as_what_they_may_be(codec):
    with pytest.raises(bounded_files.FileRefused, match="f:1: has NUL characters: no text, or UTF"):
        bounded_files.decoded("pair,q0_deg\n1,2\n".encode(codec), "f")
