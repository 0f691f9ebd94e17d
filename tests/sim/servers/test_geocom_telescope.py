"""The simulated total station's telescope: turning, searching, following."""

import math

import pytest
from geocom_client_stub import WINDOW, Client

from drivers.wire.geocom import words_of
from drivers.wire.geocom_constants import Result, Rpc


def test_it_follows_only_when_told_to():
    client = Client().robotic()
    assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [0]
    assert client.follow().values(Rpc.MOT_READ_LOCK_STATUS) == [1]


def test_it_follows_while_the_robot_moves():
    client = Client().robotic().follow()
    before_mm = client.place_mm()
    client.cell.controller.move_joints([0.3, 0.4, 0.5, 0.4], 0.5, client.now_s)
    client.later(10.0)
    assert math.dist(client.place_mm(), before_mm) > 10.0
    assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [1]
    assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx(client.polar()[:2])


def test_it_turns_onto_the_prism_near_a_direction():
    client = Client(beam_locked=False).robotic()
    hz, v, _ = client.polar()
    words = words_of(hz + 0.005, v - 0.005, 0, 1, 0)
    assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words).result == Result.OK
    assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz, v])


def test_it_does_not_see_a_prism_beside_its_field():
    client = Client(beam_locked=False).robotic()
    hz, v, _ = client.polar()
    words = words_of(hz + 0.05, v, 0, 1, 0)
    assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words).result == Result.AUT_NO_TARGET
    assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz + 0.05, v])
    assert client.ask(Rpc.AUT_SEARCH, *words_of(0.2, 0.2, 0)).result == Result.OK
    assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([hz, v])


def test_it_turns_to_angles_without_looking_for_a_prism():
    client = Client().robotic().follow()
    assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words_of(1.0, 1.5, 0, 0, 0)).result == 0
    assert client.values(Rpc.TMC_GET_ANGLE_5, "1") == pytest.approx([1.0, 1.5])
    assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [0]


@pytest.mark.parametrize(
    ("rpc", "words"),
    [
        (Rpc.AUT_SEARCH, WINDOW),
        (Rpc.AUT_FINE_ADJUST, WINDOW),
        (Rpc.AUT_LOCK_IN, ()),
        (Rpc.AUT_MAKE_POSITIONING, words_of(1.0, 1.5, 0, 1, 0)),
    ],
)
def test_what_is_not_switched_on_is_refused(rpc, words):
    assert Client().ask(rpc, *words).result == Result.AUT_NOT_ENABLED


def test_question_behind_a_motion_waits_for_its_end():
    client = Client(beam_locked=False).robotic()
    assert client.begin(Rpc.AUT_SEARCH, *WINDOW) == []
    assert client.begin(Rpc.COM_NULL_PROC) == []
    first, second = client.later(60.0)
    assert second.transaction == first.transaction + 1


def test_single_c_ends_a_motion():
    client = Client(beam_locked=False).robotic()
    client.begin(Rpc.AUT_MAKE_POSITIONING, *words_of(3.0, 1.0, 0, 0, 0))
    client.session.received(b"c\r\n", client.now_s)
    assert client._bytes[-1] == b"?\r\n"
    assert client.taken()[0].result == Result.ABORTED
    assert client.later(60.0) == []


def test_direction_that_is_none_is_refused():
    client = Client().robotic()
    reply = client.ask(Rpc.AUT_MAKE_POSITIONING, *words_of(1e9, 1.0, 0, 0, 0))
    assert reply.result == Result.INVALID_PARAMETER


def test_other_face_looks_at_the_same_prism_from_the_other_side():
    client = Client().robotic().follow()
    hz, v, _ = client.polar()
    assert client.values(Rpc.TMC_GET_FACE) == [0]
    assert client.ask(Rpc.AUT_CHANGE_FACE, "0", "1", "0").result == Result.OK
    assert client.values(Rpc.TMC_GET_FACE) == [1]
    assert client.values(Rpc.MOT_READ_LOCK_STATUS) == [0]
    seen = client.follow().values(Rpc.TMC_GET_ANGLE_5, "1")
    assert seen == pytest.approx([(hz + math.pi) % math.tau, math.tau - v])
    assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words_of(hz, v, 0, 1, 0)).result == Result.OK
    assert client.values(Rpc.TMC_GET_FACE) == [0]


def test_instrument_of_one_face_turns_over_for_nobody():
    client = Client(faces=1).robotic()
    assert client.ask(Rpc.AUT_CHANGE_FACE, "0", "1", "0").result == Result.NOT_IMPLEMENTED
    hz, v, _ = client.polar()
    words = words_of(hz, math.tau - v, 0, 1, 0)
    assert client.ask(Rpc.AUT_MAKE_POSITIONING, *words).result == Result.INVALID_PARAMETER
