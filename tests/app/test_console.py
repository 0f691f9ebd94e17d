"""The terminal: what goes where, and who is asked."""

import io
import json

import pytest
from command_line import Keyboard
from rich.console import Console

from app.console import Terminal
from app.exits import NotConfirmed


def test_answers_and_talk_go_apart(capsys):
    terminal = Terminal(as_json=False)
    terminal.say("the answer [1]")
    terminal.note("some talk")
    terminal.conclude({"a": 1})
    captured = capsys.readouterr()
    assert captured.out == "the answer [1]\n"
    assert captured.err == "some talk\n"


def test_with_json_stdout_holds_the_document_alone(capsys):
    terminal = Terminal(as_json=True)
    terminal.say("the answer")
    terminal.table("Title", ("", "value"), [("a", "1")])
    terminal.listing("Things", {"b": "2"})
    terminal.conclude({"σ": 0.5})
    captured = capsys.readouterr()
    assert json.loads(captured.out)["σ"] == 0.5
    for word in ("the answer", "Title", "Things"):
        assert word in captured.err


def test_a_document_never_holds_what_is_no_json():
    with pytest.raises(ValueError, match="Out of range"):
        Terminal(as_json=True).conclude({"a": float("nan")})


def test_a_long_line_is_not_broken(capsys):
    Terminal(as_json=False).say("word " * 100)
    assert capsys.readouterr().out.count("\n") == 1


@pytest.mark.parametrize("is_terminal", [True, False])
def test_what_a_long_work_is_at_is_shown_on_a_terminal_and_nowhere_else(is_terminal):
    screen, terminal = io.StringIO(), Terminal(as_json=False)
    terminal._talk = Console(file=screen, force_terminal=is_terminal, width=80)
    with terminal.telling("reading") as now_at:
        now_at("figure 2 of 3")
    assert ("2 of 3" in screen.getvalue()) is is_terminal


def test_without_a_terminal_nobody_says_yes(capsys, monkeypatch):
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    terminal = Terminal(as_json=False)
    assert not terminal.asks("Sure?")
    with pytest.raises(NotConfirmed, match="--yes"):
        terminal.require_yes("Sure?", yes=False)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("typed", "is_yes"),
    [("y\n", True), ("YES\n", True), (" y \n", True), ("n\n", False), ("\n", False), ("", False)],
)
def test_only_yes_is_yes(capsys, monkeypatch, typed, is_yes):
    monkeypatch.setattr("sys.stdin", Keyboard(typed))
    assert Terminal(as_json=True).asks("Sure?") is is_yes
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "Sure? [y/N] "
