"""Each seed is a piece of work among faults, of which none may lose, mix up or hide anything.

python -m pytest tests/torture/test_faults_by_seed.py --seed 17
python -m pytest tests/torture/test_faults_by_seed.py --seeds 1000 -s
"""

import time
from collections import Counter

import pytest
from faults import Player, make_bases

pytestmark = [pytest.mark.torture, pytest.mark.timeout(600)]

STANDING, FEW, LONG, AT_ONCE = 12, 3, 200, 20
"""Seeds of each run of the tests, of one test there; of the long ones, and of one test of these."""


def pytest_generate_tests(metafunc):
    if "seeds" not in metafunc.fixturenames:
        return
    one, count = (metafunc.config.getoption(name) for name in ("--seed", "--seeds"))
    parts = [
        range(first, min(first + AT_ONCE, count or 0)) for first in range(0, count or 0, AT_ONCE)
    ]
    if one is not None:
        parts = [range(one, one + 1)]
    elif count is None:
        long = [range(first, first + AT_ONCE) for first in range(STANDING, LONG, AT_ONCE)]
        standing = [range(first, first + FEW) for first in range(0, STANDING, FEW)]
        parts = [*standing, *(pytest.param(part, marks=pytest.mark.long) for part in long)]
    metafunc.parametrize("seeds", parts, ids=lambda part: f"{part[0]}-{part[-1]}")


@pytest.fixture(scope="session")
def bases(made_once):
    return made_once("bases", make_bases)


def test_nothing_is_lost_mixed_up_or_hidden_and_the_work_is_completed(bases, tmp_path, seeds):
    broken, faults, shots, since_s = [], Counter(), 0, time.process_time()
    for seed in seeds:
        played = Player(bases, tmp_path, seed).play()
        faults.update(played.world.faults)
        shots += len(played.live())
        for what in played.broken:
            told = f"{played.name}, codes {played.codes}: {what}"
            broken.append(f"python -m pytest {__file__} --seed {seed}\n  {told}")
        if len(seeds) == 1:
            print(played.name, played.codes, dict(faults))  # noqa: T201 - who asks for one looks
    used_s = time.process_time() - since_s
    print(f"{len(seeds)} seeds, {used_s:.1f} s, {shots} shots, {faults.total()} faults")  # noqa: T201
    assert not broken, "\n".join(["", *broken])
