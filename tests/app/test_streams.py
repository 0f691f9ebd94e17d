"""The program's own streams: UTF-8 whatever the code page, and no end for want of readers."""

import errno
import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from app.exits import AnswerLost
from app.streams import READER_GONE, lasting

FULL = Path("/dev/full")


def ended(*arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **variables):
    words = [sys.executable, "-m", "app.main", *arguments]
    environment = {**os.environ, **variables}
    return subprocess.run(words, env=environment, stdout=stdout, stderr=stderr, check=False)


@pytest.mark.slow
def test_errors_are_utf_8_whatever_the_code_page():
    refused = ended("plan", os.fsdecode(b"no-such-folder-\xff"), PYTHONIOENCODING="ascii")
    assert refused.returncode == 2
    said = refused.stderr.decode()
    assert said.startswith("pkmcal: no-such-folder-? holds no campaign.yaml → ")


@pytest.mark.slow
def test_an_answer_that_finds_no_room_is_an_error():
    with FULL.open("wb") as full:
        lost = ended("--help", stdout=full)
    assert lost.returncode == 4
    assert lost.stderr.decode().startswith("pkmcal: standard output cannot be written (no space")
    assert lost.stderr.count(b"\n") == 1


@pytest.mark.slow
def test_a_reader_that_has_left_changes_no_exit_code():
    reading, writing = os.pipe()
    os.close(reading)
    try:
        assert ended("--help", stdout=writing).returncode == 0
    finally:
        os.close(writing)


class Failing(io.RawIOBase):
    """Bytes that cannot be written any more."""

    def __init__(self, code):
        self.code = code

    def writable(self):
        return True

    def write(self, data):
        raise OSError(self.code, "-")


def over(code):
    inner = io.TextIOWrapper(io.BufferedWriter(Failing(code)))
    return lasting(inner, "standard output", READER_GONE)


@pytest.mark.parametrize("code", [errno.EPIPE, errno.EIO, errno.ENXIO])
def test_text_for_a_reader_that_has_left_is_dropped(code):
    stream = over(code)
    for _ in range(3):
        print("σ", file=stream, flush=True)
    stream.close()


def test_text_that_finds_no_room_is_missed_once():
    stream = over(errno.ENOSPC)
    with pytest.raises(AnswerLost, match="standard output cannot be written"):
        print("σ", file=stream, flush=True)
    print("σ", file=stream, flush=True)
    stream.close()
