"""The emScon driver brings a tracker to what a campaign needs, and notices who changes it."""

import pytest
from scripted_emscon import NAMES, Instrument, Station, system_status

from drivers.emscon.client import EmsconDeadlines
from drivers.errors import DeviceNotReady, DeviceRefused, LinkDown
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon import Answer, refusal
from drivers.wire.emscon_constants import Command, ResultStatus, SystemChange

START = Command.START_MEASUREMENT
STANDARD_RESULT = bodies.SingleResult(
    0, 0, 0, (1.0, 2.0, 3.0), (0.01,) * 3, 0.017, (0.0,) * 3, (0.02,) * 3, 0.03, 20.0, 1000.0, 50.0
)


def booted(laser=3):
    """An instrument that is not initialised yet."""
    instrument = Instrument()
    instrument.state[Command.GET_SYSTEM_STATUS] = system_status(processor=3, laser=laser)
    return instrument


class TestPrepare:
    def test_settings_are_those_of_the_campaign(self):
        station = Station(deadlines=EmsconDeadlines(search_timeout_s=4.0)).connected()
        station.tracker.prepare("RRR 1.5in", 2.5)
        instrument = station.instrument
        assert instrument.body_of(Command.SET_REFLECTOR) == bodies.Code(40)
        assert instrument.body_of(Command.SET_STATIONARY_MODE_PARAMS) == bodies.StationaryMode(
            2500, 1
        )
        assert instrument.body_of(Command.SET_SEARCH_PARAMS) == bodies.SearchParams(50.0, 4000)
        assert instrument.body_of(Command.SET_STATISTIC_MODE).stationary == 1
        assert instrument.body_of(Command.SET_COORDINATE_SYSTEM_TYPE).value == 0
        assert instrument.body_of(Command.SET_MEASUREMENT_MODE).value == 0
        assert Command.INITIALIZE not in instrument.commands(), "it is, and is not moved"
        in_own_frame = bodies.SystemSettings(1, 0, 0, 1, 1, 0, 0, 1, 1)
        assert instrument.state[Command.GET_SYSTEM_SETTINGS] == in_own_frame

    @pytest.mark.parametrize(("takes_s", "succeeds"), [(119.0, True), (121.0, False)])
    def test_instrument_is_initialised_in_two_minutes_or_never(self, takes_s, succeeds):
        station = Station(booted())
        initialised = [(takes_s, Answer(Command.INITIALIZE))]
        station.instrument.says[Command.INITIALIZE] = initialised
        if succeeds:
            station.prepared()
            return
        with pytest.raises(LinkDown, match="no answer to Initialize within 120 s"):
            station.prepared()
        assert station.pipe.is_closed

    @pytest.mark.parametrize(
        ("laser", "said"),
        [(0, "check the cable"), (2, "heating up → wait"), (4, "restart"), (5, "off → switch")],
    )
    def test_laser_that_cannot_be_used_is_named_and_nothing_moves(self, laser, said):
        station = Station(booted(laser))
        with pytest.raises(DeviceNotReady, match=said):
            station.prepared()
        assert Command.INITIALIZE not in station.instrument.commands()

    @pytest.mark.parametrize("laser", [1, 3])
    def test_instrument_without_an_interferometer_is_as_good_as_warm(self, laser):
        instrument = Instrument()
        instrument.state[Command.GET_SYSTEM_STATUS] = system_status(laser=laser)
        assert Station(instrument).prepared().tracker.state().laser_warm

    def test_missing_reflector_is_refused_with_the_names_there_are(self):
        station = Station().connected()
        with pytest.raises(DeviceNotReady) as caught:
            station.tracker.prepare("ccr 1.5in", 2.0)
        assert "no reflector 'ccr 1.5in' → perhaps 'CCR-1.5in'; it knows" in str(caught.value)
        assert all(f"'{name}'" in caught.value.remedy for name in NAMES.values())
        assert Command.SET_REFLECTOR not in station.instrument.commands()
        instrument = Instrument()
        none = Answer(Command.GET_REFLECTORS, 0, bodies.ReflectorEntry(0, 0, 0, 0.0, ""))
        instrument.says[Command.GET_REFLECTORS] = [(0.0, none)]
        with pytest.raises(DeviceNotReady, match="define the reflector"):
            Station(instrument).prepared()

    def test_events_of_our_own_settings_may_come_before_or_after_the_answers(self):
        instrument = Instrument()
        event = bodies.StatusChange(SystemChange.UNITS)
        for say in (
            [(0.0, event), (0.1, Answer(Command.SET_UNITS))],
            [(0.0, Answer(Command.SET_UNITS)), (0.0, event)],
        ):
            instrument.says[Command.SET_UNITS] = say
            instrument.state[Command.GET_UNITS] = bodies.Units(1, 1, 0, 0, 0)
            assert Station(instrument).prepared().tracker.measure()

    @pytest.mark.parametrize(
        ("setting", "kept", "said"),
        [
            (Command.SET_UNITS, {}, "does not report its units as set"),
            (
                Command.SET_STATIONARY_MODE_PARAMS,
                {Command.GET_STATIONARY_MODE_PARAMS: bodies.StationaryMode(100, 1)},
                "is 100 ms after 500 ms was set",
            ),
        ],
    )
    def test_setting_that_is_accepted_but_not_kept_is_refused(self, setting, kept, said):
        instrument = Instrument()
        instrument.state |= kept
        instrument.says[setting] = [(0.0, Answer(setting))]
        station = Station(instrument)
        with pytest.raises(DeviceRefused, match=said):
            station.prepared()
        with pytest.raises(DeviceNotReady, match="not prepared"):
            station.tracker.measure()

    def test_setting_that_is_refused_is_named(self):
        instrument = Instrument()
        instrument.refuses[Command.SET_STATIONARY_MODE_PARAMS] = 12
        with pytest.raises(DeviceRefused, match=r"SetStationaryModeParams was refused: emScon"):
            Station(instrument).prepared()

    def test_busy_tracker_is_asked_again_until_it_has_finished_or_time_is_over(self):
        station = Station().connected()
        busy = [(0.0, refusal(Command.SET_UNITS, ResultStatus.SERVER_BUSY))]
        station.instrument.says[Command.SET_UNITS] = lambda _: (
            busy if station.clock.now_s() < 10.0 else None
        )
        station.tracker.prepare("CCR-1.5in", 2.0)
        assert station.clock.now_s() == pytest.approx(10.0, abs=0.2)
        station.instrument.says[Command.SET_UNITS] = busy
        with pytest.raises(DeviceNotReady, match="server busy"):
            station.tracker.reconnect()
        assert station.clock.now_s() == pytest.approx(40.0, abs=0.5)

    def test_instrument_without_covariances_is_prepared_all_the_same(self):
        instrument = Instrument()
        instrument.refuses[Command.SET_STATISTIC_MODE] = ResultStatus.NOT_IMPLEMENTED
        instrument.result = STANDARD_RESULT
        assert Station(instrument).prepared().tracker.measure().covariance_mm2[0][0] == 4e-4
