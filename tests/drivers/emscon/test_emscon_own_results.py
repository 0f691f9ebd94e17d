"""The emScon driver takes no result for a measurement's own that cannot be."""

from dataclasses import replace

import pytest
from scripted_emscon import RESULT, Station
from timed_pipe import HandClock
from tracker_stage import Stage, seen_mm, tracker

from drivers.declaration import Surroundings
from drivers.emscon.tracker import SIMULATED, EmsconTracker
from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, LinkDown, NotAMeasurement
from drivers.link import EVENTS_KEPT
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon import Answer, encode, refusal
from drivers.wire.emscon_constants import Command, DataType, ResultStatus, SystemChange
from drivers.wire.framing import Packet
from sim.faults import Counted, Fault, FaultScript
from sim.servers.emscon_server import EmsconSession
from sim.tracker.instrument import SimulatedTracker
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


START = Command.START_MEASUREMENT
INCHES = bodies.Units(5, 1, 0, 0, 0)
OTHER_RESULT = replace(RESULT, point=(9.0, 9.0, 9.0))
BROKEN = bodies.ErrorResponse(START, ResultStatus.NO_STATIONARY_RESULT)


def says(station, *timed):
    """The answer to the next StartMeasurement, and what follows it."""
    station.instrument.says[START] = [(0.0, Answer(START)), *timed]


class TestSameAgain:
    def test_result_that_is_the_one_before_byte_for_byte_is_no_measurement(self):
        station = SimulatedStation((2, "repeated", None))
        station.tracker.measure()
        with pytest.raises(NotAMeasurement, match="that of the measurement before") as refused:
            station.tracker.measure()
        assert isinstance(refused.value, BeamBroken), "so that the shot is taken again"
        assert station.measured_mm() == pytest.approx(seen_mm(station.stage.point_mm), abs=0.1)

    def test_it_is_no_measurement_however_often_and_over_whatever_connection(self, station):
        station.tracker.measure()
        for _ in range(2):
            with pytest.raises(NotAMeasurement):
                station.tracker.measure()
            station.tracker.reconnect()

    def test_it_is_no_measurement_either_when_the_one_before_was_refused(self, station):
        says(station, (0.1, RESULT))
        with pytest.raises(NotAMeasurement, match="after its measurement was started"):
            station.tracker.measure()
        says(station, (0.5, RESULT))
        with pytest.raises(NotAMeasurement, match="byte for byte"):
            station.tracker.measure()

    def test_same_point_with_another_scatter_is_a_measurement(self, station):
        first = station.tracker.measure()
        station.instrument.result = replace(RESULT, std=(0.01, 0.02, 0.030000000000000002))
        assert station.tracker.measure().point_in_tracker_mm == first.point_in_tracker_mm

    def test_instrument_that_states_no_scatter_may_measure_the_same_twice(self, station):
        station.instrument.result = replace(RESULT, std=(0.0,) * 3, std_total=0.0)
        assert station.tracker.measure() == station.tracker.measure()


class TestTooSoon:
    def test_result_before_the_measuring_time_is_over_is_no_measurement(self):
        station = SimulatedStation((1, "early", None))
        with pytest.raises(NotAMeasurement, match=r"0\.000 s after .* which takes 2 s"):
            station.tracker.measure()
        assert station.tracker.measure()

    @pytest.mark.parametrize(("after_s", "counts"), [(1.79, False), (1.81, True), (4.0, True)])
    def test_a_tenth_of_the_measuring_time_is_to_spare(self, after_s, counts):
        station = Station().prepared(measuring_time_s=2.0)
        says(station, (after_s, RESULT))
        if counts:
            assert station.tracker.measure()
            return
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()

    def test_time_counts_from_the_question_that_was_not_answered_with_busy(self):
        station = Station().prepared(measuring_time_s=2.0)
        free_s = station.clock.now_s() + 5.0

        def busy_at_first(_request):
            if station.clock.now_s() < free_s:
                return [(0.0, refusal(START, ResultStatus.SERVER_BUSY))]
            return [(0.0, Answer(START)), (0.3, RESULT)]

        station.instrument.says[START] = busy_at_first
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()

    def test_measurement_whose_result_came_too_soon_is_stopped_but_a_failure_is_called_what_it_is(
        self,
    ):
        station = Station().prepared(measuring_time_s=2.0)
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()
        assert station.instrument.commands()[-1] == Command.STOP_MEASUREMENT
        station = Station().prepared(measuring_time_s=2.0)
        says(station, (0.1, replace(RESULT, status=ResultStatus.SENSOR_NOT_LEVELED)))
        with pytest.raises(DeviceNotReady, match="level the tracker"):
            station.tracker.measure()

    def test_simulated_tracker_says_that_it_is_one_and_is_not_judged_by_another_clock(self):
        assert SimulatedStation().tracker.identity().model == SIMULATED == SimulatedTracker.name
        assert SimulatedStation((1, "early", None), knows_time=False).tracker.measure()


