"""TCP as a byte pipe over loopback."""

import socket
import time

import pytest

from drivers.errors import LinkDown
from drivers.transport import CHUNK_BYTES, TcpAddress, TcpTransport, open_transport


@pytest.fixture
def listener():
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


@pytest.fixture
def ends(listener):
    """Our end, opened by its URL, and the device's."""
    ours = open_transport(url_of(listener), timeout_s=1.0)
    theirs, _ = listener.accept()
    with theirs:
        yield ours, theirs
    ours.close()


def url_of(server):
    return f"tcp://127.0.0.1:{server.getsockname()[1]}"


def test_bytes_go_both_ways(ends):
    ours, theirs = ends
    ours.send(b"question\n", 1.0)
    assert theirs.recv(100) == b"question\n"
    theirs.sendall(bytes(range(256)))
    assert ours.receive(1.0) == bytes(range(256))


def test_silence_is_no_bytes(ends):
    ours, _ = ends
    assert ours.receive(0.0) == b""
    assert ours.receive(0.002) == b""


def test_one_reading_is_bounded(ends):
    ours, theirs = ends
    theirs.settimeout(1.0)
    theirs.sendall(b"x" * (CHUNK_BYTES + 10_000))
    received = [ours.receive(1.0), ours.receive(1.0)]
    assert max(map(len, received)) <= CHUNK_BYTES


def test_small_questions_are_sent_at_once(listener):
    ours = TcpTransport.connect(TcpAddress("127.0.0.1", listener.getsockname()[1]), timeout_s=1.0)
    assert ours._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)
    ours.close()


def test_device_that_closes_breaks_the_pipe(ends):
    ours, theirs = ends
    theirs.close()
    with pytest.raises(LinkDown, match="the device closed the connection"):
        ours.receive(1.0)


def test_device_that_resets_breaks_the_pipe(ends):
    ours, theirs = ends
    ours.send(b"unread", 1.0)
    theirs.recv(1)
    theirs.close()
    with pytest.raises(LinkDown, match="the connection broke"):
        ours.receive(1.0)


def test_device_that_reads_nothing_breaks_the_pipe_in_time(ends):
    ours, _ = ends
    started_s = time.monotonic()
    with pytest.raises(LinkDown, match="the connection broke"):
        ours.send(b"x" * 50_000_000, 0.005)
    assert time.monotonic() - started_s < 1.0


def test_closed_pipe_refuses_every_call(ends):
    ours, _ = ends
    ours.close()
    ours.close()
    with pytest.raises(LinkDown):
        ours.send(b"x", 1.0)
    with pytest.raises(LinkDown):
        ours.receive(1.0)


def test_nobody_there_is_said_with_the_address():
    with socket.create_server(("127.0.0.1", 0)) as server:
        url = url_of(server)
    with pytest.raises(LinkDown, match=f"{url}: nobody answers .*refused.*check that the device"):
        open_transport(url, timeout_s=1.0)


def test_connecting_has_a_time_limit(monkeypatch):
    limits_s = []

    def too_slow(address, timeout):
        limits_s.append(timeout)
        raise TimeoutError("timed out")

    monkeypatch.setattr(socket, "create_connection", too_slow)
    with pytest.raises(LinkDown, match="timed out"):
        open_transport("tcp://robot:5020", timeout_s=0.7)
    assert limits_s == [0.7]


def test_pipe_is_named_by_its_address(ends):
    ours, theirs = ends
    assert ours.name == f"tcp://127.0.0.1:{theirs.getsockname()[1]}"
