"""The emScon driver: sessions, preparing, what it says about the tracker's state."""

import pytest
from scripted_emscon import NAMES, RESULT, Instrument, Station

from drivers.errors import DeviceRefused, LinkDown, WireError
from drivers.values import Readiness
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon import Answer, encode, refusal
from drivers.wire.emscon_constants import Command, ResultStatus

HELD_BY_ANOTHER = ResultStatus.MULTI_CONNECTIONS_NOT_ALLOWED


class TestSession:
    def test_connecting_sets_our_units_before_anything_is_read(self):
        station = Station().connected()
        first = station.instrument.asked[0]
        assert (first.command, first.body) == (Command.SET_UNITS, bodies.Units(1, 1, 0, 0, 0))

    def test_identity_is_model_serial_and_firmware_or_what_there_is_of_them(self):
        identity = Station().connected().tracker.identity()
        assert str(identity) == "Leica AT401 serial 390793 (emScon, firmware 3.8.500)"
        instrument = Instrument()
        instrument.refuses[Command.GET_TRACKER_INFO] = ResultStatus.NOT_IMPLEMENTED
        assert Station(instrument).connected().tracker.identity().model == "laser tracker"

    @pytest.mark.parametrize(
        "answer",
        [
            refusal(Command.SET_UNITS, HELD_BY_ANOTHER),
            encode(bodies.ErrorResponse(64, HELD_BY_ANOTHER)),
        ],
        ids=["refusal", "error packet"],
    )
    def test_another_program_on_the_tracker_is_named_as_the_reason(self, answer):
        instrument = Instrument()
        instrument.says[Command.SET_UNITS] = [(0.1, answer)]
        with pytest.raises(DeviceRefused, match=r"10011.*→ end the other program") as caught:
            Station(instrument).connected()
        assert caught.value.code == "10011"

    def test_another_program_that_takes_the_tracker_later_closes_the_wire(self):
        station = Station().connected()
        station.comes(bodies.ErrorResponse(64, HELD_BY_ANOTHER))
        with pytest.raises(DeviceRefused, match="end the other program"):
            station.tracker.reflectors()
        assert station.pipe.is_closed

    def test_closing_never_ends_the_trackers_server(self, station):
        sent_before = len(station.pipe.sent)
        station.tracker.close()
        assert station.pipe.is_closed
        assert len(station.pipe.sent) == sent_before


class TestReconnect:
    def test_state_is_established_anew(self, station):
        before = dict(station.instrument.state)
        station.instrument.state |= Instrument().state
        station.tracker.reconnect()
        assert station.instrument.state == before
        assert len(station.pipes) == 2
        assert station.pipes[0].is_closed
        assert station.tracker.measure().point_in_tracker_mm == RESULT.point

    def test_old_connection_that_is_still_held_is_waited_for(self, station):
        instrument = station.instrument
        held = [(0.0, refusal(Command.SET_UNITS, HELD_BY_ANOTHER))]
        free_s = station.clock.now_s() + 2.0
        instrument.says[Command.SET_UNITS] = lambda _: (
            held if station.clock.now_s() < free_s else None
        )
        station.tracker.reconnect()
        assert station.tracker.measure()

    def test_connection_that_stays_held_is_given_up(self, station):
        station.instrument.refuses[Command.SET_UNITS] = 10011
        with pytest.raises(DeviceRefused, match="end the other program"):
            station.tracker.reconnect()
        assert station.clock.now_s() == pytest.approx(5.0, abs=1.0)

    def test_preparation_that_broke_off_is_done_again(self):
        station = Station().connected()
        station.instrument.says[Command.GET_REFLECTORS] = []
        with pytest.raises(LinkDown):
            station.tracker.prepare("CCR-1.5in", 0.5)
        del station.instrument.says[Command.GET_REFLECTORS]
        station.tracker.reconnect()
        assert station.tracker.measure()


class TestReflectors:
    def test_every_packet_of_the_list_is_read(self):
        reflectors = Station().connected().tracker.reflectors()
        assert {r.identifier: r.name for r in reflectors} == NAMES
        assert reflectors[0].surface_offset_mm == 19.05

    @pytest.mark.parametrize(
        ("total", "error", "said"),
        [
            (3, LinkDown, "the list of reflectors"),
            (2**31 - 1, WireError, "claims 2147483647 reflectors"),
        ],
    )
    def test_list_that_breaks_off_or_claims_too_much_closes_the_wire(self, total, error, said):
        station = Station().connected()
        entry = bodies.ReflectorEntry(total, 1, 1, 19.05, "CCR-1.5in")
        station.instrument.says[Command.GET_REFLECTORS] = [
            (0.0, Answer(Command.GET_REFLECTORS, 0, entry))
        ]
        with pytest.raises(error, match=said):
            station.tracker.reflectors()
        assert station.pipe.is_closed


class TestState:
    @pytest.mark.parametrize(("light", "bits"), [(0, 2048), (2, 0)])
    def test_lock_needs_both_the_light_and_the_reflector(self, station, light, bits):
        station.instrument.state[Command.GET_TRACKER_STATUS] = bodies.Code(light)
        info = bodies.MeasurementStatusInfo(0, bits)
        station.instrument.state[Command.GET_MEASUREMENT_STATUS_INFO] = info
        assert not station.tracker.state().beam_locked

    def test_instrument_without_status_bits_is_judged_by_its_light(self, station):
        station.instrument.refuses[Command.GET_MEASUREMENT_STATUS_INFO] = 2
        assert station.tracker.state().beam_locked

    @pytest.mark.parametrize(
        ("light", "readiness"), [(1, Readiness.BUSY), (3, Readiness.NOT_READY), (99, None)]
    )
    def test_lights(self, station, light, readiness):
        station.instrument.state[Command.GET_TRACKER_STATUS] = bodies.Code(light)
        assert station.tracker.state().readiness is (readiness or Readiness.NOT_READY)
