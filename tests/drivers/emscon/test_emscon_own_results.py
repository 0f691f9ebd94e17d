"""The emScon driver takes no result for a measurement's own that cannot be."""

from dataclasses import replace

import pytest
from scripted_emscon import RESULT, Instrument, Station

from drivers.emscon.tracker import SIMULATED
from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused, LinkDown, NotAMeasurement
from drivers.link import EVENTS_KEPT
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon import Answer, encode, refusal
from drivers.wire.emscon_constants import Command, DataType, ResultStatus, SystemChange
from drivers.wire.framing import Packet
from sim.tracker.instrument import SimulatedTracker

START = Command.START_MEASUREMENT
INCHES = bodies.Units(5, 1, 0, 0, 0)
OTHER_RESULT = replace(RESULT, point=(9.0, 9.0, 9.0))
BROKEN = bodies.ErrorResponse(START, ResultStatus.NO_STATIONARY_RESULT)


def says(station, *timed):
    """The answer to the next StartMeasurement, and what follows it."""
    station.instrument.says[START] = [(0.0, Answer(START)), *timed]


class TestSameAgain:
    def test_result_before_is_no_measurement_however_often_and_over_any_connection(self, station):
        station.tracker.measure()
        for _ in range(2):
            with pytest.raises(NotAMeasurement, match="that of the measurement before") as refused:
                station.tracker.measure()
            assert isinstance(refused.value, BeamBroken), "so that the shot is taken again"
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


class TestMoving:
    @pytest.mark.parametrize(
        ("std", "stated", "counts"),
        [
            ((0.1, 0.1, 0.1), 0.01, True),
            ((0.1, 0.15, 0.1), 0.01, False),
            ((3.0, 0.1, 0.1), 0.0, False),
            ((3.0, 0.0, 0.0), 0.01, True),
            ((0.2, 0.2, 0.2), 0.05, True),
            ((0.3, 0.3, 0.3), 0.05, False),
        ],
    )
    def test_readings_that_scatter_as_of_a_moving_reflector_are_no_measurement(
        self, station, std, stated, counts
    ):
        result = replace(RESULT, std=std, apriori_std=(stated,) * 3)
        station.instrument.result = result
        if counts:
            assert station.tracker.measure().point_in_tracker_mm == RESULT.point
            return
        with pytest.raises(NotAMeasurement, match="the reflector moved while it was measured"):
            station.tracker.measure()


class TestTooSoon:
    @pytest.mark.parametrize(
        ("after_s", "counts"), [(0.0, False), (1.79, False), (1.81, True), (4.0, True)]
    )
    def test_a_tenth_of_the_measuring_time_is_to_spare(self, after_s, counts):
        station = Station().prepared(measuring_time_s=2.0)
        says(station, (after_s, RESULT))
        if counts:
            assert station.tracker.measure()
            return
        with pytest.raises(NotAMeasurement, match="which takes 2 s"):
            station.tracker.measure()
        assert station.instrument.commands()[-1] == Command.STOP_MEASUREMENT

    def test_failure_that_comes_too_soon_is_called_what_it_is(self):
        station = Station().prepared(measuring_time_s=2.0)
        says(station, (0.1, replace(RESULT, status=ResultStatus.SENSOR_NOT_LEVELED)))
        with pytest.raises(DeviceNotReady, match="level the tracker"):
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

    def test_stop_that_is_answered_with_busy_closes_the_wire(self):
        station = Station().prepared(measuring_time_s=2.0)
        station.instrument.refuses[Command.STOP_MEASUREMENT] = ResultStatus.SERVER_BUSY
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()
        with pytest.raises(LinkDown):
            station.tracker.measure()

    @pytest.mark.parametrize("in_process", [True, False])
    def test_simulated_tracker_is_judged_by_its_clock_only_where_it_is_ours(self, in_process):
        instrument = Instrument()
        info = bodies.TrackerInfo(0, SimulatedTracker.name, 390793, *[0] * 14)
        instrument.state[Command.GET_TRACKER_INFO] = info
        station = Station(instrument, in_process=in_process).prepared(measuring_time_s=2.0)
        assert station.tracker.identity().model == SIMULATED
        if not in_process:
            assert station.tracker.measure()
            return
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()


def failed_once():
    """A station whose latest measurement has failed."""
    station = Station().prepared()
    station.tracker.measure()
    says(station, (0.1, BROKEN))
    with pytest.raises(BeamBroken):
        station.tracker.measure()
    return station


