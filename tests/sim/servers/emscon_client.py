"""A client of a simulated emScon session, without a socket, and the tracker behind it."""

from drivers.values import Measurement, Weather
from drivers.wire.emscon import Answer, EmsconRequest, encode, from_server
from drivers.wire.emscon_constants import Command, ResultStatus, SystemChange
from drivers.wire.emscon_messages import StatusChange, SystemSettings, Units
from sim.servers.emscon_server import EmsconSession
from sim.tracker.section import SimulatedReflector

COVARIANCE_MM2 = ((4e-4, 1e-5, -2e-5), (1e-5, 9e-4, 3e-5), (-2e-5, 3e-5, 1e-4))
REFLECTORS = (
    SimulatedReflector(id=3, name="CCR-1.5in", surface_offset_mm=19.05),
    SimulatedReflector(id=7, name="CCR-0.5in", surface_offset_mm=6.35),
)


class FakeTracker:
    """Locked on a reflector at `point_mm`, unless told otherwise."""

    model = "simulated tracker"
    name = "SIM-LT"
    serial = "LT-0042"
    firmware = "1.2"

    def __init__(self, *, initialised=True, warm=True, locked=True, action_s=1.0):
        self.is_initialised, self.is_warm, self.is_locked = initialised, warm, locked
        self.action_s = action_s
        self.reflectors = REFLECTORS
        self.selected = 3
        self.search_radius_mm = 50.0
        self.search_timeout_s = 10.0
        self.point_mm = (1000.0, -2000.0, 254.0)
        self.went_to_mm = None
        self.searched_at_mm = None
        self.measured_s = None
        self.finds = True
        self._happened = []
        self._end = None

    def initialised(self, now_s):
        self.advance(now_s)
        return self.is_initialised

    def laser_warm(self, now_s):
        return self.is_warm

    def beam_locked(self, now_s):
        self.advance(now_s)
        return self.is_locked

    def busy(self, now_s):
        self.advance(now_s)
        return self._end is not None

    def weather(self, now_s):
        return 20.0, 1013.25, 50.0

    def direction(self, now_s):
        return 0.5, 1.5

    def live_point(self, now_s):
        return self.point_mm if self.is_locked else None

    def events(self):
        taken, self._happened = self._happened, []
        return taken

    def next_event_s(self):
        return self._end[0] if self._end else None

    def select_reflector(self, identifier):
        if identifier not in {reflector.id for reflector in self.reflectors}:
            return False
        self.selected = identifier
        return True

    def initialise(self, now_s):
        return self._begin(now_s, self._be_initialised)

    def go_to(self, point_mm, now_s):
        self.went_to_mm = point_mm
        return self._begin(now_s, self._look)

    def find(self, distance_mm, now_s):
        self.searched_at_mm = distance_mm
        return self._begin(now_s, self._look)

    def begin_measurement(self, measuring_time_s, now_s):
        if not self.is_locked:
            return None
        self.measured_s = measuring_time_s
        return now_s + measuring_time_s

    def finish_measurement(self, now_s):
        if not self.is_locked:
            return None
        return Measurement(self.point_mm, COVARIANCE_MM2, Weather(20.0, 1013.25, 50.0))

    def advance(self, now_s):
        if self._end is not None and now_s >= self._end[0]:
            act, self._end = self._end[1], None
            act()

    def lose_the_beam(self):
        self.is_locked = False
        self._happened.append("beam_lost")

    def happens(self, event):
        self._happened.append(event)

    def _begin(self, now_s, act):
        self._end = (now_s + self.action_s, act)
        return self.action_s

    def _be_initialised(self):
        self.is_initialised = True
        self._happened.append("initialised")

    def _look(self):
        self.is_locked = self.finds


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
