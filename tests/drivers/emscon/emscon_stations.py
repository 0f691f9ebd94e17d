"""A driver with the simulated server itself at the other end."""

from timed_pipe import HandClock
from tracker_stage import Stage, tracker

from drivers.declaration import Surroundings
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import LinkDown
from sim.faults import Counted, Fault, FaultScript
from sim.servers.emscon_server import EmsconSession
from sim.tracker.optics import Noise


class SimulatedPipe:
    """A pipe to a simulated session, on a clock that passes only while somebody waits."""

    name = "pipe://simulated"

    def __init__(self, clock, make_session):
        self.clock = clock
        self.is_closed = False
        self._coming = []
        self.session = make_session(self._coming.append)

    def send(self, data, timeout_s):
        self._raise_if_closed()
        self.session.received(data, self.clock.now_s())

    def receive(self, timeout_s):
        self._raise_if_closed()
        latest_s = self.clock.now_s() + timeout_s
        self.session.advance(self.clock.now_s())
        while not self._coming and self.clock.now_s() < latest_s:
            due_s = self.session.next_due_s()
            self.clock.time_s = (
                latest_s if due_s is None else min(max(due_s, self.clock.time_s), latest_s)
            )
            self.session.advance(self.clock.now_s())
        data = b"".join(self._coming)
        self._coming.clear()
        return data

    def close(self):
        self.is_closed = True

    def _raise_if_closed(self):
        if self.is_closed:
            raise LinkDown(f"{self.name}: closed", remedy="-")


class SimulatedStation:
    """A prepared driver and the simulated tracker, with faults (number of the result, kind, s)."""

    def __init__(self, *faults, noise_mm=0.01, measuring_time_s=2.0, knows_time=True):
        self.clock = HandClock()
        self.stage = Stage()
        self.instrument = tracker(self.stage, noise=Noise(coordinate_mm=noise_mm))
        self.faults = FaultScript([Fault(Counted.RESULT, *fault) for fault in faults], {})
        self.pipes = []
        self.tracker = EmsconTracker(
            Surroundings(open_transport=self._open, clock=self.clock, in_process=knows_time)
        )
        self.tracker.connect()
        self.tracker.prepare("CCR-1.5in", measuring_time_s)

    def measured_mm(self):
        return self.tracker.measure().point_in_tracker_mm

    def _open(self, **_):
        self.pipes.append(
            SimulatedPipe(
                self.clock, lambda send: EmsconSession(self.instrument, send, faults=self.faults)
            )
        )
        return self.pipes[-1]
