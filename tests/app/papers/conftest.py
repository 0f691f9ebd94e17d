"""The evidence, which takes seconds, once for all tests of the paper."""

import pytest
from made_up import results

from app.papers.corbel2006.evidence import evidence


@pytest.fixture(scope="session")
def computed():
    """Evidence of one seed of each experiment."""
    return evidence(results(1))
