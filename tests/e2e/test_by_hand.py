"""Robot and tracker by hand: an operator at a pseudo-terminal, who errs, stops and goes on."""

import os
import pty
import re
import select
import subprocess

import numpy as np
import pytest
from command_line import PKMCAL, change

from campaigns.campaign import open_campaign
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Outcome, Rejected

BY_HAND = {"driver": "by-hand", "url": "by-hand"}
ESCAPE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
SILENT_S, TICK_S = 60.0, 0.5
STATION_MM = np.array([2500.0, 0.0, -500.0])
TO_TRACKER = np.diag([-1.0, -1.0, 1.0])


@pytest.fixture
def by_hand(tiny):
    change(tiny / "campaign.yaml", {"controller": BY_HAND, "tracker": BY_HAND | {"reflector": "C"}})
    return tiny


class Operator:
    """Does at the terminal what is asked; `point_of` says what he types of a point's joints."""

    def __init__(self, campaign, point_of=None):
        self.kinematics = campaign.robot.kinematics
        self.point_of = point_of or self.point
        self.joints_deg, self.points = None, 0
        self.said = ""

    def point(self, joints_deg):
        pose = self.kinematics.forward(np.radians([joints_deg])).values[0]
        point = TO_TRACKER @ (pose[:3] - STATION_MM)
        return "; ".join(f"{value:.4f}".replace(".", ",") for value in point)

    def answer(self, asked):
        """What he types; None while nothing is asked."""
        if asked.endswith("[y/N]"):
            return "n" if "Go on" in asked[-60:] else "y"
        if asked.endswith("[Enter: the same, u: the last shot again]"):
            shown = re.findall(r"= ([-\d. ]+) deg", asked)[-1]
            self.joints_deg = [float(each) for each in shown.split()]
            return ""
        if asked.endswith("display shows: q0 q1 q2 q3, deg"):
            return " ".join(map(str, self.joints_deg or (31.3, 31.3, 21.0, 21.0)))
        if asked.endswith("(-: none, u: the last shot again)"):
            self.points += 1
            return self.point_of(self.joints_deg)
        return None

    def waits(self):
        """Do what nobody asks for, while nothing is said."""

    def runs(self, *arguments):
        """Sit at a command until it ends; gives its exit code."""
        mine, program = pty.openpty()
        process = subprocess.Popen(
            [*PKMCAL, *map(str, arguments)],
            stdin=program,
            stdout=program,
            stderr=program,
            preexec_fn=lambda: os.login_tty(0),
            env={**os.environ, "TERM": "xterm", "COLUMNS": "200"},
        )
        os.close(program)
        heard = ""
        try:
            silent_s = 0.0
            while silent_s < SILENT_S:
                if not select.select([mine], [], [], TICK_S)[0]:
                    silent_s += TICK_S
                    self.waits()
                    continue
                silent_s = 0.0
                try:
                    piece = os.read(mine, 65536).decode(errors="replace")
                except OSError:
                    break
                self.said += piece
                heard += piece
                typed = self.answer(" ".join(ESCAPE.sub("", heard).split()))
                if typed is not None:
                    heard = ""
                    os.write(mine, typed.encode() + (b"" if typed == "\x03" else b"\n"))
            return process.wait(SILENT_S)
        finally:
            process.kill()
            process.wait()
            os.close(mine)


def records(folder, kind):
    with read_journal(folder / "campaign.db") as journal:
        return [entry.record for entry in journal.records_of(kind, 1)]


@pytest.mark.parametrize("device", ["controller", "tracker"])
def test_without_a_terminal_a_device_by_hand_is_refused_by_name(pkmcal, tiny, device):
    settings = BY_HAND | ({"reflector": "C"} if device == "tracker" else {})
    change(tiny / "campaign.yaml", {device: settings})
    assert pkmcal("devices", tiny, "--json").document[device]["serial"] == "by-hand"
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 2
    assert f"the {device} is worked by hand, and there is no terminal" in ended.error_line


@pytest.mark.long
def test_campaign_by_hand_is_gated_stopped_and_resumed(pkmcal, by_hand):
    def mistaken(joints_deg):
        """He stops after six points; the fifth is one that a wrong target gave."""
        if operator.points > 6:
            return "\x03"
        right = operator.point(joints_deg)
        return "; ".join(reversed(right.split("; "))) if operator.points == 5 else right

    campaign = open_campaign(by_hand)
    operator = Operator(campaign, mistaken)
    assert operator.runs("run", by_hand) == 130
    assert "the robot stands still, everything measured is kept" in operator.said
    kept = len(records(by_hand, Outcome))
    assert 0 < kept < 10
    (refused,) = [each for each in records(by_hand, Rejected) if "wrong target" in each.reason]
    assert refused.measured.raw_tracker.count(";") == 2
    again = Operator(campaign)
    again.joints_deg = operator.joints_deg
    assert again.runs("run", by_hand) == 0
    assert len(records(by_hand, Outcome)) > kept
    with read_journal(by_hand / "campaign.db") as journal:
        assert len(journal.shots(1)) == 10
    assert "the journal is intact" in pkmcal("check-journal", by_hand).out


class Software(Operator):
    """An operator whose tracker's own software appends a row whenever a shot is measured."""

    def __init__(self, campaign, file):
        super().__init__(campaign)
        self.file, self.rows = file, 0

    def waits(self):
        if self.said.count("measure now: waiting for a row in") > self.rows:
            self.rows += 1
            row = self.point(self.joints_deg).replace(",", ".")
            with self.file.open("a") as file:
                file.write(f"p{self.rows}; {row}\n")


@pytest.mark.long
def test_campaign_whose_trackers_software_writes_into_a_file(pkmcal, by_hand):
    watched = {"driver": "watch-file", "url": "file:points.txt", "reflector": "C"}
    change(by_hand / "campaign.yaml", {"tracker": watched})
    (by_hand / "points.txt").write_text("p0; 2000.0; 10.0; 20.0\n")
    operator = Software(open_campaign(by_hand), by_hand / "points.txt")
    assert operator.runs("run", by_hand) == 0, operator.said
    assert f"waiting for a row in {by_hand / 'points.txt'} (10 min)" in operator.said
    assert re.search(r"shot \d+: residual 0\.\d+ mm, .* · 10 of 10", operator.said)
    with read_journal(by_hand / "campaign.db") as journal:
        assert len(journal.shots(1)) == 10
    assert "the journal is intact" in pkmcal("check-journal", by_hand).out
