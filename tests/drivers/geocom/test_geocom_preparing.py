"""The GeoCOM driver: what the instrument is brought to before it measures."""

import pytest
from scripted_geocom import CCR, Bench

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused
from drivers.values import Readiness
from drivers.wire.geocom import GeocomReply, encode_reply, words_of
from drivers.wire.geocom_constants import Result, Rpc


def test_points_are_in_the_instruments_own_frame_and_prisms_listed():
    instrument = Bench().prepared().instrument
    assert instrument.answers[Rpc.TMC_GET_STATION] == (0, ("0.0",) * 4)
    assert instrument.answers[Rpc.TMC_GET_HEIGHT] == (0, ("0.0",))
    assert instrument.answers[Rpc.TMC_GET_GEO_PPM][1][:2] == ("0", "1.0")
    assert instrument.answers[Rpc.BAP_GET_TARGET_TYPE] == (0, ("0",))
    names = [prism.name for prism in Bench().prepared().tracker.reflectors()]
    assert names == ["Leica Circ Prism", "Leica Mini Prism", CCR]


def test_old_distance_is_cleared_before_the_station_is_set():
    bench = Bench().connected()
    bench.instrument.asked.clear()
    bench.tracker.prepare(CCR, 1.0)
    calls = bench.instrument.calls()
    assert calls.index(Rpc.TMC_DO_MEASURE) < calls.index(Rpc.TMC_SET_STATION)
    assert bench.instrument.words_of_last(Rpc.TMC_DO_MEASURE) == ("3", "1")


def test_prism_is_chosen_by_its_name_or_type_and_an_unknown_one_refused():
    bench = Bench().connected()
    bench.tracker.prepare(CCR, 1.0)
    assert bench.instrument.words_of_last(Rpc.BAP_SET_PRISM_TYPE_2) == ("9", f'"{CCR}"')
    assert bench.tracker.state().reflector == CCR
    bench = Bench().connected()
    bench.instrument.answers[Rpc.BAP_GET_PRISM_TYPE_2] = (0, words_of(1, "Leica Mini Prism"))
    bench.tracker.prepare("Leica Mini Prism", 1.0)
    assert bench.instrument.words_of_last(Rpc.BAP_SET_PRISM_TYPE) == ("1",)
    bench = Bench().connected()
    with pytest.raises(DeviceNotReady, match=r"no prism 'mini prism'.*'Leica Mini Prism'"):
        bench.tracker.prepare("mini prism", 1.0)


def test_instrument_without_motors_or_that_keeps_no_setting_is_refused():
    bench = Bench().connected()
    bench.instrument.answers[Rpc.CSV_GET_DEVICE_CONFIG] = (0, words_of(503, 0x200))
    with pytest.raises(DeviceRefused, match=r"no motors or no target recognition.*import"):
        bench.tracker.prepare(CCR, 1.0)
    bench = Bench().connected()
    bench.instrument.says[Rpc.TMC_SET_HEIGHT] = lambda request: [
        (0.0, encode_reply(GeocomReply(0, request.transaction, 0)))
    ]
    with pytest.raises(DeviceRefused, match="does not report its target height as set"):
        bench.tracker.prepare(CCR, 1.0)


def test_what_a_simpler_instrument_lacks_is_done_without():
    bench = Bench().connected()
    for rpc in (Rpc.TMC_SET_GEO_PPM, Rpc.TMC_GET_GEO_PPM, Rpc.TMC_SET_EDM_MODE):
        bench.instrument.refuses(rpc, Result.NOT_IMPLEMENTED)
    bench.tracker.prepare(CCR, 1.0)
    assert bench.tracker.measure()


def test_prism_that_is_not_in_view_yet_is_no_error():
    bench = Bench().connected()
    bench.instrument.lose_the_prism()
    bench.instrument.refuses(Rpc.AUT_FINE_ADJUST, Result.AUT_NO_TARGET)
    bench.tracker.prepare(CCR, 1.0)
    assert bench.tracker.state().readiness is Readiness.NOT_READY
    with pytest.raises(BeamBroken, match="not locked on a prism"):
        bench.tracker.measure()


@pytest.mark.parametrize("face", [0, 1])
def test_instrument_that_was_left_in_its_second_face_is_turned_back(face):
    bench = Bench().connected()
    bench.instrument.answers[Rpc.TMC_GET_FACE] = (0, words_of(face))
    bench.tracker.prepare(CCR, 1.0)
    assert (Rpc.AUT_CHANGE_FACE in bench.instrument.calls()) is (face == 1)
    if face == 1:
        bench.instrument.refuses(Rpc.AUT_CHANGE_FACE, Result.AUT_MOTOR_ERROR)
        with pytest.raises(DeviceNotReady, match="turning over failed"):
            bench.tracker.prepare(CCR, 1.0)
