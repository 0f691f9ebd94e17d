"""TCP over loopback and a serial line over a pseudo-terminal: both are byte pipes."""

import os
import re
import socket
import time

import pytest

from drivers.errors import LinkDown
from drivers.transport import CHUNK_BYTES, TcpTransport, open_transport


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


@pytest.fixture
def line():
    line = Line()
    yield line
    line.goes()


@pytest.fixture
def host():
    host = Host()
    yield host
    host.goes()


@pytest.fixture(params=["host", "line"])
def device(request):
    return request.getfixturevalue(request.param)


def opened(device):
    pipe = open_transport(device.url, timeout_s=1.0)
    device.accept()
    return pipe


@pytest.fixture
def ours(device):
    ours = opened(device)
    yield ours
    ours.close()


@pytest.fixture
def of_host(host):
    ours = opened(host)
    yield ours
    ours.close()


@pytest.fixture
def of_line(line):
    ours = opened(line)
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
    assert ours.name == device.url


def test_silence_is_no_bytes(ours):
    assert ours.receive(0.0) == b""
    assert ours.receive(0.002) == b""


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


def test_one_reading_of_a_socket_is_bounded(host, of_host):
    host.socket.settimeout(1.0)
    host.says(b"x" * (CHUNK_BYTES + 10_000))
    pieces = [of_host.receive(1.0), of_host.receive(1.0)]
    assert max(map(len, pieces)) <= CHUNK_BYTES


def test_small_questions_are_sent_at_once(host):
    ours = TcpTransport.connect(*host.address, timeout_s=1.0)
    assert ours._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    ours.close()


@pytest.mark.parametrize(
    ("unread", "problem"), [(b"", "the device closed the connection"), (b"x", "connection broke")]
)
def test_host_that_closes_or_resets_breaks_the_pipe(host, of_host, unread, problem):
    if unread:
        of_host.send(2 * unread, 1.0)
        host.socket.recv(1)
    host.socket.close()
    with pytest.raises(LinkDown, match=problem):
        of_host.receive(1.0)


def test_a_host_that_is_not_there_or_too_slow_is_said(host, monkeypatch):
    host.goes()
    with pytest.raises(
        LinkDown, match=f"{host.url}: nobody answers .*refused.*check that the device"
    ):
        open_transport(host.url, timeout_s=1.0)
    limits_s = []

    def too_slow(address, timeout):
        limits_s.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", too_slow)
    with pytest.raises(LinkDown, match="timed out"):
        open_transport("tcp://robot:5020", timeout_s=0.7)
    assert limits_s == [0.7]


def test_what_came_before_a_line_is_opened_is_thrown_away(line):
    first = opened(line)
    line.says(b"stale\n")
    first.close()
    second = opened(line)
    assert second.receive(0.002) == b""
    second.close()


def test_line_is_held_by_one_alone_and_can_be_opened_again_after_closing(line, of_line):
    with pytest.raises(LinkDown, match="nobody else holds it"):
        opened(line)
    of_line.close()
    again = opened(line)
    again.send(b"hello\n", 1.0)
    assert line.hears() == b"hello\n"
    again.close()


def test_unplugged_line_breaks_the_pipe(line, of_line):
    line.goes()
    with pytest.raises(LinkDown, match="the line broke"):
        of_line.receive(0.01)
    with pytest.raises(LinkDown, match="the line broke"):
        of_line.send(b"x", 0.01)


@pytest.mark.parametrize("path", ["/dev/there-is-no-such-line", "/dev/null", "/dev/nul\0l"])
def test_what_is_no_serial_line_is_said_with_its_name(path):
    shown = re.escape(path.replace("\0", "?"))
    with pytest.raises(LinkDown, match=f"serial://{shown}: cannot be opened"):
        open_transport(f"serial://{path}", timeout_s=1.0)
