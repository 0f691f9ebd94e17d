"""The GeoCOM client: a question ends with its own answer or at its deadline, and else closes."""

import pytest
from timed_pipe import HandClock, TimedPipe

from drivers.errors import LinkDown, WireError
from drivers.geocom.client import GeocomClient, GeocomDeadlines, numbers
from drivers.wire.geocom_constants import Rpc

ANSWER = b"%R1P,0,0:0,1.0,2.0,3.0\r\n"


class Wire:
    def __init__(self, *said):
        self.clock = HandClock()
        self.pipe = TimedPipe(self.clock, lambda _: said)
        self.client = GeocomClient(
            self.pipe, self.clock, lambda: False, GeocomDeadlines(), first_transaction=1000
        )

    def ask(self):
        return self.client.ask(Rpc.TMC_GET_SIMPLE_MEA, numbers(3), 5000, 1)


@pytest.mark.parametrize(
    "said",
    [
        [(0.1, ANSWER)],
        [(0.01 * index, ANSWER[index : index + 1]) for index in range(len(ANSWER))],
        [(0.1, b"%R1P,0,6:0,9.0,9.0,9.0\r\n"), (0.2, ANSWER)],
    ],
    ids=["whole", "byte by byte", "behind an answer to another question"],
)
def test_answer_is_taken(said):
    wire = Wire(*said)
    assert wire.ask() == (1.0, 2.0, 3.0)
    assert wire.pipe.sent == [b"%R1Q,2108,0:5000,1\r\n"]


@pytest.mark.parametrize(
    "said",
    [[], [(0.1, ANSWER[:12])], [(0.1, b"%R1P,0,6:0,9.0,9.0,9.0\r\n")]],
    ids=["silence", "half an answer", "only an answer to another question"],
)
def test_without_its_answer_a_question_ends_at_the_deadline_and_closes(said):
    wire = Wire(*said)
    with pytest.raises(LinkDown, match="no answer to TMC_GET_SIMPLE_MEA within 5 s"):
        wire.ask()
    assert wire.clock.now_s() == pytest.approx(5.0)
    assert wire.pipe.is_closed


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        (b"\x00\xff\r\n", "not a line of GeoCOM"),
        (b"x" * 5000, "not a line of GeoCOM"),
        (b"%R1P,0,0:0,\xb0\r\n", "not a line of GeoCOM"),
        (b"%R1P,0,0,1:0,1.0\r\n", "checksum does not fit"),
        (b"%R1P,0,0:0,1.0,2.0\r\n", "TMC_GET_SIMPLE_MEA answers '%R1P,0,0:0,1.0,2.0'"),
        (b"%R1P,0,0:0,1.0,x,2.0\r\n", "TMC_GET_SIMPLE_MEA answers"),
    ],
)
def test_what_is_no_answer_closes(said, problem):
    wire = Wire((0.1, said))
    with pytest.raises(WireError, match=problem):
        wire.ask()
    assert wire.pipe.is_closed


@pytest.mark.parametrize("name", ['a"b', "a\r\nc", "°", "\\"])
def test_name_that_could_be_read_as_something_else_is_not_sent(name):
    wire = Wire((0.1, ANSWER))
    with pytest.raises(WireError, match="cannot be sent"):
        wire.client.tell(Rpc.BAP_SET_PRISM_TYPE_2, 9, name)
    assert wire.pipe.sent == []


def test_number_of_a_question_goes_around_at_its_last():
    wire = Wire((0.1, ANSWER))
    wire.client.next_transaction = 2**15
    assert wire.ask() == (1.0, 2.0, 3.0)
    assert wire.client.next_transaction == 2**15 + 1
