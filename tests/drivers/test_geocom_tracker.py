"""The GeoCOM driver: sessions, preparing, aiming, measuring, and what refusals mean."""

import contextlib
import math

import pytest
from scripted_geocom import CCR, POINT_M, Bench, Instrument

from drivers.errors import (
    BeamBroken,
    Cancelled,
    DeviceNotReady,
    DeviceRefused,
    LinkDown,
    WireError,
    WrongDevice,
)
from drivers.geocom_accuracy import Accuracy, accuracy_of_class, covariance_mm2
from drivers.values import Readiness
from drivers.wire.geocom import Reply, encode_reply
from drivers.wire.geocom_constants import Result, Rpc
from drivers.wire.geocom_words import words_of

POINT_MM = tuple(1000.0 * value for value in POINT_M)


@pytest.fixture(autouse=True)
def no_pause_at_start(monkeypatch):
    """geocompy sleeps for a second whenever it is connected."""
    monkeypatch.setattr("geocompy.geo.sleep", lambda seconds: None)


class TestSession:
    def test_identity_is_name_serial_and_firmware(self):
        identity = Bench().connected().tracker.identity()
        assert str(identity) == "Leica TDRA6000 serial 361234 (GeoCOM, firmware 4.1.2)"

    def test_every_call_before_connecting_says_so(self):
        tracker = Bench().tracker
        for call in (tracker.identity, tracker.state, tracker.weather, tracker.measure):
            with pytest.raises(LinkDown, match="not connected"):
                call()

    def test_silent_instrument_is_given_up_at_the_deadline(self):
        bench = Bench()
        bench.instrument.says[Rpc.COM_NULL_PROC] = []
        with pytest.raises(LinkDown, match="no answer to COM_NULL_PROC within 15 s"):
            bench.tracker.connect()
        assert bench.clock.now_s() == pytest.approx(15.0)
        assert bench.pipe.is_closed

    def test_instrument_that_closes_at_once_is_given_up_at_once(self):
        bench = Bench()
        bench.instrument.says[Rpc.COM_NULL_PROC] = [(0.1, b"")]
        with pytest.raises(LinkDown, match="closed the connection"):
            bench.tracker.connect()
        assert bench.clock.now_s() < 1.0

    def test_instrument_that_sleeps_is_to_be_woken(self):
        bench = Bench()
        bench.instrument.says[Rpc.COM_NULL_PROC] = lambda request: [
            (0.0, encode_reply(Reply(Result.COM_SLEEPING, request.transaction, 0)))
        ]
        with pytest.raises(DeviceNotReady, match="switch the instrument on"):
            bench.tracker.connect()
        assert bench.pipe.is_closed

    def test_link_lost_in_the_start_up_is_a_lost_link(self):
        bench = Bench()
        bench.instrument.says[Rpc.CSV_GET_INSTRUMENT_NAME] = [(0.1, b"")]
        with pytest.raises(LinkDown, match="closed the connection"):
            bench.tracker.connect()

    def test_digits_are_asked_for_that_do_not_lose_a_micrometre(self):
        bench = Bench()
        bench.instrument.answers[Rpc.COM_GET_DOUBLE_PRECISION] = (0, words_of(3))
        bench.connected()
        assert bench.instrument.words_of_last(Rpc.COM_SET_DOUBLE_PRECISION) == ("10",)

    def test_stop_by_the_operator_ends_the_wait(self):
        stop = []
        bench = Bench(cancelled=lambda: bool(stop)).prepared()
        bench.instrument.says[Rpc.TMC_GET_COORDINATE] = lambda _: stop.append(True) or []
        with pytest.raises(Cancelled):
            bench.tracker.measure()
        assert bench.clock.now_s() < 5.0


