"""Whole campaigns as fixtures, for all tests that only read them."""

import pytest
from paper_campaign import PaperCampaign, whole_campaign

from campaigns.estimation.estimators import Estimator


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> PaperCampaign:
    """A campaign in which everything was done; leave it as it is."""
    return whole_campaign(tmp_path_factory.mktemp("campaigns") / "whole")


@pytest.fixture(scope="session")
def by_distances(tmp_path_factory: pytest.TempPathFactory) -> PaperCampaign:
    """The same, identified from distances; leave it as it is."""
    return whole_campaign(tmp_path_factory.mktemp("campaigns") / "pairs", Estimator.DISTANCES)
