"""A tracker at the far end of a pipe, as most tests of its driver find it."""

import pytest
from scripted_emscon import Station


@pytest.fixture
def station():
    """An emScon tracker, prepared."""
    return Station().prepared()
