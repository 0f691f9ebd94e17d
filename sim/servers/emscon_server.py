"""The simulated tracker's side of emScon (docs/reference/emscon.md): one connection, no socket.

Theory of operation. emScon is asynchronous: answers, results, status changes and errors share one
stream, and a client must sort them by their packet's type.

1. Settings and questions (`EmsconInstrument`) are answered at once.
2. Initialize, GoPosition and FindReflector are answered at their end. StartMeasurement is answered
   at its begin, and its end sends a result packet, or an error packet in its place.
3. One command may be under way (`_pending`). Until its end every other command is refused as busy;
   only StopMeasurement comes through.
4. Unasked packets report the traffic light, a lost beam, initialisation, warm-up, changes of
   settings, and live positions, if the client has switched them on.

`_catch_up` carries out what is due before each request and in each `advance`, so that a request
meets the state of its own time. `at_result` faults change a result after it was measured, not
before: the tracker's record has the true one, and a client that believes the packet is found out.

No public source has the numbers of some errors, nor the order of some packets; docs/reference/
emscon.md lists them, and what is chosen here is marked.
"""

from collections.abc import Callable
from dataclasses import replace
from math import hypot

from typing_extensions import override

from drivers.values import DISTANCE
from drivers.wire import emscon
from drivers.wire import emscon_messages as said
from drivers.wire.emscon_constants import (
    WRONG_PARAMETERS,
    Command,
    ResultStatus,
    SystemChange,
    TrackerLight,
)
from sim.faults import Counted, Fault, FaultScript
from sim.servers.conversation import ServedSession
from sim.servers.emscon_instrument import EmsconInstrument, EmsconOutcome
from sim.servers.emscon_units import POWER_ON_UNITS, from_wire, to_wire
from sim.tracker.instrument import SimulatedTracker

UNKNOWN_COMMAND = 64
"""Command number in an error packet that is about no command."""
BEAM_LOST_STATUS = ResultStatus.NO_STATIONARY_RESULT
NOT_FOUND_STATUS = ResultStatus.UNKNOWN
"""Our choice from the public table: no public source has the real numbers."""
POSITION_INTERVAL_S = 1.0 / 3.0

LIGHT_CHANGES = {
    TrackerLight.NOT_READY: SystemChange.LIGHT_NOT_READY,
    TrackerLight.BUSY: SystemChange.LIGHT_BUSY,
    TrackerLight.READY: SystemChange.LIGHT_READY,
}
EVENT_CHANGES = {
    "warmed_up": SystemChange.LASER_WARMED_UP,
    "initialised": SystemChange.INITIALIZATION,
}


