"""The GeoCOM driver: what counts as a point, and what a refusal to give one means."""

import contextlib

import pytest
from scripted_geocom import POINT_M, POINT_MM, Bench

from drivers import errors
from drivers.geocom.accuracy import Accuracy, accuracy_of_class, covariance_mm2
from drivers.wire.geocom import GeocomReply, encode_reply, words_of
from drivers.wire.geocom_constants import Result, Rpc


def test_east_north_and_height_are_x_y_and_z_in_mm_in_the_operators_air():
    measurement = Bench().prepared().tracker.measure()
    assert measurement.point_in_tracker_mm == (2500.0, -1250.0, 750.0)
    assert measurement.raw.startswith("%R1P,0,")
    assert "2.5,-1.25,0.75" in measurement.raw
    weather = Bench().prepared().tracker.measure().weather
    assert (weather.temperature_degC, weather.pressure_hPa) == (20.0, 1013.25)
    assert weather.humidity_percent == pytest.approx(52.0, abs=2.0)


def test_covariance_is_that_of_the_class_or_of_the_given_accuracy():
    measured = Bench().prepared().tracker.measure().covariance_mm2
    assert measured == covariance_mm2(POINT_MM, accuracy_of_class(350))
    mine = Accuracy(angle_arcsec=7.0, distance_mm=3.0, distance_ppm=5.0)
    measured = Bench(accuracy=mine).prepared().tracker.measure().covariance_mm2
    assert measured == covariance_mm2(POINT_MM, mine)
    bench = Bench()
    bench.instrument.answers[Rpc.CSV_GET_DEVICE_CONFIG] = (0, words_of(4711, 0x0C))
    measured = bench.prepared().tracker.measure().covariance_mm2
    assert measured == covariance_mm2(POINT_MM, accuracy_of_class(None))


@pytest.mark.parametrize("code", [1283, 1284])
def test_warned_coordinates_count_with_a_larger_covariance(bench, code):
    _, words = bench.instrument.answers[Rpc.TMC_GET_COORDINATE]
    bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (code, words)
    measurement = bench.tracker.measure()
    assert measurement.point_in_tracker_mm == POINT_MM
    accuracy = accuracy_of_class(350)
    assert measurement.covariance_mm2 == covariance_mm2(POINT_MM, accuracy, warned=True)


def test_point_whose_angles_are_not_the_prisms_is_a_broken_beam(bench):
    _, words = bench.instrument.answers[Rpc.TMC_GET_COORDINATE]
    bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (1283, words)
    bench.instrument.answers[Rpc.TMC_IF_DATA_AZE_CORR_ERROR] = (0, words_of(1))
    with pytest.raises(errors.BeamBroken, match="not corrected by target recognition"):
        bench.tracker.measure()


@pytest.mark.parametrize("code", [1285, 1288, 1289, 1292, 1294])
def test_angles_without_a_distance_are_a_broken_beam(bench, code):
    bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (code, words_of(*[0.0] * 3, 0) * 2)
    with pytest.raises(errors.BeamBroken, match=f"GeoCOM {code}") as caught:
        bench.tracker.measure()
    assert caught.value.code == str(code)


@pytest.mark.parametrize(
    ("code", "kind", "words"),
    [
        (1290, errors.DeviceNotReady, "level the instrument"),
        (1291, errors.DeviceNotReady, "ppm"),
        (22, errors.DeviceNotReady, "level"),
        (16, errors.DeviceNotReady, "battery"),
        (27, errors.DeviceNotReady, "licensed"),
        (8714, errors.DeviceNotReady, "prepare the tracker again"),
        (4242, errors.DeviceRefused, "GeoCOM 4242"),
    ],
)
def test_each_refusal_says_what_to_do(bench, code, kind, words):
    bench.instrument.refuses(Rpc.TMC_GET_COORDINATE, code)
    with pytest.raises(kind, match=words) as caught:
        bench.tracker.measure()
    assert type(caught.value) is kind


def test_call_that_the_instrument_does_not_know_is_refused(bench):
    bench.instrument.says[Rpc.TMC_DO_MEASURE] = lambda request: [
        (0.0, encode_reply(GeocomReply(Result.COM_UNKNOWN_PROCEDURE, request.transaction, 0)))
    ]
    with pytest.raises(errors.DeviceRefused, match=r"TMC_DO_MEASURE failed: GeoCOM 3081"):
        bench.tracker.measure()


@pytest.mark.parametrize("code", [0, 1285])
def test_nothing_of_a_measurement_is_left_for_the_next_one(bench, code):
    _result, words = bench.instrument.answers[Rpc.TMC_GET_COORDINATE]
    bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (code, words)
    with contextlib.suppress(errors.BeamBroken):
        bench.tracker.measure()
    programs = [r.parameters[0] for r in bench.instrument.asked if r.rpc == Rpc.TMC_DO_MEASURE]
    assert programs == ["1", "3"]


def delivers(bench, at_ms, code=0):
    words = words_of(*POINT_M, at_ms, *POINT_M, at_ms + 1)
    bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (code, words)


