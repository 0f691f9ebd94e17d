"""Sessions of a cell's devices, by the protocols in which they are spoken to."""

from sim.cell import Cell
from sim.errors import SimError
from sim.servers.conversation import SessionFactory
from sim.servers.emscon_instrument import EmsconInstrument
from sim.servers.emscon_server import EmsconSession
from sim.servers.pointline_server import PointlineSession
from sim.servers.robotline_server import RobotlineSession

PROTOCOLS = ("emscon", "pointline")
"""In which a simulated tracker may be spoken to."""


def tracker_sessions(cell: Cell, protocol: str) -> SessionFactory:
    """Return the factory of sessions of the tracker in a protocol; raises `SimError`."""
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


def controller_sessions(cell: Cell) -> SessionFactory:
    """Return the factory of sessions of the controller."""
    return lambda send, _: RobotlineSession(cell.controller, send)
