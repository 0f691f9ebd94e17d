"""Connections to one device, one after another: closed by failure, recognised, prepared anew."""

import pytest

from drivers.errors import DeviceNotReady, LinkDown, WrongDevice
from drivers.session import PreparedTracker
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


class Tracker(PreparedTracker):
    """One whose other side answers what a test lets it; `wires` are the connections so far."""

    def __init__(self):
        super().__init__(open_transport=None, clock=None)
        self.wires = []
        self.answers = device()
        self.prepared_with = []
        self.session = self._session

    def _opened(self):
        self.wires.append(Wire(len(self.wires)))
        return self.wires[-1]

    def _who(self, client):
        assert client.is_open
        if isinstance(self.answers, BaseException):
            raise self.answers
        return self.answers

    def _set_up(self, client, wanted):
        self.prepared_with.append(wanted)
        if wanted == "impossible":
            raise DeviceNotReady("no such reflector", remedy="-")
        return f"{wanted} over {client.name}"

    def prepare(self, reflector):
        self._prepare(reflector)

    def measure(self):
        return self._prepared()


def connected():
    far = Tracker()
    far.connect()
    return far


def test_opening_anew_closes_the_connection_before():
    far = connected()
    far.connect()
    assert [wire.is_open for wire in far.wires] == [False, True]
    assert far.session.connection is far.wires[1]


@pytest.mark.parametrize("failure", [LinkDown("silence", remedy="-"), KeyboardInterrupt()])
def test_greeting_that_comes_to_no_end_leaves_no_connection_open(failure):
    far = Tracker()
    far.answers = failure
    with pytest.raises(type(failure)):
        far.connect()
    assert not far.wires[0].is_open


def test_another_device_is_refused_and_the_first_one_still_known():
    far = connected()
    far.answers = device("2")
    with pytest.raises(WrongDevice, match=r"pipe://test/1: .*serial 2 .*it was .*serial 1"):
        far.connect()
    assert not far.session.is_open
    far.answers = device("1")
    far.connect()
    assert far.session.identity == device("1")


def test_nothing_is_asked_over_a_closed_connection():
    far = Tracker()
    with pytest.raises(LinkDown, match=r"^the tracker is not connected"):
        far.session.connection.ask()
    far.connect()
    far.wires[0].close()
    for asked in ("connection", "identity"):
        with pytest.raises(LinkDown, match=r"pipe://test/0: .*the tracker is not connected"):
            getattr(far.session, asked)


def test_preparation_is_lost_with_the_connection_or_by_failing_and_set_anew():
    far = connected()
    far.prepare("CCR")
    far.connect()
    with pytest.raises(DeviceNotReady, match="the tracker is not prepared"):
        far.measure()
    far.reconnect()
    assert far.measure() == (far.wires[2], "CCR", "CCR over pipe://test/2")
    far = connected()
    far.prepare("CCR")
    with pytest.raises(DeviceNotReady, match="no such reflector"):
        far.prepare("impossible")
    with pytest.raises(DeviceNotReady, match="not prepared"):
        far.measure()
    with pytest.raises(DeviceNotReady, match="no such reflector"):
        far.reconnect()


def test_device_that_was_never_prepared_is_not_prepared_again():
    far = connected()
    far.reconnect()
    assert far.prepared_with == []
