"""Commands, run in the process of the tests."""

import pytest
from command_line import CommandLine


@pytest.fixture
def pkmcal(capsys):
    """Runs a command; gives its exit code, its answer and what it said."""
    return CommandLine(capsys)
