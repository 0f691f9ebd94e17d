"""A new journal, open."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from journal_story import ticking

from campaigns.journal.journal import Journal, open_journal


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "campaign.db"


@pytest.fixture
def journal(path: Path) -> Iterator[Journal]:
    with open_journal(path, now_utc=ticking()) as journal:
        yield journal