class TestLateResults:
    @pytest.mark.parametrize("late_s", [0.0, 1.999, 2.0, 100.0])
    def test_result_of_a_failed_measurement_is_never_that_of_the_next(self, late_s):
        station = SimulatedStation((2, "straggling", late_s))
        station.tracker.measure()
        with pytest.raises(BeamBroken):
            station.tracker.measure()
        station.stage.point_mm += 1.0
        believed = [mm for mm in (self.attempt_mm(station) for _ in range(4)) if mm is not None]
        assert len(believed) >= 3
        assert believed == [pytest.approx(seen_mm(station.stage.point_mm), abs=0.1)] * len(believed)

    def attempt_mm(self, station):
        try:
            return station.measured_mm()
        except NotAMeasurement:
            return None

    def failed_once(self):
        """A station whose latest measurement has failed."""
        station = Station().prepared()
        station.tracker.measure()
        says(station, (0.1, BROKEN))
        with pytest.raises(BeamBroken):
            station.tracker.measure()
        return station

    def is_busy_for(self, station, seconds):
        ends_s = station.clock.now_s() + seconds
        light = Command.GET_TRACKER_STATUS
        station.instrument.says[light] = lambda _: [
            (0.0, Answer(light, 0, bodies.Code(1 if station.clock.now_s() < ends_s else 2)))
        ]

    def test_a_connection_with_results_before_it_or_two_of_them_gives_none(self, station):
        station = self.failed_once()
        says(station, (0.5, OTHER_RESULT), (0.5, RESULT))
        with pytest.raises(NotAMeasurement, match="a second result followed"):
            station.tracker.measure()
        station.tracker.reconnect()
        says(station, (0.5, OTHER_RESULT), (0.5, RESULT))
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()

    def test_result_after_a_failure_is_none_when_another_follows_before_the_light_is_green(self):
        station = self.failed_once()
        says(station, (0.5, OTHER_RESULT), (1.5, RESULT))
        self.is_busy_for(station, 1.6)
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()

    def test_result_after_a_failure_counts_when_the_light_turns_green_and_none_follows(self):
        station = self.failed_once()
        says(station, (0.5, OTHER_RESULT))
        self.is_busy_for(station, 0.9)
        assert station.tracker.measure().point_in_tracker_mm == OTHER_RESULT.point

    def test_second_look_is_taken_once_after_a_failure(self):
        station = self.failed_once()
        says(station, (0.5, OTHER_RESULT))
        station.tracker.measure()
        station.instrument.asked.clear()
        says(station, (0.5, RESULT))
        station.tracker.measure()
        assert station.instrument.commands() == [START]

    def test_first_of_two_results_is_judged_by_its_own_time(self, station):
        station.tracker.measure()
        both = encode(Answer(START)) + encode(OTHER_RESULT)
        station.instrument.says[START] = [
            (0.1, replace(RESULT, point=(1.0, 2.0, 3.0))),
            (3.0, both),
        ]
        with pytest.raises(NotAMeasurement, match=r"0\.1.* s after"):
            station.tracker.measure()

    def test_tracker_that_goes_on_measuring_for_ever_has_given_no_result(self):
        station = self.failed_once()
        says(station, (0.5, OTHER_RESULT))
        station.instrument.state[Command.GET_TRACKER_STATUS] = bodies.Code(1)
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()


