"""Server of simulated devices on loopback sockets and pseudo-terminals; one thread and selector.

All devices of a cell share their state (the tracker sees the robot that the controller moves), so
one thread serves all of them and nothing has to be locked. It waits in `select` for bytes or for
the first time at which a conversation has something due, then gives every peer a turn.

Clients are not trusted: none may block the thread, so every channel is non-blocking; none may fill
the memory, so one that asks without reading is paused, and one that is sent much and reads nothing
is dropped. An error in a session closes all connections, and `stop` raises it.
"""

import os
import selectors
import socket
import threading
from collections.abc import Callable
from functools import partial
from operator import attrgetter
from typing import NamedTuple

from drivers.system import HAS_POSIX, raw_pseudo_terminal
from sim.clock import ScaledClock
from sim.errors import SimError
from sim.faults import ANSWERS_OF, DeviceName, FaultScript
from sim.servers.conversation import Conversation, SessionFactory

LOOPBACK = "127.0.0.1"
CLIENTS_LIMIT = 8
SHORTEST_WAIT_S = 0.0005
"""Least real wait: a session that stays due could otherwise keep the processor busy."""
CHUNK_BYTES = 65536
READS_A_TURN = 4
"""Chunks that are read from one client before the others have a turn."""
PAUSE_ABOVE_BYTES = 256 * 1024
"""Unsent bytes above which a client's questions are not read until it has read answers."""
GIVE_UP_ABOVE_BYTES = 1024 * 1024
"""Unsent bytes above which a client is dropped."""


class SerialEnd:
    """Device's end of a pseudo-terminal, with a socket's methods."""

    # The client's end is held open too: else the device's end would report a hang-up whenever no
    # client has the line open, and a serial line does not notice who is there.

    def __init__(self, device_end: int, client_end: int) -> None:
        os.set_blocking(device_end, False)
        self._ends = device_end, client_end
        self.recv = partial(os.read, device_end)
        self.send = partial(os.write, device_end)

    def fileno(self) -> int:
        """Return the file descriptor for the selector."""
        return self._ends[0]

    def close(self) -> None:
        """Close both ends."""
        for end in self._ends:
            os.close(end)


class Peer:
    """Client at the other end of a pipe that never waits, in a conversation with a device."""

    def __init__(self, channel: socket.socket | SerialEnd, conversation: Conversation) -> None:
        self.channel = channel
        self.conversation = conversation
        self._keeps_open = isinstance(channel, SerialEnd)
        """Whether the pipe outlives its client, as a serial line does."""

    def read_arrivals(self) -> None:
        """Read what has come, at most `READS_A_TURN` chunks; nothing while too much is unsent.

        A client that has left is noticed here.
        """
        for _ in range(READS_A_TURN):
            if self.conversation.is_over or self._is_paused() or not self._take():
                return

    def turn(self) -> None:
        """Let the session send what is due, and write what goes out."""
        self.conversation.turn()
        self._flush()

    def interest(self) -> int:
        """Return the events that the selector should watch for."""
        # While paused nothing is read until the client has taken what is unsent.
        if self._is_paused():
            return selectors.EVENT_WRITE
        return selectors.EVENT_READ | (selectors.EVENT_WRITE if self.conversation.going() else 0)

    def hang_up(self) -> None:
        """Close the connection; unsent bytes still go out if they can."""
        if not self.conversation.is_over:
            self.conversation.hang_up()
            self._flush()

    def _take(self) -> bool:
        """Read one piece; return whether there may be more."""
        try:
            data = self.channel.recv(CHUNK_BYTES)
        except BlockingIOError:
            return False
        except OSError:
            data = b""  # a connection that broke ends as one that was closed
        if data:
            self.conversation.hear(data)
        elif not self._keeps_open:
            self.hang_up()  # the client has gone
        return bool(data)

    def _is_paused(self) -> bool:
        return len(self.conversation.going()) > PAUSE_ABOVE_BYTES

    def _flush(self) -> None:
        """Write what can go out; drop a client that reads nothing."""
        if data := self.conversation.going():
            # a full pipe is no error: the selector reports when it takes more
            try:
                self.conversation.gone(self.channel.send(data))
            except BlockingIOError:
                pass
            except OSError:
                self._lose()
        # what a pipe takes now may be less than all; the remainder goes in a later turn
        if self.conversation.size_bytes > GIVE_UP_ABOVE_BYTES:
            self.conversation.discard()
            self._lose()
        elif self.conversation.wants_close:
            self.conversation.end_as_scripted(stays=self._keeps_open)

    def _lose(self) -> None:
        """Hang up, unless the line outlives its client."""
        if not self._keeps_open:
            self.conversation.hang_up()


class _Watch(NamedTuple):
    """Step to take when something has come on a channel."""

    admits_clients: bool
    step: Callable[[], None]


