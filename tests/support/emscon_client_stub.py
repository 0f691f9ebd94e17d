"""A client of a simulated emScon session, without a socket, and what it asks for and hears."""

from fake_tracker import FakeTracker

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
    """Sends to a session at a time of its own and keeps what comes back."""

    def __init__(self, tracker=None, **options):
        self.tracker = tracker or FakeTracker()
        self.now_s = 0.0
        self._bytes = []
        self._read = from_server()
        self.session = EmsconSession(self.tracker, self._bytes.append, **options)
        self.session.advance(self.now_s)

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
