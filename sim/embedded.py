"""A simulated cell served on loopback inside this process, as if it stood in the next room."""

import math
from typing import Literal

from sim.cell import Cell
from sim.clock import ScaledClock
from sim.errors import SimError
from sim.robot.controller import SimulatedController
from sim.robot.follower import FollowingController
from sim.servers.emscon_instrument import EmsconInstrument
from sim.servers.emscon_server import EmsconSession
from sim.servers.peers import SessionFactory
from sim.servers.pointline_server import PointlineSession
from sim.servers.robotline_server import RobotlineSession
from sim.servers.server import CellServer

LOOK_EVERY_S = 0.01
"""Real seconds between looks at joints that somebody else moves: shorter than any stop.

The places at which they stand between two measurements count: backlash depends on the side from
which a place was approached.
"""


PROTOCOLS = ("emscon", "pointline")
"""In which a simulated tracker may be spoken to."""


def tracker_sessions(cell: Cell, protocol: str) -> SessionFactory:
    """Sessions of its tracker in a protocol.

    Raises `SimError` for another.
    """
    tracker = cell.tracker
    match protocol:
        case "emscon":
            instrument = EmsconInstrument(tracker)
            return lambda send, already_open: EmsconSession(
                tracker, send, instrument=instrument, is_second=already_open > 0, faults=cell.faults
            )
        case "pointline":
            return lambda send, _: PointlineSession(tracker, send)
    raise SimError(
        f"no simulated tracker speaks '{protocol}'", remedy=f"use {' or '.join(PROTOCOLS)}"
    )


class EmbeddedCell:
    """A context manager: inside it, a controller and a tracker answer at their URLs.

    Raises `SimError` when a port is taken, and on leaving when the cell broke meanwhile.
    """

    def __init__(
        self,
        cell: Cell,
        clock: ScaledClock,
        *,
        controller_on: Literal["tcp", "pty"] = "tcp",
        tracker_speaks: str = "emscon",
        controller_port: int = 0,
        tracker_port: int = 0,
    ) -> None:
        self.cell = cell
        self.clock = clock
        self._follows = isinstance(cell.controller, FollowingController)
        sessions = tracker_sessions(cell, tracker_speaks)
        look_every_s = LOOK_EVERY_S / clock.real_s(1.0) if self._follows else math.inf
        self._server = CellServer(clock, cell.faults, look=cell.advance, look_every_s=look_every_s)
        try:
            self.tracker_url = self._server.serve_tcp(sessions, "tracker", tracker_port)
            self.controller_url = self._controller_url(controller_on, controller_port)
        except BaseException:
            self._server.stop()
            raise

    def memory(self) -> dict[str, object]:
        """State for the next cell, as plain values for JSON; at any time."""
        return self._server.call(self._memory_now)

    def close(self) -> None:
        """Close all connections and end the server; a second time does nothing."""
        self._server.stop()

    def __enter__(self) -> "EmbeddedCell":
        self._server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _memory_now(self) -> dict[str, object]:
        self.cell.advance(self.clock.now_s())
        return self.cell.memory()

    def _controller_url(self, controller_on: Literal["tcp", "pty"], port: int) -> str:
        """URL of a controller that answers; of nowhere for a robot that follows a real one."""
        if self._follows:
            return ""
        controller = self.cell.controller
        assert isinstance(controller, SimulatedController), "no other is served"
        robotline: SessionFactory = lambda send, _: RobotlineSession(controller, send)  # noqa: E731
        if controller_on == "pty":
            return self._server.serve_pty(robotline, "controller")
        return self._server.serve_tcp(robotline, "controller", port)
