"""The Python page's examples run as they stand, one after the other in one folder."""

import shutil
from pathlib import Path

import pytest
from pages import ROOT, blocks

EXAMPLES = [block for block in blocks("python") if block.where.startswith("docs/python.md")]
MOST_LINES = 10
SHOTS = ROOT / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"


def test_there_are_six_examples_of_at_most_ten_lines():
    lengths = [len(list(filter(None, block.text.splitlines()))) for block in EXAMPLES]
    assert len(lengths) == 6
    assert max(lengths) <= MOST_LINES


@pytest.mark.long
def test_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(SHOTS, Path("shots.csv"))
    for block in EXAMPLES:
        exec(compile(block.text, block.where, "exec"), {})
        assert capsys.readouterr().out, f"{block.where} says nothing"
