"""A report needs no home: services and containers have none that can be written."""

import os
import subprocess
import sys

import pytest


@pytest.mark.slow
def test_pictures_where_the_home_cannot_be_written_are_drawn_without_a_word(tmp_path):
    keys = {"XDG_CACHE_HOME", "XDG_CONFIG_HOME", "MPLCONFIGDIR"}
    kept = {key: value for key, value in os.environ.items() if key not in keys}
    environment = {**kept, "HOME": "/proc", "TMPDIR": str(tmp_path)}
    drawing = [sys.executable, "-c", "import app.report.drawing"]
    done = subprocess.run(drawing, env=environment, capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert [*tmp_path.iterdir()] == []
