"""The GeoCOM driver: turning, searching and following."""

import math

import pytest
from scripted_geocom import POINT_MM

from drivers.errors import BeamBroken, DeviceNotReady, DeviceRefused
from drivers.wire.geocom_constants import Result, Rpc


def test_point_becomes_a_clockwise_angle_from_north_and_one_from_the_zenith(bench):
    bench.tracker.go_to((-1000.0, -1000.0, math.sqrt(2.0) * 1000.0))
    hz, v, precise, to_target, unused = bench.instrument.words_of_last(Rpc.AUT_MAKE_POSITIONING)
    assert float(hz) == pytest.approx(math.radians(225.0), abs=1e-6)
    assert float(v) == pytest.approx(math.radians(45.0), abs=1e-6)
    assert (precise, to_target, unused) == ("0", "1", "0")


def test_prism_in_view_is_followed_and_else_searched_for(bench):
    bench.tracker.go_to(POINT_MM)
    assert bench.instrument.calls() == [
        Rpc.AUT_MAKE_POSITIONING,
        Rpc.AUT_FINE_ADJUST,
        Rpc.AUT_LOCK_IN,
        Rpc.MOT_READ_LOCK_STATUS,
    ]
    bench.instrument.refuses(Rpc.AUT_MAKE_POSITIONING, Result.AUT_NO_TARGET)
    bench.tracker.go_to((0.0, 1000.0, 0.0))
    width, height, _ = map(float, bench.instrument.words_of_last(Rpc.AUT_SEARCH))
    assert width == height == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize(("distance_mm", "window"), [(1e6, 0.02), (10.0, 0.5), (-1.0, 0.5)])
def test_search_window_has_its_limits(bench, distance_mm, window):
    bench.tracker.find_reflector(distance_mm)
    assert float(bench.instrument.words_of_last(Rpc.AUT_SEARCH)[0]) == window


@pytest.mark.parametrize("code", [8710, 8711, 8712, 8713, 8716])
def test_search_that_finds_nothing_is_a_broken_beam(bench, code):
    bench.instrument.refuses(Rpc.AUT_SEARCH, code)
    with pytest.raises(BeamBroken, match=f"GeoCOM {code}"):
        bench.tracker.find_reflector(2000.0)


def test_lock_that_does_not_hold_is_a_broken_beam(bench):
    bench.instrument.lose_the_prism()
    with pytest.raises(BeamBroken, match="turning: not locked"):
        bench.tracker.go_to(POINT_MM)


def test_motors_that_fail_and_its_own_place_are_no_broken_beam(bench):
    with pytest.raises(DeviceRefused, match="stands there itself"):
        bench.tracker.go_to((0.0, 0.0, 0.0))
    assert bench.instrument.asked == []
    bench.instrument.refuses(Rpc.AUT_MAKE_POSITIONING, Result.AUT_MOTOR_ERROR)
    with pytest.raises(DeviceNotReady, match="nothing blocks the telescope"):
        bench.tracker.go_to(POINT_MM)


def test_other_face_is_taken_and_the_prism_followed_there(bench):
    assert bench.tracker.use_face(1)
    assert bench.instrument.calls() == [Rpc.TMC_GET_FACE]
    assert bench.tracker.use_face(2)
    assert bench.instrument.words_of_last(Rpc.AUT_CHANGE_FACE) == ("0", "1", "0")
    assert bench.instrument.calls()[-3:] == [
        Rpc.AUT_FINE_ADJUST,
        Rpc.AUT_LOCK_IN,
        Rpc.MOT_READ_LOCK_STATUS,
    ]
    bench.instrument.refuses(Rpc.AUT_CHANGE_FACE, Result.AUT_NO_TARGET)
    with pytest.raises(BeamBroken, match="turning over failed"):
        bench.tracker.use_face(2)


@pytest.mark.parametrize("code", [Result.NOT_IMPLEMENTED, Result.COM_UNKNOWN_PROCEDURE])
def test_instrument_that_cannot_turn_over_stays_in_its_first_face(bench, code):
    bench.instrument.refuses(Rpc.AUT_CHANGE_FACE, code)
    assert not bench.tracker.use_face(2)
    bench.instrument.answers[Rpc.TMC_GET_FACE] = (0, ("1",))
    with pytest.raises(DeviceRefused, match="turning over failed"):
        bench.tracker.use_face(1)  # nothing is measured on in the wrong one
    bench.instrument.refuses(Rpc.TMC_GET_FACE, code)
    assert not bench.tracker.use_face(2)
