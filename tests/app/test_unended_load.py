"""A load without an end is named by whatever fails in its folder."""

import pytest
from paper_campaign import LOAD_BEGUN, new_campaign

from campaigns.journal.records import Finding

BEGUN = "; a load of robot-compensated.yaml was begun at "
FAILING = (
    ("run",),  # no plan
    ("load", "--controller", "tcp://127.0.0.1:9"),
    ("load", "--robot", "nowhere.yaml"),
    ("export", "--format", "gossip"),
    ("identify", "--fre", "x"),
    ("history",),
)


@pytest.fixture
def paper(tmp_path):
    return new_campaign(tmp_path / "c d")


@pytest.mark.parametrize("words", FAILING, ids=" ".join)
def test_every_error_names_the_open_load_until_it_has_an_end(paper, pkmcal, words):
    command, *options = words
    with paper.journal() as journal:
        journal.append(LOAD_BEGUN)
    failed = pkmcal(command, paper.folder, *options)
    assert failed.code > 0
    assert BEGUN in failed.error_line
    assert f"`pkmcal load '{paper.folder}' --dry` says what the controller" in failed.error_line
    with paper.journal() as journal:
        journal.append(Finding("load failed", {"begun": 1, "reason": ""}))
    assert BEGUN not in pkmcal(command, paper.folder, *options).error_line


def test_it_is_in_the_document_and_a_damaged_journal_is_another_matter(paper, pkmcal):
    with paper.journal() as journal:
        journal.append(LOAD_BEGUN)
    assert BEGUN in pkmcal("run", paper.folder, "--json").document["error"]["remedy"]
    paper.campaign.journal_path.write_bytes(b"no journal" * 100)
    assert BEGUN not in pkmcal("status", paper.folder).error_line
