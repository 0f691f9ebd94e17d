"""Seeds in other processes: a stop is a stop."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[2]


@pytest.mark.parametrize(("how", "processes"), [("SIGINT", 1), ("SIGTERM", 2)])
def test_no_worker_outlives_the_seeds(how, processes):
    """In processes of their own: the workers' helper process would outlive this test.

    The seeds would take longer than this waits for them.
    """
    ended = subprocess.run(
        [sys.executable, str(HERE / "stopped_workers.py"), how, str(processes)],
        capture_output=True,
        text=True,
        timeout=110,
        cwd=REPOSITORY,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(REPOSITORY), str(HERE)])},
        start_new_session=True,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.split() == ["Interrupted", "gone"]
    assert "Warning" not in ended.stderr