def test_distance_with_the_time_stamp_of_the_one_before_is_no_measurement(bench):
    bench.tracker.measure()
    for _ in range(2):
        with pytest.raises(errors.NotAMeasurement, match="time stamp of 1000 ms") as caught:
            bench.tracker.measure()
        assert isinstance(caught.value, errors.BeamBroken)  # the shot is taken again
    delivers(bench, 1001)
    assert bench.tracker.measure().point_in_tracker_mm == POINT_MM


def test_distance_of_the_point_before_is_no_measurement_warned_or_over_a_new_connection(bench):
    bench.tracker.measure()
    delivers(bench, 1000, code=1284)
    for _ in range(2):
        with pytest.raises(errors.NotAMeasurement):
            bench.tracker.measure()
        bench.tracker.reconnect()


def test_instrument_without_time_stamps_may_measure_the_same_twice(bench):
    delivers(bench, 0)
    assert bench.tracker.measure().point_in_tracker_mm == POINT_MM
    assert bench.tracker.measure().point_in_tracker_mm == POINT_MM


def test_failed_measurement_that_cannot_be_cleared_closes_the_wire(bench):
    bench.instrument.refuses(Rpc.TMC_GET_COORDINATE, 1285)
    codes = {"1": 0, "3": Result.SHUT_DOWN}
    bench.instrument.says[Rpc.TMC_DO_MEASURE] = lambda request: [
        (0.0, encode_reply(GeocomReply(0, request.transaction, codes[request.parameters[0]])))
    ]
    with pytest.raises(errors.BeamBroken):
        bench.tracker.measure()
    assert bench.pipe.is_closed
    with pytest.raises(errors.LinkDown):
        bench.tracker.measure()


def test_busy_instrument_is_asked_again(bench):
    codes = iter([Result.TMC_BUSY, Result.SYSTEM_BUSY, Result.OK])
    bench.instrument.says[Rpc.TMC_DO_MEASURE] = lambda request: [
        (0.0, encode_reply(GeocomReply(0, request.transaction, next(codes, 0))))
    ]
    assert bench.tracker.measure()


def test_instrument_that_stays_busy_is_given_up(bench):
    bench.instrument.refuses(Rpc.MOT_READ_LOCK_STATUS, Result.SYSTEM_BUSY)
    started_s = bench.clock.now_s()
    with pytest.raises(errors.DeviceNotReady, match="wait until the instrument has finished"):
        bench.tracker.measure()
    assert bench.clock.now_s() - started_s == pytest.approx(30.0, abs=1.0)


def test_prism_lost_while_measuring_is_a_broken_beam(bench):
    statuses = iter([1, 2])
    bench.instrument.says[Rpc.MOT_READ_LOCK_STATUS] = lambda request: [
        (0.0, encode_reply(GeocomReply(0, request.transaction, 0, words_of(next(statuses)))))
    ]
    with pytest.raises(errors.BeamBroken, match="not locked"):
        bench.tracker.measure()


@pytest.mark.parametrize(
    ("rpc", "words", "said"),
    [
        (Rpc.TMC_GET_HEIGHT, words_of(1.7), "target height"),
        (Rpc.TMC_GET_STATION, words_of(1.0, 0.0, 0.0, 0.0), "station"),
        (Rpc.TMC_GET_PRISM_CORR, words_of(0.0175), "prism constant"),
    ],
)
def test_key_pressed_at_the_instrument_makes_the_point_no_data(bench, rpc, words, said):
    bench.instrument.answers[rpc] = (0, words)
    with pytest.raises(errors.DeviceNotReady, match=f"changed the instrument's {said}"):
        bench.tracker.measure()


@pytest.mark.parametrize("word", ["nan", "inf", "1e999"])
def test_result_without_numbers_is_refused(bench, word):
    words = (word, *words_of(0.0, 0.0, 0)) * 2
    bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (0, words)
    with pytest.raises(errors.ImplausibleAnswer, match="possible is 0 to 200000 mm"):
        bench.tracker.measure()


@pytest.mark.parametrize("words", [(), ("1.0",), ("x",) * 8])
def test_result_of_another_form_closes_the_wire(bench, words):
    bench.instrument.answers[Rpc.TMC_GET_COORDINATE] = (0, words)
    with pytest.raises(errors.WireError, match="TMC_GET_COORDINATE answers"):
        bench.tracker.measure()
    assert bench.pipe.is_closed


@pytest.mark.parametrize("said", [b"garbage\r\n", b"%R1P,0,\r\n", b"\xff" * 2000])
def test_garbage_closes_the_wire_and_every_later_call_says_so(bench, said):
    bench.instrument.says[Rpc.TMC_GET_COORDINATE] = [(0.1, said)]
    with pytest.raises(errors.WireError, match="not a line of GeoCOM"):
        bench.tracker.measure()
    assert bench.pipe.is_closed
    with pytest.raises((errors.LinkDown, errors.WireError)):
        bench.tracker.measure()
