"""TCP over loopback and a serial line over a pseudo-terminal: both are byte pipes."""

import os
import re
import socket
import time

import pytest

from drivers.errors import LinkDown
from drivers.transport import opener_of


class Line:
    """The far end of a serial line."""

    def __init__(self):
        self.fd, self._line = os.openpty()
        self.url = f"serial://{os.ttyname(self._line)}"
        self.is_there = True

    def accept(self):
        """Nothing: who opens the line is connected."""

    def says(self, data):
        os.write(self.fd, data)

    def hears(self):
        return os.read(self.fd, 65536)

    def goes(self):
        """Be gone; a second time does nothing."""
        if self.is_there:
            os.close(self.fd)
            os.close(self._line)
        self.is_there = False


class Host:
    """The far end of a socket."""

    def __init__(self):
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = "127.0.0.1", self._server.getsockname()[1]
        self.url = f"tcp://127.0.0.1:{self.address[1]}"
        self.socket = None

    def accept(self):
        self.socket, _ = self._server.accept()

    def says(self, data):
        self.socket.sendall(data)

    def hears(self):
        return self.socket.recv(65536)

    def goes(self):
        self._server.close()
        if self.socket:
            self.socket.close()


@pytest.fixture(params=[Host, Line], ids=["host", "line"])
def device(request):
    device = request.param()
    yield device
    device.goes()


of_host = pytest.mark.parametrize("device", [Host], indirect=True)
of_line = pytest.mark.parametrize("device", [Line], indirect=True)


def opened(device):
    pipe = opener_of(device.url)(timeout_s=1.0)
    device.accept()
    return pipe


@pytest.fixture
def ours(device):
    ours = opened(device)
    yield ours
    ours.close()


def received(transport, count):
    data = b""
    while len(data) < count:
        data += transport.receive(1.0)
    return data


def test_every_byte_passes_unchanged_both_ways_at_once(device, ours):
    every_byte = bytes(range(256))
    ours.send(every_byte, 1.0)
    assert device.hears() == every_byte
    device.says(every_byte)
    assert received(ours, 256) == every_byte
    device.says(b"one line\nand another\n")
    assert ours.receive(1.0) == b"one line\nand another\n"
    assert ours.receive(0.0) == ours.receive(0.002) == b"", "silence is no error"
    assert ours.name == device.url


def test_device_that_reads_nothing_breaks_the_pipe_in_time(ours):
    started_s = time.monotonic()
    with pytest.raises(LinkDown, match="broke"):
        ours.send(b"x" * 50_000_000, 0.005)
    assert time.monotonic() - started_s < 1.0


def test_closed_pipe_refuses_every_call(ours):
    ours.close()
    ours.close()
    with pytest.raises(LinkDown):
        ours.send(b"x", 1.0)
    with pytest.raises(LinkDown):
        ours.receive(1.0)


@of_host
@pytest.mark.parametrize(
    ("unread", "problem"), [(b"", "the device closed the connection"), (b"x", "connection broke")]
)
def test_host_that_closes_or_resets_breaks_the_pipe(device, ours, unread, problem):
    if unread:
        ours.send(2 * unread, 1.0)
        device.socket.recv(1)
    device.socket.close()
    with pytest.raises(LinkDown, match=problem):
        ours.receive(1.0)


@of_host
def test_a_host_that_is_not_there_or_too_slow_is_said(device, monkeypatch):
    device.goes()
    with pytest.raises(
        LinkDown, match=f"{device.url}: nobody answers .*refused.*check that the device"
    ):
        opener_of(device.url)(timeout_s=1.0)
    limits_s = []

    def too_slow(address, timeout):
        limits_s.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", too_slow)
    with pytest.raises(LinkDown, match="timed out"):
        opener_of("tcp://robot:5020")(timeout_s=0.7)
    assert limits_s == [0.7]


@of_host
def test_only_the_first_connection_waits_for_the_resolver_of_names(device, monkeypatch):
    opened = opener_of(f"tcp://localhost:{device.address[1]}")
    opened(timeout_s=1.0).close()

    def hang(*_, **__):
        raise AssertionError("the resolver is asked again")

    monkeypatch.setattr(socket, "getaddrinfo", hang)
    device.accept()
    device.socket.close()
    ours = opened(timeout_s=1.0)
    device.accept()
    ours.send(b"STOP", 1.0)
    assert device.hears() == b"STOP"
    ours.close()
    device.goes()
    with pytest.raises(LinkDown, match=r"tcp://localhost:.*: nobody answers .*refused"):
        opened(timeout_s=1.0)


@of_line
def test_what_came_before_a_line_is_opened_is_thrown_away(device):
    first = opened(device)
    device.says(b"stale\n")
    first.close()
    second = opened(device)
    assert second.receive(0.002) == b""
    second.close()


@of_line
def test_line_is_held_by_one_alone_and_can_be_opened_again_after_closing(device, ours):
    with pytest.raises(LinkDown, match="nobody else holds it"):
        opened(device)
    ours.close()
    again = opened(device)
    again.send(b"hello\n", 1.0)
    assert device.hears() == b"hello\n"
    again.close()


@of_line
def test_unplugged_line_breaks_the_pipe(device, ours):
    device.goes()
    with pytest.raises(LinkDown, match="the line broke"):
        ours.receive(0.01)
    with pytest.raises(LinkDown, match="the line broke"):
        ours.send(b"x", 0.01)


@pytest.mark.parametrize("path", ["/dev/there-is-no-such-line", "/dev/null", "/dev/nul\0l"])
def test_what_is_no_serial_line_is_said_with_its_name(path):
    shown = re.escape(path.replace("\0", "?"))
    with pytest.raises(LinkDown, match=f"serial://{shown}: cannot be opened"):
        opener_of(f"serial://{path}")(timeout_s=1.0)
