"""A campaign that is never connected: its G-code runs on the real LinuxCNC beside a tracker.

The hidden robot follows LinuxCNC's joints; whenever they rest the tracker takes a point.
"""

import json
import shlex
import socket
import time

import pytest
from command_line import change
from linuxcnc_bench import NEEDS_LINUXCNC, world_controller
from linuxcnc_campaign import made_campaign, patient_driver, tell

from app.main import run_command
from app.wiring import connections
from campaigns.campaign import open_campaign
from sim.geometry import KINDS
from sim.robot.linuxcnc_joints import joint_source

pytestmark = [*NEEDS_LINUXCNC, pytest.mark.timeout(600), pytest.mark.long]

NAME, VARIANT = "linear-delta", "linear-delta"
SMALL = {
    "plan.shots": 48,
    "plan.validation_pairs": 5,
    "validation.repeatability_approaches": 3,
    "validation.line_points": 3,
    "controller.speed_percent": 50.0,
}
LIMITS = {
    "acceptance.distance_mean_mm": 0.05,
    "acceptance.distance_max_mm": 0.1,
    "acceptance.straightness_mm": 0.1,
    "acceptance.repeatability_mm": 0.1,
}
STILL_S, BEGINS_WITHIN_S, DWELL_S = 0.15, 0.6, "1"
MOST_COMMANDS = 14


class Rsh:
    """A person at LinuxCNC: opens a program, runs it, and sees when it has ended."""

    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=10.0)
        self.ask("hello EMC person 1.0", "set enable EMCTOO")

    def ask(self, *lines):
        for line in lines:
            self._socket.sendall(f"{line}\n".encode())
            time.sleep(0.05)
            said = self._socket.recv(4000).decode()
            assert "NAK" not in said, (line, said)
        return said

    def runs(self):
        return "IDLE" not in self.ask("get program_status")

    def close(self):
        self._socket.close()


class Cell:
    """LinuxCNC, and beside it a simulated tracker on the robot that it moves."""

    def __init__(self, linuxcnc, campaign):
        self.linuxcnc, self.campaign = linuxcnc, campaign

    def measured(self, program):
        """Points taken while a program runs, one at each place where the joints rest."""
        shown = self.linuxcnc.config / program.name
        shown.write_bytes(program.read_bytes())
        source = joint_source(f"hal:{self.linuxcnc.beside}", KINDS[NAME])
        points = []
        with connections(self.campaign) as to:
            with to.robot() as robot:
                robot.prepare()
            with to.tracker() as tracker:
                tracker.prepare(self.campaign.config.tracker.reflector, 0.1)
                rsh = Rsh(self.linuxcnc.port)
                rsh.ask("set mode auto", f"set open /mnt/config/{VARIANT}/{program.name}")
                before, taken = source.read(), False
                rsh.ask("set run")
                resting = time.monotonic() + BEGINS_WITHIN_S  # it may stand at the first stop
                while rsh.runs():
                    joints = source.read()
                    if abs(joints - before).max() > 1e-4:
                        before, resting, taken = joints, time.monotonic(), False
                    elif not taken and time.monotonic() - resting > STILL_S:
                        points.append(tracker.measure().point_in_tracker_mm)
                        taken = True
                rsh.close()
        source.close()
        return points


def test_offline_campaign_with_gcode_on_linuxcnc_passes(tmp_path, capsys, monkeypatch):
    patient_driver(monkeypatch, tmp_path)
    folder = tmp_path / "offline"

    def pkmcal(*words):
        capsys.readouterr()
        code = run_command([*map(str, words), "--json"])
        said = capsys.readouterr()
        assert code in {0, 1}, (words, said.err)
        return json.loads(said.out)

    with world_controller(tmp_path, VARIANT) as linuxcnc:
        cell = made_campaign(tmp_path / "cell", linuxcnc, NAME, {})
        beside = Cell(linuxcnc, open_campaign(cell))
        told = pkmcal("new", folder, "--robot", NAME, "--offline")
        tracker = beside.campaign.config.tracker
        own = {
            "tracker.place_mm": list(tracker.place_mm),
            "tracker.uncertainty": tracker.uncertainty.model_dump(),
        }
        change(folder / "campaign.yaml", SMALL | LIMITS | own)
        typed = []
        while told["next"] is not None and len(typed) < MOST_COMMANDS:
            words = shlex.split(told["next"])[1:]
            if words[-1] == "LANGUAGE":
                words = [*words[:-1], "gcode", "--dwell", DWELL_S]
            elif "--program" in words:
                words += ["--dwell", DWELL_S]
            elif words[0] == "export":
                pkmcal("export", folder, "--format", "linuxcnc", "--to", tmp_path / "calib.hal")
            if "FILE" in words:
                stage = words[-1] if "--stage" in words else "run"
                if stage == "after":  # a person puts the exported file into the controller
                    (linuxcnc.config / "calib.hal").write_bytes(
                        (tmp_path / "calib.hal").read_bytes()
                    )
                    linuxcnc.restart()
                points = beside.measured(folder / f"program-{stage}.ngc")
                lines = [f"shot{n} {' '.join(map(repr, p))}\n" for n, p in enumerate(points)]
                (tmp_path / f"{stage}.txt").write_text("".join(lines))
                words[words.index("FILE")] = str(tmp_path / f"{stage}.txt")
                words += ["--format", "ascii", "--unit", "mm", "--join", "order"]
                words += ["--joints", str(folder / f"program-{stage}-joints.csv")]
            typed.append(" ".join(words).replace(str(folder), "DIR"))
            told = pkmcal(*words)
            if "distances_mm" in told:
                with capsys.disabled():
                    tell(f"{words[words.index('--stage') + 1]}: {told['distances_mm']}")
    with capsys.disabled():
        tell("\n".join(typed))
    assert typed[-1] == "report DIR"
    assert told["decision"] == "pass"
