"""What opens no device works on a system without POSIX's locks, terminals and signals.

It lacks what Windows lacks, and its default encoding is ASCII: nothing here has run on Windows.
"""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SHOTS = ROOT / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"
OFFLINE = (
    "tests/app/test_import_command.py",
    "tests/app/test_status_command.py",
    "tests/campaigns/files/test_csv_file.py",
    "tests/campaigns/files/test_lock.py",
    "tests/campaigns/files/test_yaml_file.py",
    "tests/campaigns/journal",
    "tests/campaigns/settings",
    "tests/campaigns/shots",
)
"""Tests of what opens no device."""
ASCII = {"PYTHONUTF8": "0", "LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}


def without_posix(*words, typed=""):
    """Run Python on such a system; return how it ended."""
    paths = os.pathsep.join(map(str, (ROOT, ROOT / "tests" / "support")))
    return subprocess.run(
        [sys.executable, *map(str, words)],
        cwd=ROOT,
        env=os.environ | ASCII | {"PYTHONPATH": paths},
        input=typed,
        capture_output=True,
        encoding="utf-8",
        timeout=110,
    )


def commanded(*commands):
    """Run commands on such a system, one after the other."""
    typed = json.dumps([[*map(str, words)] for words in commands])
    return without_posix("-X", "warn_default_encoding", "-m", "without_posix", typed=typed)


def test_an_offline_campaign_from_its_folder_to_its_page(tmp_path):
    folder, shots = tmp_path / "first try", tmp_path / "shots.csv"
    shots.write_bytes(SHOTS.read_bytes().replace(b"\n", b"\r\n"))
    (poses := tmp_path / "poses.csv").write_bytes(b"x_mm,y_mm,z_mm,theta_deg\r\n10,5,-575,0\r\n")
    ended = commanded(
        ("new", folder, "--offline"),
        ("plan", folder, "--shots", 30),
        ("import", folder, shots),
        ("identify", folder, "--hold-out", "20%"),
        ("export", folder),
        ("correct", folder, "--poses", poses),
        ("status", folder),
        ("history", folder),
        ("report", folder),
        ("study", folder, "--campaigns", 2, "--scenario", "paper-simulation"),
        ("robot", "delta", "--base", 200, "--platform", 45, "--arm", 300, "--forearm", 800,
         "--to", tmp_path / "my.yaml"),
        ("check-journal", folder),
    )  # fmt: skip
    assert (ended.returncode, "Traceback" in ended.stderr) == (0, False), ended.stderr
    assert "the journal is intact" in ended.stdout
    assert (folder / "robot-compensated.yaml").read_bytes().count(b"\r") == 0
    assert (tmp_path / "poses-corrected.csv").read_bytes().count(b"\r") == 0
    assert "σ" in (folder / "report.html").read_text(encoding="utf-8")


def test_a_simulated_robot_is_measured_and_a_real_one_is_refused_in_a_line(planned_once, tmp_path):
    real, simulated = tmp_path / "real", shutil.copytree(planned_once, tmp_path / "simulated")
    urls = ("--controller", "tcp://127.0.0.1:9", "--tracker", "tcp://127.0.0.1:9")
    made = ("new", real, *urls), ("plan", real)
    ended = commanded(("run", simulated, "--yes"), ("identify", simulated), *made)
    assert ended.returncode == 0, ended.stderr
    for words in (("run", real, "--yes"), ("devices", real), ("check", real, "--yes")):
        ended = commanded(words)
        last = ended.stderr.splitlines()[-1]
        assert (ended.returncode, last.startswith("pkmcal: ")) == (2, True), ended.stderr
        assert "Linux or macOS" in last


@pytest.mark.timeout(120)
def test_the_tests_of_what_opens_no_device_pass(tmp_path):
    options = ("-q", "-p", "no:cacheprovider", "-o", "timeout_method=thread", "-m", "not slow",
               "--basetemp", tmp_path / "tests", "-k", "not without_locks")  # fmt: skip
    ended = without_posix("-m", "pytest", "-p", "without_posix", *options, *OFFLINE)
    assert ended.returncode == 0, ended.stdout
    assert int(ended.stdout.split(" passed")[0].split()[-1]) > 100