class TestReconnect:
    def test_state_is_established_anew(self):
        bench = Bench().prepared()
        bench.instrument.answers |= Instrument().answers
        bench.tracker.reconnect()
        assert bench.pipes[0].is_closed
        assert bench.instrument.answers[Rpc.TMC_GET_HEIGHT] == (0, ("0.0",))
        assert bench.tracker.measure().point_in_tracker_mm == POINT_MM

    def test_another_instrument_at_the_same_address_is_refused(self):
        bench = Bench().prepared()
        bench.instrument.answers[Rpc.CSV_GET_INSTRUMENT_NO] = (0, words_of(361235))
        with pytest.raises(WrongDevice, match=r"361235.*it was.*361234"):
            bench.tracker.reconnect()
        assert bench.pipe.is_closed

    def test_numbers_of_questions_go_on_over_connections(self):
        bench = Bench().prepared()
        bench.tracker.measure()
        last = bench.instrument.asked[-1].transaction
        bench.instrument.asked.clear()
        bench.tracker.reconnect()
        numbers = [request.transaction for request in bench.instrument.asked]
        assert last >= 1000
        assert all(number > last for number in numbers if number >= 1000)

    def test_late_answer_to_the_old_connection_is_never_read(self):
        bench = Bench().prepared()
        bench.instrument.says[Rpc.TMC_GET_COORDINATE] = []
        with pytest.raises(LinkDown, match="no answer to TMC_GET_COORDINATE within 15 s"):
            bench.tracker.measure()
        late = bench.instrument.reply(bench.instrument.asked[-1]).replace(b"2.5", b"9.9")
        del bench.instrument.says[Rpc.TMC_GET_COORDINATE]
        bench.tracker.reconnect()
        bench.pipe.arrives(0.0, late)
        assert bench.tracker.measure().point_in_tracker_mm == POINT_MM


class TestPreparing:
    def test_points_are_in_the_instruments_own_frame_then(self):
        instrument = Bench().prepared().instrument
        assert instrument.answers[Rpc.TMC_GET_STATION] == (0, ("0.0",) * 4)
        assert instrument.answers[Rpc.TMC_GET_HEIGHT] == (0, ("0.0",))
        assert instrument.answers[Rpc.TMC_GET_GEO_PPM][1][:2] == ("0", "1.0")
        assert instrument.answers[Rpc.BAP_GET_TARGET_TYPE] == (0, ("0",))

    def test_old_distance_is_cleared_before_the_station_is_set(self):
        bench = Bench().connected()
        bench.instrument.asked.clear()
        bench.tracker.prepare(CCR, 1.0)
        calls = bench.instrument.calls()
        assert calls.index(Rpc.TMC_DO_MEASURE) < calls.index(Rpc.TMC_SET_STATION)
        assert bench.instrument.words_of_last(Rpc.TMC_DO_MEASURE) == ("3", "1")

    def test_prism_of_the_operator_is_chosen_by_its_name(self):
        bench = Bench().connected()
        bench.tracker.prepare(CCR, 1.0)
        assert bench.instrument.words_of_last(Rpc.BAP_SET_PRISM_TYPE_2) == ("9", f'"{CCR}"')
        assert bench.tracker.state().reflector == CCR

    def test_standard_prism_is_chosen_by_its_type(self):
        bench = Bench().connected()
        bench.instrument.answers[Rpc.BAP_GET_PRISM_TYPE_2] = (0, words_of(1, "Leica Mini Prism"))
        bench.tracker.prepare("Leica Mini Prism", 1.0)
        assert bench.instrument.words_of_last(Rpc.BAP_SET_PRISM_TYPE) == ("1",)

    def test_unknown_prism_is_refused_with_the_nearest_name(self):
        bench = Bench().connected()
        with pytest.raises(DeviceNotReady, match=r"no prism 'mini prism'.*'Leica Mini Prism'"):
            bench.tracker.prepare("mini prism", 1.0)

    def test_prisms_are_listed_with_the_operators_own_that_is_in_use(self):
        names = [prism.name for prism in Bench().prepared().tracker.reflectors()]
        assert names == ["Leica Circ Prism", "Leica Mini Prism", CCR]

    def test_instrument_without_motors_is_refused(self):
        bench = Bench().connected()
        bench.instrument.answers[Rpc.CSV_GET_DEVICE_CONFIG] = (0, words_of(503, 0x200))
        with pytest.raises(DeviceRefused, match=r"no motors or no target recognition.*import"):
            bench.tracker.prepare(CCR, 1.0)

    def test_setting_that_is_not_kept_is_refused(self):
        bench = Bench().connected()
        bench.instrument.says[Rpc.TMC_SET_HEIGHT] = lambda request: [
            (0.0, encode_reply(Reply(0, request.transaction, 0)))
        ]
        with pytest.raises(DeviceRefused, match="does not report its target height as set"):
            bench.tracker.prepare(CCR, 1.0)

    def test_what_a_simpler_instrument_lacks_is_done_without(self):
        bench = Bench().connected()
        for rpc in (Rpc.TMC_SET_GEO_PPM, Rpc.TMC_GET_GEO_PPM, Rpc.TMC_SET_EDM_MODE):
            bench.instrument.refuses(rpc, Result.NOT_IMPLEMENTED)
        bench.tracker.prepare(CCR, 1.0)
        assert bench.tracker.measure()

    def test_prism_that_is_not_in_view_yet_is_no_error(self):
        bench = Bench().connected()
        bench.instrument.lose_the_prism()
        bench.instrument.refuses(Rpc.AUT_FINE_ADJUST, Result.AUT_NO_TARGET)
        bench.tracker.prepare(CCR, 1.0)
        assert bench.tracker.state().readiness is Readiness.NOT_READY
        with pytest.raises(BeamBroken, match="not locked on a prism"):
            bench.tracker.measure()

    def test_nothing_is_measured_before_it_is_prepared(self):
        bench = Bench().connected()
        for call in (bench.tracker.measure, lambda: bench.tracker.go_to(POINT_MM)):
            with pytest.raises(DeviceNotReady, match="not prepared"):
                call()


