"""The walks that add a driver, a mechanism, a source of error: done in a copy, and tried there."""

import os
import shutil
import subprocess
import sys
from itertools import groupby
from pathlib import Path

import pytest
from pages import ROOT, Block, blocks_of

PAGE = ROOT / "CONTRIBUTING.md"
SOURCES = ("app", "campaigns", "drivers", "sim", "pkmcal.py", "pyproject.toml")
ASKED = """
import socketserver, threading
from drivers.catalog import TRACKERS
from drivers.declaration import Surroundings
from drivers.names import TRACKER_NAMES
from drivers.ports import SystemClock
from drivers.transport import opener_of

class Instrument(socketserver.StreamRequestHandler):
    answers = {b"I": b"Maker Model 42", b"M": b"1.5 -2.5 1000.25"}

    def handle(self):
        for line in self.rfile:
            self.wfile.write(self.answers[line.strip()] + b"\\n")

with socketserver.ThreadingTCPServer(("127.0.0.1", 0), Instrument) as server:
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    opener = opener_of("tcp://127.0.0.1:%d" % server.server_address[1])
    driver = TRACKERS["askline"]
    tracker = driver.make(Surroundings(open_transport=opener, clock=SystemClock()))
    tracker.connect()
    tracker.prepare("ball", 0.1)
    taken = tracker.measure()
    print(tracker.identity().serial, taken.point_in_tracker_mm == driver.read_record(taken.raw)[0])
    print(taken.point_in_tracker_mm, "askline" in TRACKER_NAMES)
    tracker.close()
    server.shutdown()
"""
MEASURED = """
import numpy as np
from campaigns.kinematics.model import Kinematics
from campaigns.planning.plans import joints_of
from pkmcal import Shots, find_robot, identify, plan

robot, tracker_mm = find_robot("delta"), (2400.0, -300.0, -600.0)
shots = plan(robot, tracker_mm, shots=60, seed=3).shots
joints = joints_of(shots)
stated = {**robot.parameters, "arm1.ellipticity_sin_deg": 0.1}
poses = Kinematics.of(robot.mechanism, stated).forward(joints).values_or_raise()
points = poses[:, :3] - tracker_mm + np.random.default_rng(1).normal(0.0, 0.01, (len(poses), 3))
result = identify(Shots.of(joints, points, robot), robot)
ellipse = result.value.parameters["arm1.ellipticity_sin_deg"]
print(abs(ellipse.value - 0.1) < 3.0 * ellipse.std < 0.09, "ellipticity" in result.value.sizes)
"""
SIMULATED = """
from app.main import run_command

for words in ("new c --robot h4l", "plan c --shots 20", "run c --yes", "identify c"):
    assert run_command(words.split()) == 0, words
"""


def section(title: str) -> list[Block]:
    """The blocks of the section with this title that name a file."""
    text = PAGE.read_text(encoding="utf-8")
    begin = text.index(f"\n## {title}\n") + 1
    end = text.find("\n## ", begin)
    first, last = (text.count("\n", 0, place) + 1 for place in (begin, end))
    named = (block for block in blocks_of(PAGE) if block.text.startswith("# "))
    return [block for block in named if first < int(block.where.partition(":")[2]) < last]


def changed(text: str, lines: list[str]) -> str:
    """A file's text after a block's lines: removed ones begin with -, added ones with +."""
    for _, hunk in groupby(lines, lambda line: line == "@@"):
        shown = [line for line in hunk if line != "@@"]
        before = "".join(f"{line[1:]}\n" for line in shown if line[:1] != "+")
        after = "".join(f"{line[1:]}\n" for line in shown if line[:1] != "-")
        if shown:
            assert text.count(before) == 1, before
            text = text.replace(before, after)
    return text


def follow(walk: list[Block], folder: Path) -> tuple[int, int]:
    """Change a copy by the walk's blocks; returns how many files and lines that takes."""
    files, added = set(), 0
    for block in walk:
        head, *lines = block.text.splitlines()
        file = folder / head.removeprefix("# ")
        files.add(file)
        if block.language == "diff":
            file.write_text(changed(file.read_text(encoding="utf-8"), lines), encoding="utf-8")
            added += sum(line.startswith("+") for line in lines)
        else:
            assert not file.exists()
            file.write_text("\n".join(lines) + "\n", encoding="utf-8")
            added += len(lines)
    return len(files), added


@pytest.fixture
def copy(tmp_path):
    """A copy of the sources, without tests and pages."""
    for name in SOURCES:
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, tmp_path / name)
    return tmp_path


def said(program: str, folder: Path) -> str:
    """What a program says that runs by the copy."""
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = (sys.executable, "-c", program)
    ended = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=100
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout


def test_an_instrument_of_ones_own_is_asked_for_a_point(copy):
    files, lines = follow(section("Adding a protocol"), copy)
    assert files <= 4
    assert lines <= 79
    assert said(ASKED, copy).splitlines() == ["42 True", "(1.5, -2.5, 1000.25) True"]


@pytest.mark.slow
def test_a_new_source_of_error_is_found_in_a_robot_that_has_it(copy):
    files, lines = follow(section("Adding a source of error"), copy)
    assert (files, lines) == (3, 6)
    assert said(MEASURED, copy) == "True True\n"


@pytest.mark.slow
def test_a_new_mechanism_is_planned_measured_and_identified(copy):
    files, lines = follow(section("Adding a mechanism"), copy)
    assert files <= 3
    assert lines <= 20
    assert "of 76 parameters" in said(SIMULATED, copy)
