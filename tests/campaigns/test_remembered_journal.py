"""A long journal that was verified is not hashed again, and a changed byte of it is found."""

import pytest
from paper_campaign import new_campaign

from campaigns import campaign as campaigns
from campaigns.campaign import open_campaign
from campaigns.files import memory
from campaigns.journal import digest_chain
from campaigns.journal.digest_chain import JournalDamaged
from campaigns.journal.records import Event


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Campaign whose journal counts as long, and was verified by a command."""
    monkeypatch.setenv("PKMCAL_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(campaigns, "MANY_RECORDS", 3)
    paper = new_campaign(tmp_path / "c")
    paper.run(pairs=3, unseen=1)
    read(paper.folder)
    return paper.folder


@pytest.fixture
def hashed(folder, monkeypatch):
    """Numbers of the records that were hashed since."""
    found, digest_after = [], digest_chain.digest_after

    def counted(before, content):
        found.append(content[0])
        return digest_after(before, content)

    monkeypatch.setattr(digest_chain, "digest_after", counted)
    return found


def read(folder):
    with open_campaign(folder).journal_reader() as journal:
        return journal.records(), journal.digest(), journal.end()


def noted(folder):
    with open_campaign(folder).journal() as journal:
        return journal.append(Event("operator note", "moved"))


def test_what_was_verified_is_not_hashed_again(folder, hashed):
    records, _, end = read(folder)
    assert hashed == []
    assert end.number == len(records) > 3


def test_what_was_written_since_is_hashed_alone(folder, hashed):
    _, before, _ = read(folder)
    last = noted(folder)
    hashed.clear()
    records, digest, end = read(folder)
    assert (hashed, records[-1].number, end.number) == ([last], last, last)
    assert digest != before
    with open_campaign(folder).journal_reader() as journal:
        assert journal.digest(through=last - 1) == before


@pytest.mark.parametrize("column", [1, 6, 7], ids=["time", "body", "digest"])
@pytest.mark.parametrize("record", [0, 7, 19])
def test_a_changed_byte_is_found(folder, record, column):
    with open_campaign(folder).journal_reader() as journal:
        text = journal.verified[record][column].encode()
    file = folder / "campaign.db"
    stored = bytearray(file.read_bytes())
    last_digit = max(place for place, byte in enumerate(text) if byte in b"0123456789")
    stored[stored.index(text) + last_digit] ^= 1  # another digit: the record can be read
    file.write_bytes(stored)
    with pytest.raises(JournalDamaged, match="was changed after it was written"):
        read(folder)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda text: text[:-3],
        lambda text: "[]",
        lambda text: text.replace('"records": ', '"records": 1'),
        lambda text: text.replace('"records": ', '"records": -'),
        lambda text: text.replace('"content": "', '"content": "0'),
        lambda text: text.replace('"software": "', '"software": "0'),
    ],
)
def test_a_spoilt_memory_counts_for_nothing(folder, hashed, tmp_path, spoil):
    whole = read(folder)
    (file,) = (tmp_path / "cache" / "pkmcal").iterdir()
    file.write_text(spoil(file.read_text(encoding="utf-8")), encoding="utf-8")
    assert read(folder) == whole
    assert hashed == [each.number for each in whole[0]]


def test_other_software_verifies_itself(folder, hashed, monkeypatch):
    whole = read(folder)
    monkeypatch.setattr(memory, "VERSION", "0.0.9")
    assert read(folder) == whole
    assert hashed == [each.number for each in whole[0]]


def test_a_short_journal_is_not_remembered(folder, hashed, monkeypatch):
    monkeypatch.setattr(campaigns, "MANY_RECORDS", 1000)
    whole = read(folder)
    assert hashed == [each.number for each in whole[0]]