class TestMeasuring:
    def test_east_north_and_height_are_x_y_and_z_in_mm(self):
        measurement = Bench().prepared().tracker.measure()
        assert measurement.point_in_tracker_mm == (2500.0, -1250.0, 750.0)
        assert measurement.raw.startswith("%R1P,0,")
        assert "2.5,-1.25,0.75" in measurement.raw

    def test_air_is_what_the_operator_has_set(self):
        weather = Bench().prepared().tracker.measure().weather
        assert (weather.temperature_degC, weather.pressure_hPa) == (20.0, 1013.25)
        assert weather.humidity_percent == pytest.approx(52.0, abs=2.0)

    def test_covariance_is_that_of_the_instruments_class(self):
        measured = Bench().prepared().tracker.measure().covariance_mm2
        assert measured == covariance_mm2(POINT_MM, accuracy_of_class(350))

    def test_covariance_is_that_of_the_given_accuracy(self):
        mine = Accuracy(angle_arcsec=7.0, distance_mm=3.0, distance_ppm=5.0)
        measured = Bench(accuracy=mine).prepared().tracker.measure().covariance_mm2
        assert measured == covariance_mm2(POINT_MM, mine)

    def test_class_that_nobody_knows_counts_as_the_coarsest(self):
        bench = Bench()
        bench.instrument.answers[Rpc.CSV_GET_DEVICE_CONFIG] = (0, words_of(4711, 0x0C))
        measured = bench.prepared().tracker.measure().covariance_mm2
        assert measured == covariance_mm2(POINT_MM, accuracy_of_class(None))

    @pytest.mark.parametrize("code", [1283, 1284])
    def test_warned_coordinates_count_with_a_larger_covariance(self, code):
        bench = Bench().prepared()
        _, words = bench.instrument.answers[Rpc.TMC_GET_COORDINATE]
        bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (code, words)
        measurement = bench.tracker.measure()
        assert measurement.point_in_tracker_mm == POINT_MM
        accuracy = accuracy_of_class(350)
        assert measurement.covariance_mm2 == covariance_mm2(POINT_MM, accuracy, warned=True)

    def test_point_whose_angles_are_not_the_prisms_is_a_broken_beam(self):
        bench = Bench().prepared()
        _, words = bench.instrument.answers[Rpc.TMC_GET_COORDINATE]
        bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (1283, words)
        bench.instrument.answers[Rpc.TMC_IF_DATA_AZE_CORR_ERROR] = (0, words_of(1))
        with pytest.raises(BeamBroken, match="not corrected by target recognition"):
            bench.tracker.measure()

    @pytest.mark.parametrize("code", [1285, 1288, 1289, 1292, 1294])
    def test_angles_without_a_distance_are_a_broken_beam(self, code):
        bench = Bench().prepared()
        bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (code, words_of(*[0.0] * 3, 0) * 2)
        with pytest.raises(BeamBroken, match=f"GeoCOM {code}") as caught:
            bench.tracker.measure()
        assert caught.value.code == str(code)

    @pytest.mark.parametrize(
        ("code", "kind", "words"),
        [
            (1290, DeviceNotReady, "level the instrument"),
            (1291, DeviceNotReady, "ppm"),
            (22, DeviceNotReady, "level"),
            (16, DeviceNotReady, "battery"),
            (27, DeviceNotReady, "licensed"),
            (8714, DeviceNotReady, "prepare the tracker again"),
            (4242, DeviceRefused, "GeoCOM 4242"),
        ],
    )
    def test_each_refusal_says_what_to_do(self, code, kind, words):
        bench = Bench().prepared()
        bench.instrument.refuses(Rpc.TMC_GET_COORDINATE, code)
        with pytest.raises(kind, match=words) as caught:
            bench.tracker.measure()
        assert type(caught.value) is kind

    def test_call_that_the_instrument_does_not_know_is_refused(self):
        bench = Bench().prepared()
        bench.instrument.says[Rpc.TMC_DO_MEASURE] = lambda request: [
            (0.0, encode_reply(Reply(Result.COM_UNKNOWN_PROCEDURE, request.transaction, 0)))
        ]
        with pytest.raises(DeviceRefused, match=r"TMC_DoMeasure failed: GeoCOM 3081"):
            bench.tracker.measure()

    @pytest.mark.parametrize("code", [0, 1285])
    def test_nothing_of_a_measurement_is_left_for_the_next_one(self, code):
        bench = Bench().prepared()
        _result, words = bench.instrument.answers[Rpc.TMC_GET_COORDINATE]
        bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (code, words)
        with contextlib.suppress(BeamBroken):
            bench.tracker.measure()
        programs = [r.parameters[0] for r in bench.instrument.asked if r.rpc == Rpc.TMC_DO_MEASURE]
        assert programs == ["1", "3"]

    def test_busy_instrument_is_asked_again(self):
        bench = Bench().prepared()
        codes = iter([Result.TMC_BUSY, Result.SYSTEM_BUSY, Result.OK])
        bench.instrument.says[Rpc.TMC_DO_MEASURE] = lambda request: [
            (0.0, encode_reply(Reply(0, request.transaction, next(codes, 0))))
        ]
        assert bench.tracker.measure()

    def test_instrument_that_stays_busy_is_given_up(self):
        bench = Bench().prepared()
        bench.instrument.refuses(Rpc.MOT_READ_LOCK_STATUS, Result.SYSTEM_BUSY)
        started_s = bench.clock.now_s()
        with pytest.raises(DeviceNotReady, match="wait until the instrument has finished"):
            bench.tracker.measure()
        assert bench.clock.now_s() - started_s == pytest.approx(30.0, abs=1.0)

    def test_prism_lost_while_measuring_is_a_broken_beam(self):
        bench = Bench().prepared()
        statuses = iter([1, 2])
        bench.instrument.says[Rpc.MOT_READ_LOCK_STATUS] = lambda request: [
            (0.0, encode_reply(Reply(0, request.transaction, 0, words_of(next(statuses)))))
        ]
        with pytest.raises(BeamBroken, match="not locked"):
            bench.tracker.measure()

    @pytest.mark.parametrize(
        ("rpc", "words", "said"),
        [
            (Rpc.TMC_GET_HEIGHT, words_of(1.7), "target height"),
            (Rpc.TMC_GET_STATION, words_of(1.0, 0.0, 0.0, 0.0), "station"),
            (Rpc.TMC_GET_PRISM_CORR, words_of(0.0175), "prism constant"),
        ],
    )
    def test_key_pressed_at_the_instrument_makes_the_point_no_data(self, rpc, words, said):
        bench = Bench().prepared()
        bench.instrument.answers[rpc] = (0, words)
        with pytest.raises(DeviceNotReady, match=f"changed the instrument's {said}"):
            bench.tracker.measure()

    @pytest.mark.parametrize("word", ["nan", "inf", "1e999"])
    def test_result_without_numbers_is_refused(self, word):
        bench = Bench().prepared()
        words = (word, *words_of(0.0, 0.0, 0)) * 2
        bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (0, words)
        with pytest.raises(DeviceRefused, match="without numbers"):
            bench.tracker.measure()

    @pytest.mark.parametrize("words", [(), ("1.0",), ("x",) * 8])
    def test_result_of_another_form_closes_the_wire(self, words):
        bench = Bench().prepared()
        bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (0, words)
        with pytest.raises(WireError, match="TMC_GetCoordinate answers"):
            bench.tracker.measure()
        assert bench.pipe.is_closed

    @pytest.mark.parametrize("said", [b"garbage\r\n", b"%R1P,0,\r\n", b"\xff" * 2000])
    def test_garbage_closes_the_wire_and_every_later_call_says_so(self, said):
        bench = Bench().prepared()
        bench.instrument.says[Rpc.TMC_GET_COORDINATE] = [(0.1, said)]
        with pytest.raises(WireError, match="not a line of GeoCOM"):
            bench.tracker.measure()
        assert bench.pipe.is_closed
        with pytest.raises((LinkDown, WireError)):
            bench.tracker.measure()


