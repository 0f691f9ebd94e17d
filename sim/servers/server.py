"""Server of simulated devices on loopback sockets and pseudo-terminals; one thread and selector."""

import math
import os
import selectors
import socket
import threading
import tty
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from operator import itemgetter
from queue import Empty, SimpleQueue
from typing import TypeVar

from sim.clock import ScaledClock
from sim.errors import SimError
from sim.faults import ANSWERS_OF, DeviceName, Fault, FaultScript
from sim.servers.peers import Channel, Peer, SendQueue, SerialEnd, SessionFactory

LOOPBACK = "127.0.0.1"
CLIENTS_LIMIT = 8
LOOK_AGAIN_S = 0.1
SHORTEST_WAIT_S = 0.0005
"""Wait by which a session that stays due cannot keep the processor busy."""

Result = TypeVar("Result")


_Watch = tuple[bool, Callable[[], None]]
"""Whether it admits a new client, and the step to take when something has come."""


class CellServer:
    """Server of all devices of a cell. Name them before `start`; `stop` closes everything."""

    def __init__(
        self,
        clock: ScaledClock,
        faults: FaultScript,
        *,
        look: Callable[[float], object] = lambda _now_s: None,
        look_every_s: float = math.inf,
    ) -> None:
        """Server that also looks at the cell so often, while it has clients."""
        self._clock = clock
        self._faults = faults
        self._look = look
        self._look_every_s = look_every_s
        self._next_look_s = 0.0 if look_every_s < math.inf else math.inf
        self._selector = selectors.DefaultSelector()
        self._wake_end, self._awake_end = os.pipe()
        self._listeners: list[socket.socket] = []
        self._peers: dict[Peer, DeviceName] = {}
        self._calls: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._thread: threading.Thread | None = None
        self._stopping = False
        self._stopped = False
        self._failure: BaseException | None = None
        self._selector.register(self._wake_end, selectors.EVENT_READ, (False, self._woken))

    def serve_tcp(self, factory: SessionFactory, device_name: DeviceName, port: int = 0) -> str:
        """Listen on loopback and say where: tcp://127.0.0.1:PORT; raises `SimError`."""
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
        self._selector.register(listener, selectors.EVENT_READ, (True, accept))
        return f"tcp://{LOOPBACK}:{listener.getsockname()[1]}"

    def serve_pty(self, factory: SessionFactory, device_name: DeviceName) -> str:
        """Open a pseudo-terminal and say where its client's end is: serial:///dev/…."""
        device_end, client_end = os.openpty()
        tty.setraw(client_end)
        path = os.ttyname(client_end)
        self._add(SerialEnd(device_end, client_end), factory, device_name)
        return f"serial://{path}"

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
        os.close(self._wake_end)
        os.close(self._awake_end)
        if self._failure is not None:
            raise SimError(
                f"the simulated cell broke: {self._failure}", remedy="report it with its scenario"
            ) from self._failure

    def call(self, work: Callable[[], Result]) -> Result:
        """Do something to the cell between two turns of the server, and return its result."""
        if self._thread is None or not self._thread.is_alive():
            return work()
        results: SimpleQueue[Result] = SimpleQueue()
        self._calls.put(lambda: results.put(work()))
        self._wake()
        while self._thread.is_alive():
            with suppress(Empty):
                return results.get(timeout=LOOK_AGAIN_S)
        return work() if results.empty() else results.get()

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
        for _, step in sorted(ready, key=itemgetter(0)):  # who left makes room first
            step()
        while not self._calls.empty():
            self._calls.get()()
        if self._peers and (now_s := self._clock.now_s()) >= self._next_look_s:
            self._look(now_s)
            self._next_look_s = now_s + self._look_every_s
        for peer in list(self._peers):
            peer.turn()
            self._watch(peer)

    def _patience_s(self) -> float | None:
        """Real seconds until something is due; None when only a client can change anything."""
        dues_s = [due_s for peer in self._peers if (due_s := peer.next_due_s()) is not None]
        due_s = min([*dues_s, self._next_look_s]) if self._peers else math.inf
        if due_s == math.inf:
            return None
        return max(self._clock.real_s(due_s - self._clock.now_s()), SHORTEST_WAIT_S)

    def _accept(
        self, listener: socket.socket, factory: SessionFactory, device_name: DeviceName
    ) -> None:
        try:
            accepted, _ = listener.accept()
        except OSError:  # the client has gone again
            return
        if self._open_count(device_name) >= CLIENTS_LIMIT:
            accepted.close()
            return
        accepted.settimeout(0.0)
        accepted.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._add(accepted, factory, device_name)

    def _add(self, channel: Channel, factory: SessionFactory, device_name: DeviceName) -> None:
        outbox = SendQueue(partial(self._next_fault, device_name))
        peer = Peer(channel, outbox, factory, self._open_count(device_name), self._clock.now_s)
        self._peers[peer] = device_name
        self._selector.register(channel, selectors.EVENT_READ, (False, peer.ready))

    def _open_count(self, device_name: DeviceName) -> int:
        """Number of clients that a device has and that have not just left."""
        return sum(n == device_name and not peer.is_over for peer, n in self._peers.items())

    def _next_fault(self, device_name: DeviceName) -> Fault | None:
        return self._faults.next(ANSWERS_OF[device_name])

    def _watch(self, peer: Peer) -> None:
        """Forget a peer that is over; else watch what it is interested in."""
        if peer.is_over:
            self._forget(peer)
        else:
            self._selector.modify(peer.channel, peer.interest(), (False, peer.ready))

    def _forget(self, peer: Peer) -> None:
        del self._peers[peer]
        self._selector.unregister(peer.channel)
        peer.channel.close()

    def _wake(self) -> None:
        os.write(self._awake_end, b"!")

    def _woken(self) -> None:
        os.read(self._wake_end, 4096)

    def _close(self) -> None:
        for peer in list(self._peers):
            peer.hang_up()
            self._forget(peer)
        for listener in self._listeners:
            listener.close()
        self._selector.close()