def is_busy_for(station, seconds):
    ends_s = station.clock.now_s() + seconds
    light = Command.GET_TRACKER_STATUS
    station.instrument.says[light] = lambda _: [
        (0.0, Answer(light, 0, bodies.Code(1 if station.clock.now_s() < ends_s else 2)))
    ]


class TestLateResults:
    def test_two_results_after_a_failure_or_a_reconnection_give_none(self):
        station = failed_once()
        for humidity in (50.0, 60.0):
            says(station, (0.5, replace(OTHER_RESULT, humidity=humidity)), (0.5, RESULT))
            with pytest.raises(NotAMeasurement, match="a second result followed"):
                station.tracker.measure()
            station.tracker.reconnect()

    @pytest.mark.parametrize(("second_s", "busy_s"), [(1.5, 1.6), (60.0, 1e6)])
    def test_result_after_a_failure_is_none_before_the_tracker_is_idle(self, second_s, busy_s):
        station = failed_once()
        says(station, (0.5, OTHER_RESULT), (second_s, RESULT))
        is_busy_for(station, busy_s)
        with pytest.raises(NotAMeasurement):
            station.tracker.measure()

    def test_result_after_a_failure_counts_when_none_follows_and_the_next_at_once(self):
        station = failed_once()
        says(station, (0.5, OTHER_RESULT))
        is_busy_for(station, 0.9)
        assert station.tracker.measure().point_in_tracker_mm == OTHER_RESULT.point
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


LIVE = [
    bodies.ReflectorPosition(0, (1.0, 2.0, 3.0)),
    Packet(DataType.MULTI_RESULT, bytes(40)),
    Packet(DataType.MULTI_RESULT_2, bytes(40)),
]
UNITS_CHANGED = encode(bodies.StatusChange(SystemChange.UNITS))
LIGHT_CHANGED = encode(bodies.StatusChange(SystemChange.LIGHT_BUSY))


class TestSettingsInDoubt:
    @pytest.mark.parametrize(
        "event",
        [
            UNITS_CHANGED,
            UNITS_CHANGED + LIGHT_CHANGED * 2 * EVENTS_KEPT,
            *map(encode, LIVE),
            encode(bodies.ErrorResponse(64, 36)) * (EVENTS_KEPT + 1),
        ],
        ids=["change", "long ago", "position", "stream", "stream 2", "full queue"],
    )
    def test_settings_in_doubt_are_read_back_until_the_tracker_is_prepared_again(
        self, station, event
    ):
        station.tracker.measure()
        station.instrument.asked.clear()
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.pipe.arrives(0.0, event)
        for _ in range(2):
            with pytest.raises(DeviceNotReady, match="another program changed the tracker's units"):
                station.tracker.measure()
        assert START not in station.instrument.commands()
        station.tracker.prepare("CCR-1.5in", 0.5)
        station.instrument.result = OTHER_RESULT
        assert station.tracker.measure()

    def test_units_changed_just_before_a_result_spoil_it(self, station):
        station.instrument.state[Command.GET_UNITS] = INCHES
        says(station, (0.4, UNITS_CHANGED), (0.5, RESULT))
        with pytest.raises(DeviceNotReady, match="changed the tracker's units"):
            station.tracker.measure()

    def test_change_that_could_not_be_read_back_stays_known(self, station):
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.comes(bodies.StatusChange(SystemChange.UNITS))
        station.instrument.refuses[Command.GET_UNITS] = ResultStatus.USAGE_CONFLICT
        with pytest.raises(DeviceRefused, match="GetUnits"):
            station.tracker.measure()
        station.instrument.refuses.clear()
        with pytest.raises(DeviceNotReady, match="units"):
            station.tracker.measure()

    def test_change_is_noticed_among_other_questions_and_keeps_the_head_still(self, station):
        station.instrument.state[Command.GET_UNITS] = INCHES
        station.comes(bodies.StatusChange(SystemChange.UNITS))
        station.tracker.state()
        with pytest.raises(DeviceNotReady, match="units"):
            station.tracker.go_to((1.0, 2.0, 3.0))
        assert Command.GO_POSITION not in station.instrument.commands()

    def test_change_back_to_what_was_agreed_is_no_harm(self, station):
        station.comes(*map(bodies.StatusChange, (SystemChange.UNITS, SystemChange.REFLECTOR)))
        assert station.tracker.measure()

    @pytest.mark.parametrize("live", LIVE)
    def test_live_results_push_nothing_out_of_the_queue(self, station, live):
        says(station, (0.5, encode(RESULT) + encode(live) * 2 * EVENTS_KEPT))
        assert station.tracker.measure().point_in_tracker_mm == RESULT.point