class TestSettingsInDoubt:
    def test_units_changed_just_before_a_result_spoil_it(self):
        station = SimulatedStation((1, "other_units", None))
        with pytest.raises(DeviceNotReady, match="changed the tracker's units"):
            station.tracker.measure()

    def test_change_stays_known_until_the_tracker_is_prepared_again(self, station):
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.comes(bodies.StatusChange(SystemChange.UNITS))
        for _ in range(3):
            with pytest.raises(DeviceNotReady, match="another program changed the tracker's units"):
                station.tracker.measure()
        assert START not in station.instrument.commands()
        station.tracker.prepare("CCR-1.5in", 0.5)
        assert station.tracker.measure()

    def test_change_stays_known_when_it_could_not_be_read_back(self, station):
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.comes(bodies.StatusChange(SystemChange.UNITS))
        station.instrument.refuses[Command.GET_UNITS] = ResultStatus.USAGE_CONFLICT
        with pytest.raises(DeviceRefused, match="GetUnits"):
            station.tracker.measure()
        station.instrument.refuses.clear()
        with pytest.raises(DeviceNotReady, match="units"):
            station.tracker.measure()

    def test_change_is_known_however_much_comes_after_it(self, station):
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.comes(bodies.StatusChange(SystemChange.UNITS))
        station.pipe.arrives(
            0.0, encode(bodies.StatusChange(SystemChange.LIGHT_BUSY)) * 2 * EVENTS_KEPT
        )
        with pytest.raises(DeviceNotReady, match="units"):
            station.tracker.measure()

    @pytest.mark.parametrize(
        "live",
        [
            bodies.ReflectorPosition(0, (1.0, 2.0, 3.0)),
            Packet(DataType.MULTI_RESULT, bytes(40)),
            Packet(DataType.MULTI_RESULT_2, bytes(40)),
        ],
    )
    def test_live_results_push_nothing_out_of_the_queue(self, station, live):
        data = encode(RESULT) + encode(live) * 2 * EVENTS_KEPT
        says(station, (0.5, data))
        assert station.tracker.measure().point_in_tracker_mm == RESULT.point

    @pytest.mark.parametrize(
        "live",
        [bodies.ReflectorPosition(0, (1.0, 2.0, 3.0)), Packet(DataType.MULTI_RESULT, b"1234")],
    )
    def test_live_results_show_that_somebody_changed_settings(self, station, live):
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.comes(live)
        with pytest.raises(DeviceNotReady, match="units"):
            station.tracker.measure()

    def test_whatever_fell_out_of_the_queue_makes_settings_be_read_back(self, station):
        station.tracker.measure()
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.pipe.arrives(0.0, encode(bodies.ErrorResponse(64, 36)) * (EVENTS_KEPT + 1))
        with pytest.raises(DeviceNotReady, match="units"):
            station.tracker.measure()


class TestMeasuringTime:
    def test_time_that_is_accepted_but_not_kept_is_refused_with_both(self):
        station = Station().connected()
        station.instrument.state[Command.GET_STATIONARY_MODE_PARAMS] = bodies.StationaryMode(500, 1)
        setting = Command.SET_STATIONARY_MODE_PARAMS
        station.instrument.says[setting] = [(0.0, Answer(setting))]
        with pytest.raises(DeviceRefused, match="is 500 ms after 2000 ms was set"):
            station.tracker.prepare("CCR-1.5in", 2.0)
        with pytest.raises(DeviceNotReady, match="not prepared"):
            station.tracker.measure()


def test_refused_result_leaves_the_wire_open_but_a_stop_that_is_busy_closes_it():
    station = Station().prepared(measuring_time_s=2.0)
    station.instrument.refuses[Command.STOP_MEASUREMENT] = ResultStatus.SERVER_BUSY
    with pytest.raises(NotAMeasurement):
        station.tracker.measure()
    with pytest.raises(LinkDown):
        station.tracker.measure()
