"""The server: many clients, one thread, and nobody outside can bring it down."""

import contextlib
import os
import socket
import threading
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from timed_pipe import HandClock

from sim.clock import ScaledClock
from sim.errors import SimError
from sim.faults import Counted, Fault, FaultScript
from sim.servers.server import CLIENTS_LIMIT, GIVE_UP_ABOVE_BYTES, CellServer

PATIENCE_S = 5.0
AWAY = threading.Event()
"""Ends the time in which a server looks away."""


class HandMovedVirtualClock(HandClock):
    """Virtual time that a test moves: the server looks again after a millisecond."""

    def real_s(self, virtual_s):
        return min(0.001, max(virtual_s, 0.0))


class Echo:
    """Echoes at once; `later` answers a second after, `count` how many were there before."""

    def __init__(self, send, already_open, log):
        self.send, self.already_open, self.log = send, already_open, log
        self.due_s = None

    def received(self, data, now_s):
        if data == b"later":
            self.due_s = now_s + 1.0
        elif data == b"count":
            self.send(b"%d" % self.already_open)
        elif data == b"break":
            raise ZeroDivisionError("broken session")
        elif data == b"look away":
            AWAY.wait(PATIENCE_S)
        elif data == b"flood":
            for _ in range(64):
                self.send(bytes(65536))
        else:
            self.send(data)

    def advance(self, now_s):
        if self.due_s is not None and now_s >= self.due_s:
            self.due_s = None
            self.send(b"now")

    def next_due_s(self):
        return self.due_s

    def closed(self, now_s):
        self.log.append("closed")


class Bench:
    """A started server with one echoing device."""

    def __init__(self, clock=None, faults=()):
        self.log = []
        script = FaultScript([Fault(Counted.TRACKER_ANSWER, *fault) for fault in faults], {})
        self.clock = clock or ScaledClock(1000.0)
        self.server = CellServer(self.clock, script)
        self.url = self.server.serve_tcp(self.session, "tracker")

    def session(self, send, already_open):
        return Echo(send, already_open, self.log)

    def client(self):
        parts = urlsplit(self.url)
        return socket.create_connection((parts.hostname, parts.port), timeout=PATIENCE_S)

    def __enter__(self):
        self.server.start()
        return self

    def __exit__(self, *_):
        self.server.stop()


def asked(client, question):
    client.sendall(question)
    return client.recv(65536)


def sent_until_full(client):
    client.settimeout(0.01)
    sent = 0
    with suppress(TimeoutError):
        while True:
            sent += client.send(bytes(65536))
    client.settimeout(PATIENCE_S)
    return sent


def test_what_is_due_later_comes_later_in_virtual_time():
    clock = HandMovedVirtualClock()
    with Bench(clock) as bench, bench.client() as client:
        client.sendall(b"later")
        client.settimeout(0.01)
        with pytest.raises(TimeoutError):
            client.recv(100)
        client.settimeout(PATIENCE_S)
        clock.sleep_s(1.0)
        assert client.recv(100) == b"now"


def test_a_client_that_comes_back_at_once_does_not_meet_itself():
    with Bench() as bench:
        client = bench.client()
        assert asked(client, b"count") == b"0"
        AWAY.clear()
        client.sendall(b"look away")
        client.close()
        with bench.client() as again:
            AWAY.set()
            assert asked(again, b"count") == b"0"


def test_too_many_clients_are_turned_away():
    with Bench() as bench:
        clients = [bench.client() for _ in range(CLIENTS_LIMIT)]
        assert all(asked(client, b"x") == b"x" for client in clients)
        with bench.client() as late:
            assert late.recv(10) == b""
        assert asked(clients[0], b"y") == b"y"
        for client in clients:
            client.close()


def test_a_client_that_never_reads_is_dropped_and_the_others_served():
    with Bench() as bench, bench.client() as deaf, bench.client() as client:
        for _ in range(4):
            with contextlib.suppress(ConnectionError):  # it may have been dropped by now
                deaf.sendall(b"flood")
            assert asked(client, b"hello") == b"hello"
        assert bench.log == ["closed"]


def test_a_client_that_asks_without_reading_is_not_listened_to():
    with Bench() as bench, bench.client() as busy, bench.client() as client:
        sent = sent_until_full(busy)
        assert asked(client, b"hello") == b"hello"
        assert bench.log == []
        assert sent > GIVE_UP_ABOVE_BYTES / 8
        received = 0
        while received < sent:
            received += len(busy.recv(65536))
        assert received == sent


def test_stop_closes_the_clients_and_leaves_nothing():
    before = threading.active_count()
    descriptors = len(list(Path("/proc/self/fd").iterdir()))
    with Bench() as bench, bench.client() as client:
        assert asked(client, b"x") == b"x"
        bench.server.stop()
        assert client.recv(10) == b""
        bench.server.stop()
    assert bench.log == ["closed"]
    assert threading.active_count() == before
    assert len(list(Path("/proc/self/fd").iterdir())) == descriptors


def test_a_session_that_breaks_is_told_of_when_the_server_stops():
    bench = Bench()
    bench.server.start()
    with bench.client() as client:
        assert asked(client, b"break") == b""
    with pytest.raises(SimError, match="broken session"):
        bench.server.stop()


def test_a_port_that_is_taken_is_named():
    with Bench() as bench:
        port = urlsplit(bench.url).port
        other = CellServer(HandClock(), FaultScript([], {}))
        with pytest.raises(SimError, match=str(port)):
            other.serve_tcp(bench.session, "tracker", port)
        other.stop()


def test_a_pseudo_terminal_is_a_device_too():
    bench = Bench()
    url = bench.server.serve_pty(bench.session, "controller")
    with bench:
        line = os.open(urlsplit(url).path, os.O_RDWR | os.O_NOCTTY)
        os.write(line, b"hello\n\x03\x04\xff")
        assert os.read(line, 100) == b"hello\n\x03\x04\xff"
        os.close(line)
        again = os.open(urlsplit(url).path, os.O_RDWR | os.O_NOCTTY)
        os.write(again, b"again")
        assert os.read(again, 100) == b"again"
        os.close(again)
