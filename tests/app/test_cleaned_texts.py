"""Texts of devices, files and operators: shown without hidden characters, wherever that is."""

import pytest

from app.console import Terminal
from app.main import run_command

HOSTILE = "SN-1\x1b[2J\x07\u202egpj\u2028two\x9b"
CLEAN = "SN-1?[2J??gpj two?"


def test_lines_tables_and_questions_are_cleaned(capsys):
    terminal = Terminal(as_json=False, verbose=True)
    terminal.say(HOSTILE)
    terminal.note(HOSTILE)
    terminal.detail(HOSTILE)
    terminal.listing(HOSTILE, {HOSTILE: HOSTILE})
    terminal.table(HOSTILE, ("", "value"), [(HOSTILE, HOSTILE)])
    captured = capsys.readouterr()
    shown = captured.out + captured.err
    assert shown.count(CLEAN) == 9
    assert not set(HOSTILE) & set("\x1b\x07\u202e\u2028\x9b") & set(shown)


@pytest.mark.parametrize("name", ["\x1b[2J", "a\x00b", "\u202egpj", "\udcff", "x" * 100_000])
def test_what_is_wrong_with_an_argument_is_said_in_one_clean_line(capsys, name):
    assert run_command(["import", name, name]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert error[:-1].isprintable()
    assert len(error) < 1000
