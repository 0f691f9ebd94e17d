"""Odd files in the place of good ones; with `--times` all of them, and so many more drawn ones."""

import random
import resource
from pathlib import Path

import odd_trials
import pytest
from odd_files import ODD_NAMES, drawn, no_files

pytestmark = [
    pytest.mark.torture,
    pytest.mark.timeout(600),
]  # a busy machine is no fault of the code

FIXED, DRAWN = 10, 3
"""Of each file's oddities that are not drawn every so many-th, and so many that are."""


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("odd") / "base"
    odd_trials.prepare(folder)
    return folder


def harm(trials) -> list[str]:
    """What must not be; of the memory what this process holds already is no fault."""
    own_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / odd_trials.KIB
    most_mib = odd_trials.MOST_MIB + own_mib
    return [f"{each}: {fault}" for each in trials for fault in each.faults(most_mib)]


@pytest.mark.long
@pytest.mark.parametrize("read", odd_trials.READS, ids=lambda read: read.file)
def test_no_odd_file_does_harm(base, tmp_path, read, times):
    data = (base / read.file).read_bytes()
    fixed = (*no_files(), *read.specials(data))
    rng = random.Random(read.file)
    some = fixed if times > 1 else fixed[rng.randrange(FIXED) :: FIXED]
    others = [(base / each.file).read_bytes() for each in odd_trials.READS]
    odd = [*some, *(drawn(data, others, rng) for _ in range(DRAWN * times))]
    trials = [each for one in odd for each in odd_trials.tried(base, tmp_path / "tried", read, one)]
    assert len(trials) == len(odd) * len(read.commands)
    assert harm(trials) == []
    assert {each.code for each in trials} & odd_trials.REFUSED


@pytest.mark.long
def test_no_odd_name_does_harm(base, tmp_path, times):
    names = ODD_NAMES[:: 4 if times == 1 else 1]
    trials = list(odd_trials.odd_names(base, tmp_path, names))
    assert len(trials) == len(names) * len(odd_trials.NAMED)
    assert harm(trials) == []
