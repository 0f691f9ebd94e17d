"""The operator's yes before anything moves: who is asked what, and about which devices."""

import io

import pytest
from command_line import Keyboard

from app.console import Terminal
from app.exits import NotConfirmed
from app.measuring import Clearance
from app.run_text import serials
from drivers.errors import WrongDevice
from drivers.values import Identity

ROBOT = Identity("Acme", "Par4", "R-1", "1.0", "robotline 1")
TRACKER = Identity("Leica", "AT403", "T-7", "2.3", "emScon")
FOUND = (ROBOT, TRACKER)
OTHER = (ROBOT, Identity("Leica", "AT403", "T-8", "2.3", "emScon"))


def briefing(devices):
    return f"12 shots, {serials(devices)}"


class Devices:
    """Stands for a connected cell."""

    def __init__(self, found):
        self.robot = self.tracker = self
        self._answers = [*found]

    def identity(self):
        return self._answers.pop(0)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None


@pytest.fixture
def asked(monkeypatch, capsys):
    """Asks an operator who answers; gives the clearance and what he was asked."""

    def ask(answer):
        monkeypatch.setattr("app.measuring.connected_cell", lambda _: Devices(FOUND))
        monkeypatch.setattr("sys.stdin", Keyboard(answer))
        clearance, terminal = Clearance(briefing, yes=False), Terminal(as_json=False)
        try:
            clearance.obtain(None, terminal)
        finally:
            assert capsys.readouterr().err == (
                "12 shots, controller R-1, tracker T-7. Is the cell clear? [y/N] "
            )
        return clearance, terminal

    return ask


def test_operator_is_told_what_will_be_done_with_which_devices_and_asked(asked, capsys):
    clearance, terminal = asked("y\n")
    clearance.check(FOUND, terminal)
    assert capsys.readouterr().err == "", "he knows it already"


def test_no_is_no(asked):
    with pytest.raises(NotConfirmed):
        asked("n\n")


def test_others_than_were_told_are_not_measured_with(asked):
    clearance, terminal = asked("y\n")
    with pytest.raises(WrongDevice, match=r"tracker T-8 answer now, .* it was .* tracker T-7"):
        clearance.check(OTHER, terminal)


def test_nobody_is_asked_who_is_not_there_and_no_device_either(monkeypatch):
    monkeypatch.setattr("app.measuring.connected_cell", None)
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    with pytest.raises(NotConfirmed, match="--yes"):
        Clearance(briefing, yes=False).obtain(None, Terminal(as_json=False))


def test_a_yes_given_before_is_told_the_same_once(monkeypatch, capsys):
    monkeypatch.setattr("app.measuring.connected_cell", None)
    clearance, terminal = Clearance(briefing, yes=True), Terminal(as_json=False)
    clearance.obtain(None, terminal)
    for _ in range(2):
        clearance.check(FOUND, terminal)
    assert capsys.readouterr().err == "12 shots, controller R-1, tracker T-7\n"
    with pytest.raises(WrongDevice):
        clearance.check(OTHER, terminal)
