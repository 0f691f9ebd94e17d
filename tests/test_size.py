"""The house does not grow: its sizes stay below the ceilings in pyproject.toml."""

import pytest

from benchmarks import size

SIZES, CEILINGS = size.sizes(), size.ceilings()


def test_each_size_has_its_ceiling():
    assert list(CEILINGS) == list(SIZES)


@pytest.mark.parametrize("name", SIZES)
def test_nothing_is_larger_than_its_ceiling(name):
    above = SIZES[name] - CEILINGS[name]
    assert above <= 0, (
        f"{name}: {SIZES[name]}, {above} higher than the ceiling {CEILINGS[name]} → remove as much "
        f"elsewhere, or give a reason and raise `{name}` under [tool.pkmcal.size] in "
        "pyproject.toml. What became smaller lowers its ceiling: python -m benchmarks.size --lower"
    )
