"""A simulated cell served on loopback inside this process, as if it stood in the next room."""

from collections.abc import Callable
from types import TracebackType
from typing import Literal

from sim.cell import Cell
from sim.clock import CellClock
from sim.robot.controller import SimulatedController
from sim.robot.follower import FollowingController
from sim.servers.emscon_instrument import EmsconInstrument
from sim.servers.emscon_server import EmsconSession
from sim.servers.geocom_server import GeocomSession
from sim.servers.geocom_station import GeocomStation
from sim.servers.peers import Session, SessionFactory
from sim.servers.robotline_server import RobotlineSession
from sim.servers.server import CellServer

Send = Callable[[bytes], None]
LOOK_EVERY_S = 0.01
"""Real seconds; a controller stands longer than that between two moves."""


class EmbeddedCell:
    """A context manager: inside it, a controller and a tracker answer at their URLs.

    Raises `ServerFailed` when a port is taken, and on leaving when the cell broke meanwhile.
    """

    def __init__(
        self,
        cell: Cell,
        clock: CellClock,
        *,
        controller_on: Literal["tcp", "pty"] = "tcp",
        tracker_speaks: Literal["emscon", "geocom"] = "emscon",
        controller_port: int = 0,
        tracker_port: int = 0,
    ) -> None:
        self.cell = cell
        self.clock = clock
        self._follows = isinstance(cell.controller, FollowingController)
        self._station = GeocomStation(cell.tracker)
        self._instrument = EmsconInstrument(cell.tracker)
        speaking: SessionFactory = self._geocom if tracker_speaks == "geocom" else self._emscon
        if self._follows:
            speaking = self._looking(speaking)
        self._server = CellServer(clock, cell.faults)
        try:
            self.tracker_url = self._server.serve_tcp(speaking, "tracker", tracker_port)
            self.controller_url = self._controller_url(controller_on, controller_port)
        except BaseException:
            self._server.stop()
            raise

    def memory(self) -> dict[str, object]:
        """State for the next cell, as plain values for JSON; at any time."""
        return self._server.call(self._memory_now)

    def close(self) -> None:
        """Close all connections and end the server; a second time does nothing."""
        try:
            self._server.stop()
        finally:
            self.cell.close()

    def __enter__(self) -> "EmbeddedCell":
        self._server.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _memory_now(self) -> dict[str, object]:
        self.cell.advance(self.clock.now_s())
        return self.cell.memory()

    def _controller_url(self, controller_on: Literal["tcp", "pty"], port: int) -> str:
        """URL of a controller that answers; of nowhere for a robot that follows a real one."""
        if self._follows:
            return ""
        if controller_on == "pty":
            return self._server.serve_pty(self._robotline, "controller")
        return self._server.serve_tcp(self._robotline, "controller", port)

    def _robotline(self, send: Send, already_open: int) -> Session:  # noqa: ARG002 - takes several
        assert isinstance(self.cell.controller, SimulatedController), "no other is served"
        return RobotlineSession(self.cell.controller, send)

    def _looking(self, speaking: SessionFactory) -> SessionFactory:
        """Sessions that see every stop of the joints that the robot follows."""
        every_s = LOOK_EVERY_S / self.clock.real_s(1.0)

        def look(send: Send, already_open: int) -> Session:
            session = speaking(send, already_open)
            return LookingSession(session, self.cell.advance, every_s=every_s)

        return look

    def _emscon(self, send: Send, already_open: int) -> Session:
        return EmsconSession(
            self.cell.tracker,
            send,
            instrument=self._instrument,
            is_second=already_open > 0,
            faults=self.cell.faults,
        )

    def _geocom(self, send: Send, already_open: int) -> Session:  # noqa: ARG002 - takes several
        return GeocomSession(self._station, send)


class LookingSession:
    """A device's session that also looks at the joints, often enough to see every stop.

    The places at which the joints stand between two measurements count: backlash depends on the
    side from which a place was approached.
    """

    def __init__(
        self, session: Session, look: Callable[[float], object], *, every_s: float
    ) -> None:
        self._session = session
        self._look = look
        self._every_s = every_s
        self._next_s = 0.0

    def received(self, data: bytes, now_s: float) -> None:
        """Bytes from the client, for the device."""
        self._session.received(data, now_s)

    def advance(self, now_s: float) -> None:
        """Look, and let the device say what is due."""
        if now_s >= self._next_s:
            self._look(now_s)
            self._next_s = now_s + self._every_s
        self._session.advance(now_s)

    def next_due_s(self) -> float | None:
        """Time of the next look, or earlier."""
        due_s = self._session.next_due_s()
        return self._next_s if due_s is None else min(due_s, self._next_s)

    def closed(self, now_s: float) -> None:
        """The client has gone."""
        self._session.closed(now_s)
