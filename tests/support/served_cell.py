"""A simulated cell served on loopback, as by `pkmcal sim`."""

from sim.cell import Cell
from sim.clock import ScaledClock
from sim.servers.server import CellServer
from sim.sessions import controller_sessions, tracker_sessions


class ServedCell:
    """A context manager: inside it, a controller and a tracker answer at their URLs.

    Raises `SimError` when a port is taken, and on leaving when the cell broke meanwhile.
    """

    def __init__(
        self,
        cell: Cell,
        clock: ScaledClock,
        *,
        tracker_speaks: str = "emscon",
        controller_port: int = 0,
        tracker_port: int = 0,
    ) -> None:
        self.cell = cell
        self.clock = clock
        sessions = tracker_sessions(cell, tracker_speaks)
        self._server = CellServer(clock, cell.faults)
        try:
            self.tracker_url = self._server.serve_tcp(sessions, "tracker", tracker_port)
            controller = controller_sessions(cell)
            self.controller_url = self._server.serve_tcp(controller, "controller", controller_port)
        except BaseException:
            self._server.stop()
            raise

    def close(self) -> None:
        """Close all connections and end the server; a second time does nothing."""
        self._server.stop()

    def __enter__(self) -> "ServedCell":
        self._server.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
