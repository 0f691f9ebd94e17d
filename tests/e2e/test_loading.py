"""Parameters into the controller, out of it again, and whether they made it better."""

import io
import signal

import pytest
from command_line import change

import campaigns.workflow.loading
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Event, Finding


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
    over = pkmcal("load", exported, "--rollback", "--yes")
    assert over.code == 2
    assert "no load is in effect" in over.error_line


def test_ctrl_c_while_loading_waits_until_it_is_verified(pkmcal, exported, monkeypatch):
    write_verified = campaigns.workflow.loading.write_verified

    def interrupted(*arguments):
        signal.raise_signal(signal.SIGINT)
        write_verified(*arguments)

    monkeypatch.setattr(campaigns.workflow.loading, "write_verified", interrupted)
    ended = pkmcal("load", exported, "--yes")
    assert ended.code == 130
    assert "loaded and verified: " in ended.out
    with read_journal(exported / "campaign.db") as journal:
        assert [e.record.kind for e in journal.records_of(Finding)][-1] == "load"
    assert "holds these already" in pkmcal("load", exported, "--yes").out


class Keyboard(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("words", [(), ("--verify", "2")])
def test_the_question_names_the_controller_that_is_written_to(pkmcal, exported, monkeypatch, words):
    monkeypatch.setattr("sys.stdin", Keyboard("n\n"))
    refused = pkmcal("load", exported, *words)
    assert refused.code == 2
    assert "these parameters into controller SIM-C-0001" in refused.err
    assert "not confirmed, nothing was done" in refused.err
    assert not list(exported.glob("controller-before-*"))


def test_rollback_without_a_load(pkmcal, exported):
    ended = pkmcal("load", exported, "--rollback", "--yes")
    assert ended.code == 2
    assert "no load is in effect that could be taken back" in ended.error_line


def test_an_arm_of_520_mm_is_refused_and_can_be_forced(pkmcal, exported):
    file = exported / "robot-compensated.yaml"
    change(file, {"geometry.arms.1.arm_mm": 520.0, "sha256": None})
    refused = pkmcal("load", exported, "--yes")
    assert refused.code == 2
    assert "arm1.arm_mm changed by +170 mm, tolerance ± 10 mm" in refused.error_line
    assert "--force loads it all the same" in refused.error_line
    forced = pkmcal("load", exported, "--yes", "--force", "--json").document
    assert forced["forced"] == ["arm1.arm_mm changed by +170 mm, tolerance ± 10 mm"]


def test_verified_load_is_kept_when_it_is_better_and_rolled_back_when_worse(pkmcal, exported):
    found = pkmcal("load", exported, "--verify", 2, "--yes", "--json").document
    assert found["verification"]["after_mm"] < found["verification"]["before_mm"]
    worse = ("load", exported, "--file", exported / "robot.yaml", "--verify", 2, "--yes")
    ended = pkmcal(*worse)
    assert ended.code == 1
    assert "distances of 2 pairs are off by" in ended.error_line
    assert "the controller holds the old parameters" in ended.error_line
    assert "holds these already" in pkmcal("load", exported, "--yes").out


@pytest.mark.parametrize("other", ["--file", "--verify"])
def test_rollback_takes_neither_file_nor_verification(pkmcal, exported, other):
    ended = pkmcal("load", exported, "--rollback", other, "1")
    assert ended.code == 2
    assert f"--rollback and {other} contradict each other" in ended.error_line


def test_the_wrong_stage_is_refused_and_a_load_that_made_it_worse_is_not_good(pkmcal, exported):
    distances = ("--only", "distances", "--yes")
    after = ("validate", exported, "--stage", "after", *distances)
    before = ("validate", exported, "--stage", "before", *distances)
    refused = pkmcal(*after)
    assert refused.code == 2
    assert "--stage after: the controller still holds the nominal" in refused.error_line
    assert pkmcal("load", exported, "--yes").code == 0
    refused = pkmcal(*before)
    assert refused.code == 2
    assert "the controller holds what was identified in this campaign" in refused.error_line
    assert pkmcal(*before, "--anyway").code == 0
    assert pkmcal("load", exported, "--rollback", "--yes").code == 0
    ended = pkmcal(*after, "--anyway")
    assert ended.code == 1
    assert "not good: distances, mean error" in ended.out
    assert "before loading it was" in ended.out
    gain = ended.out.partition("Gain (mm)")[2]
    assert "× more" in gain
    with read_journal(exported / "campaign.db") as journal:
        texts = [e.record.text for e in journal.records_of(Event) if e.record.kind == "wrong stage"]
    assert len(texts) == 2
    assert "still holds the nominal parameters" in texts[1]
