"""Odd files in the place of good ones: the short form of `benchmarks.torture.files`."""

import math
import random
from pathlib import Path

import pytest

from benchmarks.torture import files
from benchmarks.torture.odd_files import ODD_NAMES, drawn, no_files

pytestmark = pytest.mark.timeout(600)  # a busy machine is no fault of the code

FIXED, DRAWN = 10, 3
"""Of each file's oddities that are not drawn every so many-th, and so many that are."""


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("odd") / "base"
    files.prepare(folder)
    return folder


OFTEN = ("plan.csv", "robot.yaml")


def harm(trials) -> list[str]:
    """What must not be, but for the memory: this process holds much already."""
    return [f"{each}: {fault}" for each in trials for fault in each.faults(math.inf)]


@pytest.mark.parametrize(
    "read",
    [
        pytest.param(each, marks=[] if each.file in OFTEN else pytest.mark.long)
        for each in files.READS
    ],
    ids=lambda read: read.file,
)
def test_no_odd_file_does_harm(base, tmp_path, read):
    data = (base / read.file).read_bytes()
    fixed = (*no_files(), *read.specials(data))
    rng = random.Random(read.file)
    odd = [*fixed[rng.randrange(FIXED) :: FIXED], *(drawn(data, [data], rng) for _ in range(DRAWN))]
    trials = [each for one in odd for each in files.tried(base, tmp_path / "tried", read, one)]
    assert len(trials) == len(odd) * len(read.commands)
    assert harm(trials) == []
    assert {each.code for each in trials} & files.REFUSED


@pytest.mark.long
def test_no_odd_name_does_harm(base, tmp_path):
    trials = list(files.odd_names(base, tmp_path, ODD_NAMES[::4]))
    assert len(trials) == len(ODD_NAMES[::4]) * len(files.NAMED)
    assert harm(trials) == []
