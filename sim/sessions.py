"""Sessions of a cell's devices, by protocol.

A session is a device's side of one connection: bytes and the time come in, bytes go out, and no
socket or thread is in it. The layers around it, from inside outwards:

1. the device itself (`SimulatedController`, `SimulatedTracker`): what it does in the cell's time;
2. the session (this module makes it): the device in the words of a protocol;
3. the `Conversation` of one client: the order of messages, and scripted faults of the wire;
4. the carrier: `InProcessCell` for a driver in this process, `CellServer` for sockets and lines.

So all four run alike in a dry run and behind a socket; only the carrier differs.
"""

from sim.cell import Cell
from sim.errors import SimError
from sim.servers.conversation import SessionFactory
from sim.servers.emscon_instrument import EmsconInstrument
from sim.servers.emscon_server import EmsconSession
from sim.servers.pointline_server import PointlineSession
from sim.servers.robotline_server import RobotlineSession

PROTOCOLS = ("emscon", "pointline")
"""Protocols of a simulated tracker."""


def tracker_sessions(cell: Cell, protocol: str) -> SessionFactory:
    """Return the factory of sessions of the tracker in a protocol; raises `SimError`."""
    tracker = cell.tracker
    match protocol:
        case "emscon":
            # one for all connections: an emScon controller keeps its settings from power-on
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
