"""Connections to one device, one after another: closed by failure, recognised, prepared anew."""

import pytest

from drivers.errors import DeviceNotReady, LinkDown, WrongDevice
from drivers.session import PreparedSession
from drivers.values import Identity


def device(serial="1"):
    return Identity("Example", "Tracker", serial, "1.0", "test")


class Wire:
    """A connection that only knows whether it is open."""

    def __init__(self, number):
        self.name = f"pipe://test/{number}"
        self.is_open = True

    def close(self):
        self.is_open = False


class FarEnd:
    """What a test lets the other side answer; `wires` are the connections so far."""

    def __init__(self):
        self.wires = []
        self.answers = device()
        self.prepared_with = []
        self.session = PreparedSession("tracker", self.opened, self.greet, self.set_up)

    def opened(self):
        self.wires.append(Wire(len(self.wires)))
        return self.wires[-1]

    def greet(self, wire):
        assert wire.is_open
        if isinstance(self.answers, BaseException):
            raise self.answers
        return self.answers

    def set_up(self, wire, wanted):
        self.prepared_with.append(wanted)
        if wanted == "impossible":
            raise DeviceNotReady("no such reflector", remedy="-")
        return f"{wanted} over {wire.name}"


def connected():
    far = FarEnd()
    far.session.open()
    return far


def test_opening_anew_closes_the_connection_before():
    far = connected()
    far.session.open()
    assert [wire.is_open for wire in far.wires] == [False, True]
    assert far.session.connection is far.wires[1]


@pytest.mark.parametrize("failure", [LinkDown("silence", remedy="-"), KeyboardInterrupt()])
def test_greeting_that_comes_to_no_end_leaves_no_connection_open(failure):
    far = FarEnd()
    far.answers = failure
    with pytest.raises(type(failure)):
        far.session.open()
    assert not far.wires[0].is_open


def test_another_device_is_refused_and_the_first_one_still_known():
    far = connected()
    far.answers = device("2")
    with pytest.raises(WrongDevice, match=r"pipe://test/1: .*serial 2 .*it was .*serial 1"):
        far.session.open()
    assert not far.session.is_open
    far.answers = device("1")
    far.session.open()
    assert far.session.identity == device("1")


def test_nothing_is_asked_over_a_closed_connection():
    far = FarEnd()
    with pytest.raises(LinkDown, match=r"^the tracker is not connected"):
        far.session.connection.ask()
    far.session.open()
    far.wires[0].close()
    for asked in ("connection", "identity"):
        with pytest.raises(LinkDown, match=r"pipe://test/0: .*the tracker is not connected"):
            getattr(far.session, asked)


def test_preparation_is_lost_with_the_connection_or_by_failing_and_set_anew():
    far = connected()
    far.session.prepare("CCR")
    far.session.open()
    with pytest.raises(DeviceNotReady, match="the tracker is not prepared"):
        far.session.prepared()
    far.session.prepare_again()
    assert far.session.prepared() == (far.wires[1], "CCR", "CCR over pipe://test/1")
    far = connected()
    far.session.prepare("CCR")
    with pytest.raises(DeviceNotReady, match="no such reflector"):
        far.session.prepare("impossible")
    with pytest.raises(DeviceNotReady, match="not prepared"):
        far.session.prepared()
    with pytest.raises(DeviceNotReady, match="no such reflector"):
        far.session.prepare_again()


def test_device_that_was_never_prepared_is_not_prepared_again():
    far = connected()
    far.session.prepare_again()
    assert far.prepared_with == []
