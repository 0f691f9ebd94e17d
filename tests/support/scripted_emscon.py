"""An emScon instrument at the other end of a pipe, which says what a test tells it to say."""

from timed_pipe import FarEnd

from drivers.declaration import Surroundings
from drivers.emscon.client import EmsconDeadlines
from drivers.emscon.tracker import EmsconTracker
from drivers.wire import emscon_messages
from drivers.wire.emscon import NOTHING, Answer, encode, from_client, refusal
from drivers.wire.emscon_constants import Command

PATIENT = EmsconDeadlines()
RESULT = emscon_messages.SingleResult2(
    status=0,
    mode=0,
    is_trial=0,
    point=(1000.5, -2000.25, 300.125),
    std=(0.01, 0.02, 0.03),
    std_total=0.0374,
    covariance=(1e-5, 2e-5, -3e-5),
    pointing_error=(0.0, 0.0, 0.0),
    apriori_std=(0.005, 0.005, 0.005),
    apriori_std_total=0.0087,
    apriori_covariance=(0.0, 0.0, 0.0),
    temperature=20.5,
    pressure=1001.0,
    humidity=45.0,
)
SETS = {
    Command.SET_UNITS: Command.GET_UNITS,
    Command.SET_COORDINATE_SYSTEM_TYPE: Command.GET_COORDINATE_SYSTEM_TYPE,
    Command.SET_MEASUREMENT_MODE: Command.GET_MEASUREMENT_MODE,
    Command.SET_STATIONARY_MODE_PARAMS: Command.GET_STATIONARY_MODE_PARAMS,
    Command.SET_REFLECTOR: Command.GET_REFLECTOR,
    Command.SET_SYSTEM_SETTINGS: Command.GET_SYSTEM_SETTINGS,
}
NAMES = {12: "CCR-1.5in", 3: "CCR-0.5in", 40: "RRR 1.5in"}


def system_status(processor=5, laser=3, serial=390793):
    return emscon_messages.SystemStatus(0, processor, laser, 2, 3, 8, 500, 2, 0, serial)


class Instrument:
    """Answers as a willing AT401, unless a test puts something into `says` or `refuses`.

    `says[command]` is a list of (seconds, message or bytes), or a function of the request.
    """

    def __init__(self):
        self.asked = []
        self.says = {}
        self.refuses = {}
        self.state = {
            Command.GET_SYSTEM_STATUS: system_status(),
            Command.GET_TRACKER_STATUS: emscon_messages.Code(2),
            Command.GET_UNITS: emscon_messages.Units(0, 0, 0, 0, 0),
            Command.GET_COORDINATE_SYSTEM_TYPE: emscon_messages.Code(7),
            Command.GET_MEASUREMENT_MODE: emscon_messages.Code(21),
            Command.GET_STATIONARY_MODE_PARAMS: emscon_messages.StationaryMode(100, 0),
            Command.GET_REFLECTOR: emscon_messages.Code(3),
            Command.GET_SYSTEM_SETTINGS: emscon_messages.SystemSettings(1, 1, 1, 0, 0, 1, 1, 1, 1),
            Command.GET_ENVIRONMENT_PARAMS: emscon_messages.Environment(20.5, 1001.0, 45.0),
            Command.GET_MEASUREMENT_STATUS_INFO: emscon_messages.MeasurementStatusInfo(
                0, 2048 | 65536
            ),
            Command.GET_TRACKER_INFO: emscon_messages.TrackerInfo(70, "AT401", 390793, *[0] * 14),
        }
        self.result = RESULT

    def lose_the_beam(self):
        self.state[Command.GET_TRACKER_STATUS] = emscon_messages.Code(0)
        self.state[Command.GET_MEASUREMENT_STATUS_INFO] = emscon_messages.MeasurementStatusInfo(
            0, 65536
        )

    def respond(self, data):
        (request,) = from_client()(data)
        self.asked.append(request)
        said = self.says.get(request.command)
        if callable(said):
            said = said(request)
        if said is None:
            said = self._usual(request)
        return [(s, m if isinstance(m, bytes) else encode(m)) for s, m in said]

    def commands(self):
        return [request.command for request in self.asked]

    def body_of(self, command):
        """The parameters of the last such request."""
        return next(r.body for r in reversed(self.asked) if r.command == command)

    def _usual(self, request):
        command = request.command
        if status := self.refuses.get(command):
            return [(0.0, refusal(command, status))]
        if command in SETS:
            self.state[SETS[command]] = request.body
        if command == Command.GET_REFLECTORS:
            entry, count = emscon_messages.ReflectorEntry, len(NAMES)
            bodies = [entry(count, number, 1, 19.05, name) for number, name in NAMES.items()]
            return [(0.0, Answer(command, 0, body)) for body in bodies]
        answer = (0.0, Answer(command, 0, self.state.get(command, NOTHING)))
        if command == Command.START_MEASUREMENT:
            return [answer, (0.5, self.result)]
        return [answer]


class Station(FarEnd):
    """A driver connected to a scripted instrument."""

    def __init__(self, instrument=None, deadlines=PATIENT, **given):
        super().__init__()
        self.instrument = instrument or Instrument()
        self.tracker = EmsconTracker(
            Surroundings(open_transport=self.open, clock=self.clock, **given), deadlines
        )

    def respond(self, data):
        return self.instrument.respond(data)

    def connected(self):
        self.tracker.connect()
        return self

    def prepared(self, reflector="CCR-1.5in", measuring_time_s=0.5):
        self.tracker.connect()
        self.tracker.prepare(reflector, measuring_time_s)
        self.instrument.asked.clear()
        return self

    def comes(self, *messages):
        """Let messages come in unasked."""
        for message in messages:
            self.pipe.arrives(0.0, encode(message))
