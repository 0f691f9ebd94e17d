"""The connection under geocompy: it always ends, and never reads another question's answer."""

import pytest
from geocompy.communication import Connection
from timed_pipe import HandClock, TimedPipe

from drivers.errors import LinkDown, WireError
from drivers.geocom.connection import GeocomConnection

QUESTION = "%R1Q,2108,7:5000,1"
ANSWER = "%R1P,0,7:0,1.0,2.0,3.0"


class Wire:
    def __init__(self, *said, **options):
        self.clock = HandClock()
        self.pipe = TimedPipe(self.clock, lambda _: said)
        self.connection = GeocomConnection(
            self.pipe, clock_s=self.clock.now_s, within_s=5.0, **options
        )


def test_it_is_a_connection_as_geocompy_asks_for_it():
    assert isinstance(Wire().connection, Connection)


def test_answer_comes_as_it_was_sent():
    wire = Wire((0.1, f"{ANSWER}\r\n".encode()))
    assert wire.connection.exchange(QUESTION) == ANSWER
    assert wire.connection.exchange_binary(QUESTION.encode()) == ANSWER.encode()
    assert wire.pipe.sent == [f"{QUESTION}\r\n".encode()] * 2
    assert wire.connection.failure is None


def test_answer_may_come_byte_by_byte():
    data = f"{ANSWER}\r\n".encode()
    wire = Wire(*[(0.01 * index, data[index : index + 1]) for index in range(len(data))])
    assert wire.connection.exchange(QUESTION) == ANSWER


def test_silence_ends_at_the_deadline():
    wire = Wire()
    with pytest.raises(ConnectionError, match="no answer to TMC_GET_SIMPLE_MEA within 5 s"):
        wire.connection.exchange(QUESTION)
    assert wire.clock.now_s() == pytest.approx(5.0)
    assert isinstance(wire.connection.failure, LinkDown)
    assert not wire.connection.is_open()
    assert wire.pipe.is_closed


def test_more_patience_is_for_one_question_only():
    wire = Wire((7.0, f"{ANSWER}\r\n".encode()))
    with wire.connection.patience(10.0):
        assert wire.connection.exchange(QUESTION) == ANSWER
    with pytest.raises(ConnectionError, match="within 5 s"):
        wire.connection.exchange(QUESTION)


def test_closed_by_the_instrument_it_ends_at_once():
    wire = Wire((0.1, b""))
    with pytest.raises(ConnectionError, match="closed the connection"):
        wire.connection.exchange(QUESTION)
    assert wire.clock.now_s() == pytest.approx(0.1)


@pytest.mark.parametrize(
    "said", [b"\x00\xff\r\n", b"%R1P\r\n", b"x" * 5000, b"%R1P,0,7:0,\xb0\r\n"]
)
def test_garbage_closes_it(said):
    wire = Wire((0.1, said))
    with pytest.raises(ConnectionError, match="not a line of GeoCOM"):
        wire.connection.exchange(QUESTION)
    assert isinstance(wire.connection.failure, WireError)
    assert wire.pipe.is_closed


def test_half_an_answer_ends_at_the_deadline():
    wire = Wire((0.1, b"%R1P,0,7:0,1.0"))
    with pytest.raises(ConnectionError, match="within 5 s"):
        wire.connection.exchange(QUESTION)


def test_answer_to_another_question_is_never_read():
    wire = Wire((0.1, b"%R1P,0,6:0,9.0,9.0,9.0\r\n"), (0.2, f"{ANSWER}\r\n".encode()))
    assert wire.connection.exchange(QUESTION) == ANSWER


def test_only_answers_to_other_questions_end_at_the_deadline():
    wire = Wire((0.1, b"%R1P,0,6:0,9.0,9.0,9.0\r\n"))
    with pytest.raises(ConnectionError, match="within 5 s"):
        wire.connection.exchange(QUESTION)


def test_damaged_answer_closes_it():
    wire = Wire((0.1, b"%R1P,0,7,1:0,1.0\r\n"))
    with pytest.raises(ConnectionError, match="checksum does not fit"):
        wire.connection.exchange(QUESTION)


def test_first_reason_is_kept():
    wire = Wire((0.1, b""))
    for _ in range(2):
        with pytest.raises(ConnectionError):
            wire.connection.exchange(QUESTION)
    assert "the device closed" in str(wire.connection.failure)


def test_empty_line_that_wakes_the_instrument_needs_no_answer():
    wire = Wire()
    wire.connection.send("\n")
    assert wire.pipe.sent == [b"\r\n"]


def test_line_that_cannot_be_sent_closes_it_and_keeps_the_reason():
    wire = Wire()

    def broken(data, timeout_s):
        raise LinkDown("pipe://test: the cable is out", remedy="-")

    wire.pipe.send = broken
    with pytest.raises(ConnectionError, match="the cable is out"):
        wire.connection.send("\n")
    assert "the cable is out" in str(wire.connection.failure)
    assert wire.pipe.is_closed


@pytest.mark.parametrize(
    "call",
    [
        lambda connection: connection.send(QUESTION),
        lambda connection: connection.send_binary(QUESTION.encode()),
        lambda connection: connection.receive(),
        lambda connection: connection.receive_binary(),
        lambda connection: connection.reset(),
        lambda connection: connection.exchange("c"),
    ],
)
def test_what_could_read_the_wrong_answer_is_refused_and_leaves_it_open(call):
    wire = Wire((0.1, f"{ANSWER}\r\n".encode()))
    with pytest.raises(ConnectionError):
        call(wire.connection)
    assert wire.pipe.sent == []
    assert wire.connection.exchange(QUESTION) == ANSWER


def test_asking_whether_it_is_open_sends_nothing():
    wire = Wire()
    assert wire.connection.is_open()
    wire.connection.close()
    wire.connection.close()
    assert not wire.connection.is_open()
    assert wire.pipe.sent == []
