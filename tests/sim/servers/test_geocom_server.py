"""The simulated total station's GeoCOM: its answers, its settings, garbage."""

import pytest
from geocom_client_stub import WINDOW, Client
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from drivers.wire.geocom import GeocomReply, parse_string, words_of
from drivers.wire.geocom_constants import Result, Rpc
from sim.servers.geocom_server import GeocomSession


@pytest.fixture
def client():
    return Client()


def test_instrument_says_who_it_is(client):
    assert parse_string(client.ask(Rpc.CSV_GET_INSTRUMENT_NAME).parameters[0]) == "SIM-TS"
    assert client.values(Rpc.CSV_GET_INSTRUMENT_NO) == [390001]
    assert client.values(Rpc.CSV_GET_DEVICE_CONFIG) == [350, 12]


def test_number_of_the_question_comes_back():
    assert Client().sends(b"%R1Q,0,4711:\r\n") == [GeocomReply(0, 4711, 0)]
    assert Client().sends(b"%R1Q,0:\r\n") == [GeocomReply(0, 0, 0)]


def test_checksum_is_answered_by_a_checksum():
    (reply,) = Client().begin(Rpc.COM_NULL_PROC, checked=True)
    assert reply.checked


def test_damaged_question_is_refused_by_its_number():
    (reply,) = Client().sends(b"%R1Q,0,5,1:\r\n")
    assert (reply.communication, reply.transaction) == (Result.COM_SERVER_CHECKSUM, 5)


@pytest.mark.parametrize(
    ("line", "communication"),
    [
        (b"hello\r\n", Result.COM_WRONG_FORMAT),
        (b"%R1Q,4711,1:\r\n", Result.COM_UNKNOWN_PROCEDURE),
        (b"%R1Q,2012,1:\r\n", Result.COM_CANNOT_DECODE_REQUEST),
        (b"%R1Q,2012,1:1.0,2.0\r\n", Result.COM_CANNOT_DECODE_REQUEST),
        (b'%R1Q,2012,1:"x"\r\n', Result.COM_CANNOT_DECODE_REQUEST),
    ],
)
def test_question_that_cannot_be_read_is_refused(line, communication):
    (reply,) = Client().sends(line)
    assert reply.communication == communication


def test_empty_line_that_wakes_it_is_not_answered():
    assert Client().sends(b"\n\r\n") == []


@pytest.mark.parametrize(("digits", "word"), [(3, "0.034"), (15, "0.0344"), (0, "0.0")])
def test_numbers_have_the_digits_that_were_asked_for(client, digits, word):
    client.ask(Rpc.BAP_SET_PRISM_TYPE_2, *words_of(9, "CCR-1.5in"))
    client.ask(Rpc.COM_SET_DOUBLE_PRECISION, str(digits))
    assert client.ask(Rpc.TMC_GET_PRISM_CORR).parameters == (word,)


def test_settings_stay_when_the_client_goes(client):
    client.ask(Rpc.TMC_SET_HEIGHT, *words_of(0.25))
    client.session.closed(client.now_s)
    again = []
    session = GeocomSession(client.station, again.append)
    session.received(b"%R1Q,2011,9:\r\n", client.now_s)
    assert again == [b"%R1P,0,9:0,0.25\r\n"]


def test_prisms_of_the_operator_are_the_trackers_reflectors(client):
    assert client.ask(Rpc.BAP_GET_USER_PRISM_DEF, '"CCR-75mm"').result == Result.OK
    assert client.ask(Rpc.BAP_GET_USER_PRISM_DEF, '"other"').result == Result.INVALID_PARAMETER
    client.ask(Rpc.BAP_SET_PRISM_TYPE_2, *words_of(9, "CCR-75mm"))
    assert client.cell.tracker.selected == 3
    assert client.ask(Rpc.BAP_GET_PRISM_TYPE_2).parameters == ("9", '"CCR-75mm"')


def test_air_is_that_of_the_cell_until_somebody_sets_it(client):
    _, pressure_hPa, dry_degC, wet_degC = client.values(Rpc.TMC_GET_ATM_CORR)
    assert (pressure_hPa, dry_degC) == (1008.0, 21.5)
    assert 5.0 < wet_degC < dry_degC
    client.ask(Rpc.TMC_SET_ATM_CORR, *words_of(6.58e-7, 1000.0, 25.0, 20.0))
    assert client.values(Rpc.TMC_GET_ATM_CORR)[1:] == [1000.0, 25.0, 20.0]


@pytest.fixture(scope="module")
def anybody():
    return Client().robotic()


any_words = st.lists(
    st.integers(-10, 10).map(str)
    | st.floats(-10, 10).map(lambda value: f"{value:.3f}")
    | st.sampled_from(['"CCR-1.5in"', '"', "x", "9" * 30, ""]),
    max_size=8,
)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from(list(Rpc)) | st.integers(0, 30000), any_words)
def test_every_question_of_whatever_words_gets_one_answer(anybody, rpc, words):
    line = f"%R1Q,{int(rpc)},77:{','.join(words)}\r\n".encode()
    replies = anybody.sends(line)
    for _ in range(5):
        replies = replies or anybody.later(20.0)
    assert len(replies) == 1


@pytest.mark.slow
@given(st.lists(st.binary(max_size=40), max_size=10))
def test_garbage_never_breaks_the_instrument(pieces):
    client = Client()
    for piece in pieces:
        client.sends(piece)
    client.sends(b"\r\n")
    client.later(1000.0)
    assert client.sends(b"%R1Q,0,123456:\r\n") == [GeocomReply(0, 123456, 0)]


def test_babbling_client_is_bounded():
    client = Client(beam_locked=False).robotic()
    client.begin(Rpc.AUT_SEARCH, *WINDOW)
    client.sends(b"%R1Q,0,1:\r\n" * 5000)
    assert len(client.session._waiting) <= 100