class CellServer:
    """Server of all devices of a cell. Add devices before `start`; `stop` closes everything."""

    def __init__(self, clock: ScaledClock, faults: FaultScript) -> None:
        self._clock = clock
        self._faults = faults
        self._selector = selectors.DefaultSelector()
        # a byte through this pipe ends the wait in `select`, for `stop` from another thread
        # (a pair of sockets, because Windows selects among nothing else)
        self._wake_end, self._awake_end = socket.socketpair()
        self._listeners: list[socket.socket] = []
        self._peers: dict[Peer, DeviceName] = {}
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._stopped = False
        self._failure: BaseException | None = None
        self._selector.register(
            self._wake_end,
            selectors.EVENT_READ,
            _Watch(admits_clients=False, step=self._drain_wake_up),
        )

    def serve_tcp(self, factory: SessionFactory, device_name: DeviceName, port: int = 0) -> str:
        """Listen on loopback and return the URL tcp://127.0.0.1:PORT; raises `SimError`."""
        try:
            listener = socket.create_server((LOOPBACK, port), backlog=CLIENTS_LIMIT)
        except OSError as error:
            raise SimError(
                f"cannot listen on port {port} of {LOOPBACK} ({error.strerror})",
                remedy="choose another port, or 0 for any free one",
            ) from error
        listener.settimeout(0.0)
        self._listeners.append(listener)
        accept = partial(self._accept, listener, factory, device_name)
        self._selector.register(
            listener, selectors.EVENT_READ, _Watch(admits_clients=True, step=accept)
        )
        return f"tcp://{LOOPBACK}:{listener.getsockname()[1]}"

    def serve_pty(self, factory: SessionFactory, device_name: DeviceName) -> str:
        """Open a pseudo-terminal and return the URL of its client's end, serial:///dev/….

        Raises `SimError` where the system has none.
        """
        if not HAS_POSIX:
            raise SimError(
                "this system has no pseudo-terminals, which stand for a serial line",
                remedy="serve it by TCP, without --serial",
            )
        device_end, client_end = raw_pseudo_terminal()
        self._add(SerialEnd(device_end, client_end), factory, device_name)
        return f"serial://{os.ttyname(client_end)}"

    def start(self) -> None:
        """Serve from a thread of its own."""
        self._thread = threading.Thread(target=self._run, name="simulated cell", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close all connections and end the thread; a second time does nothing.

        Raises `SimError` when the thread had already ended in an error.
        """
        if self._stopped:
            return
        self._stopping = self._stopped = True
        self._wake()
        if self._thread is not None:
            self._thread.join()
        else:
            self._close()
        self._wake_end.close()
        self._awake_end.close()
        if self._failure is not None:
            raise SimError(
                f"the simulated cell broke: {self._failure}", remedy="report it with its scenario"
            ) from self._failure

    def __enter__(self) -> "CellServer":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _run(self) -> None:
        try:
            while not self._stopping:
                self._turn()
        except BaseException as error:  # noqa: BLE001 - kept for `stop`, which raises it
            self._failure = error
        finally:
            self._close()

    def _turn(self) -> None:
        ready: list[_Watch] = [key.data for key, _ in self._selector.select(self._patience_s())]
        for watch in sorted(ready, key=attrgetter("admits_clients")):  # who left makes room first
            watch.step()
        for peer in list(self._peers):
            peer.turn()
            self._watch(peer)

    def _patience_s(self) -> float | None:
        """Return the real seconds until something is due; None if all depends on clients."""
        dues_s = [t for p in self._peers if (t := p.conversation.next_due_s()) is not None]
        if not dues_s:
            return None
        return max(self._clock.real_s(min(dues_s) - self._clock.now_s()), SHORTEST_WAIT_S)

    def _accept(
        self, listener: socket.socket, factory: SessionFactory, device_name: DeviceName
    ) -> None:
        try:
            accepted, _ = listener.accept()
        except OSError:  # the client has gone again
            return
        # taken and closed at once: a client that stays in the backlog would wait without an answer
        if self._open_count(device_name) >= CLIENTS_LIMIT:
            accepted.close()
            return
        accepted.settimeout(0.0)
        # each answer goes out at once, instead of waiting for more bytes to fill a packet (Nagle)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._add(accepted, factory, device_name)

    def _add(
        self, channel: socket.socket | SerialEnd, factory: SessionFactory, device_name: DeviceName
    ) -> None:
        next_fault = partial(self._faults.next, ANSWERS_OF[device_name])
        before = self._open_count(device_name)
        peer = Peer(channel, Conversation(factory, before, next_fault, self._clock.now_s))
        self._peers[peer] = device_name
        self._selector.register(
            channel, selectors.EVENT_READ, _Watch(admits_clients=False, step=peer.read_arrivals)
        )

    def _open_count(self, device_name: DeviceName) -> int:
        """Return the number of a device's clients that have not just left."""
        return sum(
            n == device_name and not peer.conversation.is_over for peer, n in self._peers.items()
        )

    def _watch(self, peer: Peer) -> None:
        """Drop a peer that is over; else watch the events of its interest."""
        if peer.conversation.is_over:
            self._forget(peer)
        else:
            self._selector.modify(
                peer.channel, peer.interest(), _Watch(admits_clients=False, step=peer.read_arrivals)
            )

    def _forget(self, peer: Peer) -> None:
        del self._peers[peer]
        self._selector.unregister(peer.channel)
        peer.channel.close()

    def _wake(self) -> None:
        self._awake_end.send(b"!")

    def _drain_wake_up(self) -> None:
        self._wake_end.recv(4096)

    def _close(self) -> None:
        for peer in list(self._peers):
            peer.hang_up()
            self._forget(peer)
        for listener in self._listeners:
            listener.close()
        self._selector.close()
