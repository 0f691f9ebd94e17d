"""A campaign whose identified set is exported, made once for all tests of controllers."""

from pathlib import Path

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


@pytest.fixture
def paper(exported_once: PaperCampaign, tmp_path: Path) -> PaperCampaign:
    """A copy of it; nothing is loaded."""
    return exported_once.copy_to(tmp_path / "paper")


@pytest.fixture(scope="module")
def shared_paper(
    exported_once: PaperCampaign, tmp_path_factory: pytest.TempPathFactory
) -> PaperCampaign:
    """A copy of it for all tests of a module."""
    return exported_once.copy_to(tmp_path_factory.mktemp("shared") / "paper")
