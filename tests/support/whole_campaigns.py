"""Whole campaigns as fixtures, made once for all tests that only read them; and commands."""

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from command_line import CommandLine
    from paper_campaign import PaperCampaign

    from campaigns.evidence import Evaluation


@pytest.fixture
def pkmcal(capsys: pytest.CaptureFixture[str]) -> "CommandLine":
    """Runs a command in the process of the tests; gives its exit code, its answer and its words."""
    from command_line import CommandLine

    return CommandLine(capsys)


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> "PaperCampaign":
    """A campaign in which everything was done; leave it as it is."""
    from paper_campaign import whole_campaign  # what a test of a driver need not wait for

    return whole_campaign(tmp_path_factory.mktemp("campaigns") / "whole")


@pytest.fixture(scope="session")
def evaluation(whole: "PaperCampaign") -> "Evaluation":
    """What is said of it."""
    from campaigns.evidence import evaluate

    return evaluate(whole.campaign)
