"""Runs of 12 pairs that are killed: every record in CI, each fourth of them elsewhere."""

import json
import os
import subprocess
import sys

import pytest

EVERY = 1 if os.environ.get("CI") else 4
KILLS = 12


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(600)
def test_killed_runs_lose_nothing_double_nothing_and_come_to_their_end():
    words = [f"--kills={KILLS}", f"--every={EVERY}", "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.torture.kills", *words],
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = {name: each["value"] for name, each in json.loads(done.stdout)["figures"].items()}
    assert figures["kills at random"] == KILLS
    assert figures["kills at a record"] == len(range(1, 61, EVERY))
    for where in ("at a record", "at random"):
        assert figures[f"records lost, kills {where}"] == 0
        assert figures[f"attempts or shots doubled, kills {where}"] == 0
        assert figures[f"points stored wrong, kills {where}"] == 0
        campaigns = figures[f"campaigns, kills {where}"]
        assert figures[f"campaigns completed, kills {where}"] == campaigns > 0