class TestAiming:
    def test_point_becomes_a_clockwise_angle_from_north_and_one_from_the_zenith(self):
        bench = Bench().prepared()
        bench.tracker.go_to((-1000.0, -1000.0, math.sqrt(2.0) * 1000.0))
        hz, v, precise, to_target, unused = bench.instrument.words_of_last(Rpc.AUT_MAKE_POSITIONING)
        assert float(hz) == pytest.approx(math.radians(225.0), abs=1e-6)
        assert float(v) == pytest.approx(math.radians(45.0), abs=1e-6)
        assert (precise, to_target, unused) == ("0", "1", "0")

    def test_prism_in_the_field_of_view_is_followed_without_a_search(self):
        bench = Bench().prepared()
        bench.tracker.go_to(POINT_MM)
        assert bench.instrument.calls() == [
            Rpc.AUT_MAKE_POSITIONING,
            Rpc.AUT_FINE_ADJUST,
            Rpc.AUT_LOCK_IN,
            Rpc.MOT_READ_LOCK_STATUS,
        ]

    def test_prism_outside_the_field_of_view_is_searched_for(self):
        bench = Bench().prepared()
        bench.instrument.refuses(Rpc.AUT_MAKE_POSITIONING, Result.AUT_NO_TARGET)
        bench.tracker.go_to((0.0, 1000.0, 0.0))
        width, height, _ = map(float, bench.instrument.words_of_last(Rpc.AUT_SEARCH))
        assert width == height == pytest.approx(0.1, rel=0.01)

    @pytest.mark.parametrize(("distance_mm", "window"), [(1e6, 0.02), (10.0, 0.5), (-1.0, 0.5)])
    def test_search_window_has_its_limits(self, distance_mm, window):
        bench = Bench().prepared()
        bench.tracker.find_reflector(distance_mm)
        assert float(bench.instrument.words_of_last(Rpc.AUT_SEARCH)[0]) == window

    @pytest.mark.parametrize("code", [8710, 8711, 8712, 8713, 8716])
    def test_search_that_finds_nothing_is_a_broken_beam(self, code):
        bench = Bench().prepared()
        bench.instrument.refuses(Rpc.AUT_SEARCH, code)
        with pytest.raises(BeamBroken, match=f"GeoCOM {code}"):
            bench.tracker.find_reflector(2000.0)

    def test_lock_that_does_not_hold_is_a_broken_beam(self):
        bench = Bench().prepared()
        bench.instrument.lose_the_prism()
        with pytest.raises(BeamBroken, match="turning: not locked"):
            bench.tracker.go_to(POINT_MM)

    def test_motors_that_fail_are_no_broken_beam(self):
        bench = Bench().prepared()
        bench.instrument.refuses(Rpc.AUT_MAKE_POSITIONING, Result.AUT_MOTOR_ERROR)
        with pytest.raises(DeviceNotReady, match="nothing blocks the telescope"):
            bench.tracker.go_to(POINT_MM)

    def test_instruments_own_place_is_no_direction(self):
        bench = Bench().prepared()
        with pytest.raises(DeviceRefused, match="stands there itself"):
            bench.tracker.go_to((0.0, 0.0, 0.0))
        assert bench.instrument.asked == []
