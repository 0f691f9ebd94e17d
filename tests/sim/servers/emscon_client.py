"""A client of a simulated emScon session, without a socket, and the tracker behind it."""

from tracker_stage import Stage, seen_mm, tracker

from drivers.wire.emscon import Answer, EmsconRequest, encode, from_server
from drivers.wire.emscon_constants import Command, ResultStatus, SystemChange
from drivers.wire.emscon_messages import StatusChange, SystemSettings, Units
from sim.servers.emscon_server import EmsconSession

MILLIMETRES = Units(1, 1, 0, 0, 0)
QUIET = SystemSettings(2, 0, 0, 1, 0, 0, 0, 0, 0)
STREAMING = SystemSettings(2, 0, 0, 1, 1, 1, 0, 0, 0)
BUSY, READY, NOT_READY = (
    StatusChange(SystemChange.LIGHT_BUSY),
    StatusChange(SystemChange.LIGHT_READY),
    StatusChange(SystemChange.LIGHT_NOT_READY),
)


def ok(command):
    return Answer(command, ResultStatus.ALL_OK)


def refused(command, status):
    return Answer(command, status)


class Client:
    """Sends to a session at a time of its own and keeps what comes back.

    Behind it is a tracker before a reflector, in a state that a test names, or one that is given.
    """

    def __init__(self, at=None, *, instrument=None, is_second=False, **state):
        self.stage = Stage()
        self.tracker = at or tracker(self.stage, **state)
        self.place_mm = seen_mm(self.stage.point_mm)
        self.place_m = tuple(value / 1000.0 for value in self.place_mm)
        self.now_s = 0.0
        self._bytes = []
        self._read = from_server()
        self.session = EmsconSession(
            self.tracker, self._bytes.append, instrument=instrument, is_second=is_second
        )
        self.session.advance(self.now_s)

    def turn_the_reflector_away(self):
        self.stage.facing = -self.stage.facing

    def send(self, command, *body):
        self.session.received(encode(EmsconRequest(command, *body)), self.now_s)
        return self.later(0.0)

    def later(self, seconds):
        self.now_s += seconds
        self.session.advance(self.now_s)
        return self.taken()

    def taken(self):
        return self._read(b"".join(self.taken_bytes()))

    def taken_bytes(self):
        packets = [*self._bytes]
        self._bytes.clear()
        return packets

    def ask(self, command, *body):
        (answer,) = [m for m in self.send(command, *body) if isinstance(m, Answer)]
        return answer

    def status(self, command, *body):
        return self.ask(command, *body).status

    def measure(self):
        """The messages of a whole measurement."""
        return self.send(Command.START_MEASUREMENT) + self.later(0.5)
