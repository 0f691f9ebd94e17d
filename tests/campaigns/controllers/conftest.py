"""A campaign whose identified set is exported, made once for all tests of controllers."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from paper_campaign import PaperCampaign, new_campaign

from campaigns.settings.sections import AcceptanceConfig
from campaigns.workflow.exporting import export

LIMITS = AcceptanceConfig(
    distance_mean_mm=0.1,
    distance_max_mm=0.2,
    rotation_mm=0.5,
    straightness_mm=0.5,
    repeatability_mm=0.1,
)


@pytest.fixture(scope="session")
def exported_once(tmp_path_factory: pytest.TempPathFactory) -> PaperCampaign:
    """Measured, identified and exported; leave it as it is."""
    paper = new_campaign(tmp_path_factory.mktemp("controllers") / "paper", acceptance=LIMITS)
    paper.run(pairs=40, unseen=4)
    paper.identify()
    export(paper.campaign)
    return paper


def copy_of(exported: PaperCampaign, folder: Path) -> PaperCampaign:
    shutil.copytree(exported.folder, folder)
    campaign = replace(exported.campaign, folder=folder)
    return PaperCampaign(folder, campaign, np.random.default_rng(9))


@pytest.fixture
def paper(exported_once: PaperCampaign, tmp_path: Path) -> PaperCampaign:
    """A copy of it; nothing is loaded."""
    return copy_of(exported_once, tmp_path / "paper")


@pytest.fixture(scope="module")
def shared_paper(
    exported_once: PaperCampaign, tmp_path_factory: pytest.TempPathFactory
) -> PaperCampaign:
    """A copy of it for all tests of a module."""
    return copy_of(exported_once, tmp_path_factory.mktemp("shared") / "paper")
