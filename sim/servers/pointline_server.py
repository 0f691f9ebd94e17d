"""The simulated tracker's side of pointline (docs/reference/pointline.md): one connection.

Questions are worked on one after another, in the order of their coming: pointline's answer comes
when the work is done, so that a real server may simply block. This one has no thread to block. A
question that takes time leaves its `PendingAnswer`, the end and the step that yields the outcome;
until then further questions wait.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from typing_extensions import override

from drivers.values import vector
from drivers.wire import pointline as wire
from drivers.wire.lines import Answer, BadQuestion, Greeting, Hello, Nothing, Question, Refused
from sim.servers.conversation import ServedSession
from sim.tracker.instrument import SimulatedTracker

MODEL = "SIM-PL"
NO_REFLECTOR_FOUND = Refused("BEAM", "no reflector was found")
MOST_WAITING = 100
"""Questions that are kept while one is worked on; more are lost, as in a full buffer."""


class PendingAnswer(NamedTuple):
    """Answer that takes time."""

    due_s: float
    finish: Callable[[float], object]
    """Yields the outcome at the time that it is given."""


"""End of a question's work, and the step that then yields its outcome."""


class PointlineSession(ServedSession):
    """Answers one client, one question after another; settings belong to the tracker."""

    def __init__(self, tracker: SimulatedTracker, send: Callable[[bytes], None]) -> None:
        self._tracker = tracker
        self._send = send
        self._lines = wire.GRAMMAR.line_framer()
        self._measuring_time_s = 1.0
        self._waiting: deque[Question] = deque()
        self._under_way: tuple[Question, PendingAnswer] | None = None

    @override
    def received(self, data: bytes, now_s: float) -> None:
        """Obey every line that these bytes complete; `advance` answers what takes time."""
        # a line that is no question is answered out of turn, as it has no place in the order
        for line in filter(None, self._lines.feed(data)):
            try:
                question = wire.GRAMMAR.decode_question(line)
            except BadQuestion as bad:
                if bad.answer is not None:
                    self._send(wire.GRAMMAR.encode_answer(bad.answer))
            else:
                if len(self._waiting) < MOST_WAITING:
                    self._waiting.append(question)
            self.advance(now_s)

    @override
    def advance(self, now_s: float) -> None:
        """Answer what is due, and go on with the questions behind it."""
        self._tracker.advance(now_s)
        while self._under_way is not None or self._waiting:
            if self._under_way is None:
                question = self._waiting.popleft()
                outcome = self._obey(question, now_s)
                if isinstance(outcome, PendingAnswer):  # the outcome comes later
                    self._under_way = question, outcome
                    continue
            else:
                question, (due_s, finish) = self._under_way
                if now_s < due_s:
                    return
                outcome, self._under_way = finish(now_s), None
            self._send(wire.GRAMMAR.encode_answer(Answer(question.number, question.verb, outcome)))

    @override
    def next_due_s(self) -> float | None:
        """Return the time of the next event of its own; None if all depends on the client."""
        due_s = None if self._under_way is None else self._under_way[1].due_s
        times = (self._tracker.next_event_s(), due_s)
        return min((time_s for time_s in times if time_s is not None), default=None)

    @override
    def closed(self, now_s: float) -> None:
        """Drop all questions; the beam stays where it is."""
        self._under_way = None
        self._waiting.clear()

    def _obey(self, request: Question, now_s: float) -> object | PendingAnswer:
        tracker = self._tracker
        match request.body:
            case Hello(version):
                if version != wire.VERSION:
                    return Refused("VERSION", f"version {wire.VERSION} is spoken here")
                return Greeting(
                    wire.VERSION, tracker.vendor, MODEL, tracker.serial, tracker.firmware
                )
            case wire.ReadReflector(index):
                return self._definition(index)
            case wire.Prepare(name, seconds):
                return self._prepare(name, seconds, now_s)
            case wire.GoTo(point_mm):
                return self._work_until_seen(tracker.go_to(point_mm, now_s), now_s)
            case wire.Find(distance_mm):
                return self._work_until_seen(tracker.find(distance_mm, now_s), now_s)
        # verbs without arguments have one body in common
        match request.verb:
            case "MEASURE":
                return self._measure(now_s)
            case "AIR":
                return wire.Air(*tracker.weather(now_s))
            case "DIRECTION":
                return wire.BeamDirection(vector(tracker.beam.point_in_tracker_mm(now_s)))
        return wire.InstrumentStatus(
            tracker.busy(now_s),
            tracker.initialised(now_s),
            tracker.laser_warm(now_s),
            tracker.beam_locked(now_s),
            self._reflector,
        )

    @property
    def _reflector(self) -> str:
        tracker = self._tracker
        return next(r.name for r in tracker.reflectors if r.id == tracker.selected)

    def _definition(self, index: int) -> wire.ReflectorDefinition | Refused:
        reflectors = self._tracker.reflectors
        if index >= len(reflectors):
            return Refused("ARGUMENT", f"reflector {index}, there are 0 to {len(reflectors) - 1}")
        reflector = reflectors[index]
        return wire.ReflectorDefinition(
            len(reflectors), reflector.name, reflector.surface_offset_mm
        )

    def _prepare(self, name: str, seconds: float, now_s: float) -> object | PendingAnswer:
        tracker = self._tracker
        reflector = next((r for r in tracker.reflectors if r.name == name), None)
        if reflector is None:
            return Refused("REFLECTOR", f"there is no reflector {name}")
        if not tracker.laser_warm(now_s):
            return Refused("COLD", "the laser is heating up")
        tracker.select_reflector(reflector.id)
        self._measuring_time_s = seconds
        # PREPARE initialises only if necessary, since that turns the head and loses the beam
        takes_s = 0.0 if tracker.initialised(now_s) else tracker.initialise(now_s)
        return PendingAnswer(now_s + takes_s, lambda _: Nothing())

    def _measure(self, now_s: float) -> Refused | PendingAnswer:
        due_s = self._tracker.begin_measurement(self._measuring_time_s, now_s)
        if due_s is None:
            return Refused("NOBEAM", "the beam is on no reflector")
        return PendingAnswer(due_s, self._finish_measuring)

    def _finish_measuring(self, now_s: float) -> wire.PointMeasured | Refused:
        shot = self._tracker.finish_measurement(now_s)
        if shot is None or shot.covariance_mm2 is None:
            return Refused("BEAM", "the beam was lost while it was measured")
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = shot.covariance_mm2
        # the number of a measurement differs for each, also over restarts of the cell: a client
        # refuses a repeated one
        count = len(self._tracker.taken)
        terms = xx, xy, xz, yy, yz, zz
        return wire.PointMeasured(count, self._reflector, shot.point_in_tracker_mm, terms)

    def _work_until_seen(self, seconds: float, now_s: float) -> PendingAnswer:
        def finish(end_s: float) -> Nothing | Refused:
            return Nothing() if self._tracker.beam_locked(end_s) else NO_REFLECTOR_FOUND

        return PendingAnswer(now_s + seconds, finish)