class EmsconSession(ServedSession):
    """Answers one client, one command at a time; `WireError` means that it must be closed.

    A second client is refused every command. `instrument` keeps its settings over sessions; without
    it they are those of power-on.
    """

    def __init__(
        self,
        tracker: SimulatedTracker,
        send: Callable[[bytes], None],
        *,
        instrument: EmsconInstrument | None = None,
        is_second: bool = False,
        faults: FaultScript | None = None,
    ) -> None:
        self._tracker = tracker
        self._send = send
        self._is_second = is_second
        self._faults = faults
        self._requests = emscon.from_client()
        self._instrument = EmsconInstrument(tracker) if instrument is None else instrument
        self._pending: tuple[Command, float] | None = None
        """Command under way and its end; None: the next command is accepted."""
        self._shown: TrackerLight | None = None
        self._next_position_s = 0.0
        self._fault: Fault | None = None
        """Fault that hits the result of the present measurement."""
        self._latest_result: bytes | None = None
        self._straggler: tuple[bytes, float] | None = None
        """Result that is sent after its measurement was reported as failed, and the time."""

    @override
    def received(self, data: bytes, now_s: float) -> None:
        """Obey the requests that these bytes complete; raises `WireError` for other packets.

        What they change is reported by `advance`, which is to be called next.
        """
        for request in self._requests(data):
            self._catch_up(now_s)
            self._obey(request, now_s)

    @override
    def advance(self, now_s: float) -> None:
        """End what is due, and report what has happened by now."""
        self._catch_up(now_s)
        if not self._is_second:
            self._report_light(self._light(now_s))
            self._send_position(now_s)

    @override
    def next_due_s(self) -> float | None:
        """Return the time of the next event of its own; None if all depends on the client."""
        if self._is_second:
            return None
        times = [
            self._pending[1] if self._pending is not None else None,
            self._straggler[1] if self._straggler is not None else None,
            self._tracker.next_event_s(),
            self._next_position_s if self._instrument.settings.send_reflector_position else None,
        ]
        return min((time_s for time_s in times if time_s is not None), default=None)

    @override
    def closed(self, now_s: float) -> None:
        """Drop the command under way; the head finishes its motion."""
        self._pending = None

    def _catch_up(self, now_s: float) -> None:
        if self._is_second:
            return
        self._tracker.advance(now_s)
        self._send_events()
        if self._straggler is not None and now_s >= self._straggler[1]:
            self._send(self._straggler[0])
            self._straggler = None
        if self._pending is not None and now_s >= self._pending[1]:
            self._finish(self._pending[0], now_s)

    def _obey(self, request: emscon.FromClient, now_s: float) -> None:
        status = self._obstacle(request, now_s)
        if status != ResultStatus.ALL_OK:
            self._send(emscon.refusal(request.command, status))
        elif isinstance(request, emscon.EmsconRequest):
            body = from_wire(request.body, self._instrument.units)
            self._act(replace(request, body=body), now_s)

    def _obstacle(self, request: emscon.FromClient, now_s: float) -> ResultStatus:
        """Return the status that refuses a command before its content is looked at."""
        if self._is_second:
            return ResultStatus.MULTI_CONNECTIONS_NOT_ALLOWED
        if isinstance(request, emscon.UnknownRequest):
            return ResultStatus.NOT_IMPLEMENTED
        stops = request.command == Command.STOP_MEASUREMENT and self._is_measuring
        return (
            ResultStatus.SERVER_BUSY if self._is_busy(now_s) and not stops else ResultStatus.ALL_OK
        )

    @property
    def _is_measuring(self) -> bool:
        return self._pending is not None and self._pending[0] == Command.START_MEASUREMENT

    def _act(self, request: emscon.EmsconRequest, now_s: float) -> None:
        match request.command:
            case Command.STOP_MEASUREMENT:
                self._pending = None
                self._answer(request.command, EmsconOutcome())
            case Command.START_MEASUREMENT:
                begun = EmsconOutcome(self._begin_measurement(now_s))
                self._answer(request.command, begun)
            case Command.INITIALIZE | Command.GO_POSITION | Command.FIND_REFLECTOR:
                self._move(request, now_s)
            case Command.GET_TRACKER_STATUS:
                light = said.Code(self._light(now_s))
                self._answer(request.command, EmsconOutcome(bodies=(light,)))
            case _:
                self._answer(request.command, self._instrument.obey(request, now_s))

    def _answer(self, command: Command, outcome: EmsconOutcome) -> None:
        if outcome.status != ResultStatus.ALL_OK:
            self._send(emscon.refusal(command, outcome.status))
            return
        for body in outcome.bodies:
            # the instrument answers in mm, rad, °C and hPa: only the wire has the units set
            body_on_wire = to_wire(body, self._instrument.units)
            self._send(emscon.encode(emscon.Answer(command, body=body_on_wire)))
        # whether a change comes before or after its answer is not public: after is our choice
        if outcome.change is not None:
            self._send_change(outcome.change)

    def _begin_measurement(self, now_s: float) -> ResultStatus:
        """Begin a measurement, or return the status that refuses it."""
        if (status := self._why_not_ready(now_s)) != ResultStatus.ALL_OK:
            return status
        end_s = self._tracker.begin_measurement(self._instrument.measuring_time_s, now_s)
        if end_s is None:
            return ResultStatus.MEASUREMENT_STATUS_NOT_READY
        self._fault = None if self._faults is None else self._faults.next(Counted.RESULT)
        due_s = now_s if self._is_wrong("early") else end_s
        self._pending = (Command.START_MEASUREMENT, due_s)
        return ResultStatus.ALL_OK

    def _move(self, request: emscon.EmsconRequest, now_s: float) -> None:
        command, initialises = request.command, request.command == Command.INITIALIZE
        obstacle = ResultStatus.ALL_OK
        if not initialises and not self._tracker.initialised(now_s):
            obstacle = ResultStatus.TRACKER_NOT_INITIALIZED
        elif initialises:
            obstacle = self._why_not_warm(now_s)
        if obstacle != ResultStatus.ALL_OK:
            self._answer(command, EmsconOutcome(obstacle))
            return
        # answered by `_finish`, when the head has arrived
        move_s = self._tracker.initialise(now_s) if initialises else self._motion_s(request, now_s)
        if move_s is None:
            self._answer(command, EmsconOutcome(WRONG_PARAMETERS[0]))
        else:
            self._pending = command, now_s + move_s

    def _motion_s(self, request: emscon.EmsconRequest, now_s: float) -> float | None:
        """Start a motion and return its duration, s; None if a tracker sees no such place."""
        # a place beyond a tracker's distance is a wrong parameter, not a search that finds nothing
        body = request.body
        if isinstance(body, said.BeamTarget) and _is_in_sight(*body.point):
            return self._tracker.go_to(body.point, now_s)
        if isinstance(body, said.ApproximateDistance) and _is_in_sight(body.distance):
            return self._tracker.find(body.distance, now_s)
        return None

    def _finish(self, command: Command, now_s: float) -> None:
        self._pending = None
        if command == Command.START_MEASUREMENT:
            self._deliver(now_s)
        elif command == Command.INITIALIZE or self._tracker.beam_locked(now_s):
            self._answer(command, EmsconOutcome())
        else:
            self._answer(command, EmsconOutcome(NOT_FOUND_STATUS))

    def _deliver(self, now_s: float) -> None:
        shot = self._tracker.finish_measurement(now_s)
        if shot is None:
            self._send_failure()
            return
        # as if another program had set the units just before: the client that watches for changes
        # gets the event and then a result in metres
        if self._is_wrong("other_units"):
            self._instrument.obey(emscon.EmsconRequest(Command.SET_UNITS, POWER_ON_UNITS), now_s)
            self._send_change(SystemChange.UNITS)
        result = to_wire(self._instrument.result_of(shot), self._instrument.units)
        self._send_result(emscon.encode(result), now_s)

    def _send_result(self, result: bytes, now_s: float) -> None:
        """Send a result, or what a fault makes of it."""
        if self._is_wrong("straggling"):
            late_s = 0.0 if self._fault is None else self._fault.seconds or 0.0
            self._straggler = result, now_s + late_s
            self._send_failure()
            return
        if self._is_wrong("repeated") and self._latest_result is not None:
            result = self._latest_result
        self._latest_result = result
        self._send(result)

    def _send_failure(self) -> None:
        self._send(emscon.encode(said.ErrorResponse(Command.START_MEASUREMENT, BEAM_LOST_STATUS)))

    def _is_wrong(self, kind: str) -> bool:
        """Whether the present measurement has a fault of this kind."""
        return self._fault is not None and self._fault.kind == kind

    def _why_not_ready(self, now_s: float) -> ResultStatus:
        if not self._tracker.initialised(now_s):
            return ResultStatus.TRACKER_NOT_INITIALIZED
        return self._why_not_warm(now_s)

    def _why_not_warm(self, now_s: float) -> ResultStatus:
        is_warm = self._tracker.laser_warm(now_s)
        return ResultStatus.ALL_OK if is_warm else ResultStatus.SENSOR_NOT_WARMED_UP

    def _is_busy(self, now_s: float) -> bool:
        # the head may still move for a client that has left, whose command is no longer pending
        return self._pending is not None or self._tracker.busy(now_s)

    def _light(self, now_s: float) -> TrackerLight:
        if self._is_busy(now_s):
            return TrackerLight.BUSY
        obstacle = self._why_not_ready(now_s)
        is_ready = obstacle == ResultStatus.ALL_OK and self._tracker.beam_locked(now_s)
        return TrackerLight.READY if is_ready else TrackerLight.NOT_READY

    def _send_events(self) -> None:
        for event in self._tracker.events():
            if event in EVENT_CHANGES:
                self._send_change(EVENT_CHANGES[event])
            elif event == "beam_lost":
                self._report_lost_beam()

    def _report_lost_beam(self) -> None:
        """Report the red light, and the command that fails without the beam, if any."""
        self._report_light(TrackerLight.NOT_READY)
        # An error that ends a measurement is sent even to a client without unasked messages, which
        # would else wait for a result until its deadline.
        failed: int = UNKNOWN_COMMAND
        if self._is_measuring:
            failed, self._pending = Command.START_MEASUREMENT, None
        if failed != UNKNOWN_COMMAND or self._instrument.settings.send_unsolicited_messages:
            self._send(emscon.encode(said.ErrorResponse(failed, BEAM_LOST_STATUS)))

    def _report_light(self, light: TrackerLight) -> None:
        """Report the light if it has changed since the last call; the first one is not reported."""
        if self._shown not in {None, light}:
            self._send_change(LIGHT_CHANGES[light])
        self._shown = light

    def _send_position(self, now_s: float) -> None:
        if not self._instrument.settings.send_reflector_position or now_s < self._next_position_s:
            return
        # the next one is due by the time of this one, so that late ones do not pile up
        self._next_position_s = now_s + POSITION_INTERVAL_S
        if (point_mm := self._tracker.live_point(now_s)) is not None:
            live = said.ReflectorPosition(ResultStatus.ALL_OK, point_mm)
            self._send(emscon.encode(to_wire(live, self._instrument.units)))

    def _send_change(self, change: SystemChange) -> None:
        if self._instrument.settings.send_unsolicited_messages:
            self._send(emscon.encode(said.StatusChange(change)))


def _is_in_sight(*coordinates_mm: float) -> bool:
    """Whether a place is within a tracker's distance; NaN and infinity are not."""
    return DISTANCE.holds(hypot(*coordinates_mm))
