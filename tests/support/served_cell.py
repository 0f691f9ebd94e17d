"""A simulated cell served on loopback, as by `pkmcal sim`."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from sim.cell import Cell
from sim.clock import ScaledClock
from sim.servers.server import CellServer
from sim.sessions import controller_sessions, tracker_sessions


@dataclass(frozen=True)
class ServedCell:
    """A cell, and where its devices answer."""

    cell: Cell
    controller_url: str
    tracker_url: str


@contextmanager
def served(cell: Cell, speed_up: float) -> Iterator[ServedCell]:
    """Serve a cell whose time runs so much faster than the wall clock's."""
    server = CellServer(ScaledClock(speed_up), cell.faults)
    controller_url = server.serve_tcp(controller_sessions(cell), "controller")
    tracker_url = server.serve_tcp(tracker_sessions(cell, "emscon"), "tracker")
    with server:
        yield ServedCell(cell, controller_url, tracker_url)
