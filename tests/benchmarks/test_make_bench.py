"""`make bench` itself, on yardsticks of the test's own."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

MAKEFILE = Path(__file__).parents[2] / "Makefile"


@pytest.fixture
def bench(tmp_path):
    """Runs `make bench` with these yardsticks, by name."""
    shutil.copy(MAKEFILE, tmp_path)
    (tmp_path / "pyproject.toml").touch()
    (tmp_path / "venv" / "bin").mkdir(parents=True)
    (tmp_path / "venv" / "bin" / "python").symlink_to(sys.executable)
    (tmp_path / "venv" / "installed-dev").touch()
    (tmp_path / "benchmarks").mkdir()

    def run(**yardsticks):
        for name, text in yardsticks.items():
            (tmp_path / "benchmarks" / f"{name}.py").write_text(text, encoding="utf-8")
        words = ["make", "--no-print-directory", "bench", "VENV=venv"]
        # A PYTHONPATH to our own tree would put its `benchmarks` before the test's.
        own = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        return subprocess.run(
            words, cwd=tmp_path, env=own, capture_output=True, text=True, check=False
        )

    return run


pytestmark = pytest.mark.skipif(shutil.which("make") is None, reason="there is no make here")


def test_a_missed_yardstick_does_not_keep_the_next_from_running_and_kept_ones_end_well(bench):
    done = bench(first="raise SystemExit(1)", second="print('measured')")
    assert "measured" in done.stdout
    assert done.returncode != 0
    assert done.stdout.splitlines()[-1] == "missed: first"
    done = bench(first="print('fast')")
    assert done.returncode == 0
    assert "missed" not in done.stdout
