"""Parameters into the controller, out of it again, and whether they made it better."""

import signal

import campaigns.chain.loading
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Finding


def test_load_keeps_the_old_and_can_be_rolled_back(pkmcal, exported):
    shown = pkmcal("load", exported, "--dry")
    assert shown.code == 0
    assert "Δ/σ" in shown.out
    assert "nothing was written" in shown.out
    assert not list(exported.glob("controller-before-*"))
    loaded = pkmcal("load", exported, "--yes", "--json")
    assert loaded.document["kept"] == str(exported / "controller-before-1.yaml")
    again = pkmcal("load", exported, "--yes")
    assert again.code == 0
    assert "holds these already" in again.out
    back = pkmcal("load", exported, "--rollback", "--yes", "--json")
    assert back.document["loaded"] == str(exported / "controller-before-1.yaml")
    assert back.document["kept"] == str(exported / "controller-before-2.yaml")
    nothing = pkmcal("load", exported, "--file", exported / "robot.yaml", "--yes")
    assert "holds these already" in nothing.out


def test_ctrl_c_while_loading_waits_until_it_is_verified(pkmcal, exported, monkeypatch):
    write_verified = campaigns.chain.loading.write_verified

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        write_verified(*arguments)

    monkeypatch.setattr(campaigns.chain.loading, "write_verified", interrupted)
    ended = pkmcal("load", exported, "--yes")
    assert ended.code == 130
    with read_journal(exported / "campaign.db") as journal:
        assert [e.record.kind for e in journal.records_of(Finding)][-1] == "load"
    assert "holds these already" in pkmcal("load", exported, "--yes").out


def test_rollback_without_a_load(pkmcal, exported):
    ended = pkmcal("load", exported, "--rollback", "--yes")
    assert ended.code == 2
    assert "nothing was loaded here yet" in ended.error_line


def test_a_load_that_made_it_worse_is_not_good(pkmcal, exported):
    distances = ("--only", "distances", "--yes")
    assert pkmcal("load", exported, "--yes").code == 0
    assert pkmcal("validate", exported, "--stage", "before", *distances).code == 0
    assert pkmcal("load", exported, "--rollback", "--yes").code == 0
    ended = pkmcal("validate", exported, "--stage", "after", *distances)
    assert ended.code == 1
    assert "not good: distances, mean error" in ended.out
    assert "before loading it was" in ended.out
