"""Parameters into the controller, out of it again, and whether they made it better."""

import signal

from command_line import Keyboard

import campaigns.workflow.loading
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Finding


def test_load_verifies_keeps_the_old_and_can_be_rolled_back(pkmcal, exported):
    over = pkmcal("load", exported, "--rollback", "--yes")
    assert over.code == 2
    assert "no load is in effect that could be taken back" in over.error_line
    shown = pkmcal("load", exported, "--dry")
    assert shown.code == 0
    assert "Δ/σ" in shown.out
    assert "nothing was written" in shown.out
    assert not list(exported.glob("controller-before-*"))
    loaded = pkmcal("load", exported, "--verify", 2, "--yes", "--json").document
    assert loaded["kept"] == str(exported / "controller-before-1.yaml")
    assert loaded["verification"]["after_mm"] < loaded["verification"]["before_mm"]
    again = pkmcal("load", exported, "--yes")
    assert again.code == 0
    assert "holds these already" in again.out
    back = pkmcal("load", exported, "--rollback", "--yes", "--json")
    assert back.document["loaded"] == str(exported / "controller-before-1.yaml")
    assert back.document["kept"] == str(exported / "controller-before-2.yaml")
    nothing = pkmcal("load", exported, "--robot", exported / "robot.yaml", "--yes")
    assert "holds these already" in nothing.out


def test_ctrl_c_while_loading_waits_until_it_is_verified(pkmcal, exported, monkeypatch):
    write_verified = campaigns.workflow.loading.write_verified

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        write_verified(*arguments)

    monkeypatch.setattr(campaigns.workflow.loading, "write_verified", interrupted)
    ended = pkmcal("load", exported, "--yes")
    assert ended.code == 130
    assert "loaded and verified: " in ended.out
    assert "they are in →" in ended.error_line
    with read_journal(exported / "campaign.db") as journal:
        assert [e.record.kind for e in journal.records_of(Finding)][-1] == "load"
    assert "holds these already" in pkmcal("load", exported, "--yes").out


def test_the_question_names_the_controller_that_is_written_to(pkmcal, exported, monkeypatch):
    monkeypatch.setattr("sys.stdin", Keyboard("n\n"))
    refused = pkmcal("load", exported, "--verify", "2")
    assert refused.code == 2
    assert "these parameters into controller SIM-C-0001" in refused.err
    assert "not confirmed, nothing was done" in refused.err
    assert not list(exported.glob("controller-before-*"))
