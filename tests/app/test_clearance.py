"""The operator's yes before anything moves: who is asked what, and about which devices."""

import io
from types import SimpleNamespace

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


JOB = SimpleNamespace(campaign=None, brief=lambda devices: f"12 shots, {serials(devices)}")


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
        clearance = Clearance(JOB, Terminal(as_json=False), yes=False)
        try:
            clearance.ask()
        finally:
            assert capsys.readouterr().err == (
                "12 shots, controller R-1, tracker T-7. Is the cell clear? [y/N] "
            )
        return clearance

    return ask


def test_operator_is_told_what_will_be_done_with_which_devices_and_asked(asked, capsys):
    asked("y\n").check(FOUND)
    assert capsys.readouterr().err == "", "he knows it already"


def test_no_is_no(asked):
    with pytest.raises(NotConfirmed):
        asked("n\n")


def test_others_than_were_told_are_not_measured_with(asked):
    clearance = asked("y\n")
    with pytest.raises(WrongDevice, match=r"tracker T-8 answer now, .* it was .* tracker T-7"):
        clearance.check(OTHER)


def test_nobody_is_asked_who_is_not_there_and_no_device_either(monkeypatch):
    monkeypatch.setattr("app.measuring.connected_cell", None)
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    with pytest.raises(NotConfirmed, match="--yes"):
        Clearance(JOB, Terminal(as_json=False), yes=False).ask()


def test_a_yes_given_before_is_told_the_same_once(capsys):
    clearance = Clearance(JOB, Terminal(as_json=False), yes=True)
    for _ in range(2):
        clearance.check(FOUND)
    assert capsys.readouterr().err == "12 shots, controller R-1, tracker T-7\n"
    with pytest.raises(WrongDevice):
        clearance.check(OTHER)
